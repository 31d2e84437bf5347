#pragma once

// Triangles that have no inside, and may move: distances and sweeps.

#include <array>
#include <cstddef>
#include <vector>

#include "clothctl/collision/detail/basic_shape.hpp"
#include "clothctl/collision/detail/triangle_boxes.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A tree of boxes over triangles that have no inside, and may move. The order of the triangles is
/// that of the first positions; later only the boxes change.
template <RealScalar Scalar>
class MovableTriangles {
 public:
  /// Sorts the triangles (at least one; 3×n positions, m) into boxes. Allocates. Complexity:
  /// O(n log n).
  MovableTriangles(const PointsView<Scalar>& x, const std::vector<std::array<int, 3>>& triangles)
      : x_(x) {
    corners_ = in_order(triangles, triangles_.build(x, triangles));
  }

  /// Takes other positions. Never allocates. Complexity: O(n).
  void fit(const PointsView<Scalar>& x) {
    x_ = x;
    triangles_.fit(x_, corners_);
  }
  /// Returns the closest point, the distance from it (not signed), and the direction to x. Never
  /// allocates.
  NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const;
  /// Returns when a point first comes within `reach` (m), as a share of the way, or `no_impact()`.
  /// Never allocates.
  Scalar sweep(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& reach) const {
    return triangles_.sweep(from, to, reach, nearest(from).distance);
  }
  /// Returns the box of all triangles.
  const BoundingBox<Scalar>& bounds() const { return triangles_.bounds(); }

 private:
  Vector3<Scalar> some_normal(std::size_t triangle) const;

  TriangleBoxes<Scalar> triangles_;
  /// The corners in the order of the tree.
  std::vector<std::array<int, 3>> corners_;
  Points<Scalar> x_;
};

template <RealScalar Scalar>
NearestPoint<Scalar> MovableTriangles<Scalar>::nearest(const Vector3<Scalar>& x) const {
  const std::size_t triangle = triangles_.nearest(x);
  const PreparedTriangle<Scalar>& t = triangles_.triangle(triangle);
  const TriangleOffset<Scalar> q = t.closest(x);
  const Direction<Scalar> way = direction_of<Scalar>(q.offset, q.offset);
  // Closer than rounding, the direction of a difference of points is noise. That of a height over
  // the plane is not.
  const Scalar noise =
      Scalar(8) * scalar_traits<Scalar>::epsilon() * largest_coordinate<Scalar>(x, t.corner());
  const bool exact = q.feature == TriangleFeature::Face && !t.thin() && Scalar(0) < way.length;
  if (!exact && way.length <= noise) return {way.length, x - q.offset, some_normal(triangle)};
  return {way.length, x - q.offset, way.unit};
}

/// Returns the unit normal of a triangle; of one without area, a unit vector across its longest
/// side.
template <RealScalar Scalar>
Vector3<Scalar> MovableTriangles<Scalar>::some_normal(std::size_t triangle) const {
  const std::array<int, 3>& c = corners_[triangle];
  const Vector3<Scalar> a = x_.col(c[0]), b = x_.col(c[1]), d = x_.col(c[2]);
  const TriangleFrame<Scalar> frame = triangle_frame<Scalar>(a, b, d);
  if (Scalar(0) < frame.normal.squaredNorm()) return frame.normal;
  const std::array<Vector3<Scalar>, 3> side{b - a, d - b, a - d};
  const Vector3<Scalar> x_axis(Scalar(1), Scalar(0), Scalar(0));
  return unit_orthogonal<Scalar>(direction_of<Scalar>(side[frame.longest], x_axis).unit);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
