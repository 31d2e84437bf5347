#pragma once

// A tree of boxes over the triangles of a closed mesh: exact signed distances and sweeps.

#include <array>
#include <cstddef>
#include <vector>

#include "clothctl/collision/detail/closed_mesh.hpp"
#include "clothctl/collision/detail/triangle_boxes.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Boxes around the triangles of a closed mesh that passed `validate_closed`.
template <RealScalar Scalar>
class TriangleTree {
 public:
  /// Sorts the triangles (3×n positions, m) into boxes. Allocates. Complexity: O(n log n).
  TriangleTree(const Points<Scalar>& x, const std::vector<std::array<int, 3>>& triangles,
               const std::vector<Pseudonormals<Scalar>>& normals) {
    normals_ = in_order(normals, triangles_.build(x, triangles));
  }

  /// Returns the closest point of the surface, with the signed distance. Never allocates.
  NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const;
  /// Returns the time of impact of a ball; 0 for one that starts inside or closer than its radius.
  /// Never allocates.
  Scalar sweep(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& radius) const {
    return triangles_.sweep(from, to, radius, nearest(from).distance);
  }
  /// Returns the box of the mesh.
  const BoundingBox<Scalar>& bounds() const { return triangles_.bounds(); }

 private:
  TriangleBoxes<Scalar> triangles_;
  /// In the order of the tree.
  std::vector<Pseudonormals<Scalar>> normals_;
};

template <RealScalar Scalar>
NearestPoint<Scalar> TriangleTree<Scalar>::nearest(const Vector3<Scalar>& x) const {
  const std::size_t triangle = triangles_.nearest(x);
  const PreparedTriangle<Scalar>& t = triangles_.triangle(triangle);
  const Pseudonormals<Scalar>& normals = normals_[triangle];
  const TriangleOffset<Scalar> q = t.closest(x);
  const std::size_t feature = static_cast<std::size_t>(q.feature);
  // The far side of a thin part of the mesh may be as close, to rounding. Its sign would be wrong.
  const bool outside = !bounds().overlaps({x, x});
  if (q.feature == TriangleFeature::Face && !t.thin()) {
    // The height over the face is more accurate than the length of a difference of points.
    const Scalar height = normals.face.dot(Vector3<Scalar>(x - t.corner()));
    const Vector3<Scalar> point = x - height * normals.face;
    if (outside && height < Scalar(0)) return {-height, point, -normals.face};
    return {height, point, normals.face};
  }
  Vector3<Scalar> pseudo = normals.face;
  if (q.feature != TriangleFeature::Face)
    pseudo = feature < 3 ? normals.corner[feature] : normals.edge[feature - 3];
  const auto [length, unit] = direction_of<Scalar>(q.offset, pseudo);
  const Scalar sign = !outside && unit.dot(pseudo) < Scalar(0) ? Scalar(-1) : Scalar(1);
  // Closer than rounding, the direction of the difference is noise.
  const Scalar noise =
      Scalar(8) * scalar_traits<Scalar>::epsilon() * largest_coordinate<Scalar>(x, t.corner());
  if (length <= noise) return {sign * length, x - sign * length * pseudo, pseudo};
  return {sign * length, x - q.offset, sign * unit};
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
