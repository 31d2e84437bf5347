#pragma once

// Triangles in a tree of boxes: which is closest to a point, and when a ball hits the first.

#include <array>
#include <cstddef>
#include <vector>

#include "clothctl/collision/detail/box_tree.hpp"
#include "clothctl/collision/detail/convex_sweep.hpp"
#include "clothctl/collision/detail/triangle_point.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Triangles, at least one, prepared for queries and sorted into boxes. The order is that of the
/// first positions; later only the boxes change.
template <RealScalar Scalar>
class TriangleBoxes {
 public:
  /// Corners of triangles.
  using Corners = std::vector<std::array<int, 3>>;

  /// Takes the triangles and their positions (3×n, m), and returns the triangles in the order of
  /// the tree. Allocates. Complexity: O(n log n).
  std::vector<int> build(const PointsView<Scalar>& x, const Corners& triangles) {
    Points<Scalar> centres(3, static_cast<Index>(triangles.size()));
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      const std::array<int, 3>& c = triangles[t];
      centres.col(static_cast<Index>(t)) = (x.col(c[0]) + x.col(c[1]) + x.col(c[2])) / Scalar(3);
    }
    std::vector<int> order = boxes_.build(centres);
    triangles_.reserve(triangles.size());
    fit(x, in_order(triangles, order));
    return order;
  }

  /// Takes other positions; `triangles` are those of `build` in the order of the tree. Never
  /// allocates. Complexity: O(n).
  void fit(const PointsView<Scalar>& x, const Corners& triangles) {
    triangles_.clear();
    for (const std::array<int, 3>& c : triangles)
      triangles_.emplace_back(x.col(c[0]), x.col(c[1]), x.col(c[2]));
    boxes_.fit([&](int k) {
      const std::array<int, 3>& c = triangles[static_cast<std::size_t>(k)];
      const Vector3<Scalar> p = x.col(c[0]), q = x.col(c[1]), r = x.col(c[2]);
      return BoundingBox<Scalar>{p.cwiseMin(q).cwiseMin(r), p.cwiseMax(q).cwiseMax(r)};
    });
    extent_ = largest_coordinate<Scalar>(bounds().lower, bounds().upper);
  }

  /// The box of all triangles.
  const BoundingBox<Scalar>& bounds() const { return boxes_.bounds(); }
  /// A triangle, in the order of the tree.
  const PreparedTriangle<Scalar>& triangle(std::size_t k) const { return triangles_[k]; }

  /// Returns the triangle closest to x, in the order of the tree. Never allocates.
  std::size_t nearest(const Vector3<Scalar>& x) const {
    // The answer is never farther than a corner of the first triangle; far away, that is the answer
    // to rounding.
    const Scalar first = Vector3<Scalar>(x - triangles_.front().corner()).squaredNorm();
    const int found = boxes_.nearest(x, first, [&](int k, const Scalar& best) {
      const PreparedTriangle<Scalar>& t = triangles_[static_cast<std::size_t>(k)];
      const Scalar least = t.plane_square(x);
      return least < best ? t.closest(x).square : least;
    });
    return found < 0 ? 0 : static_cast<std::size_t>(found);
  }

  /// Returns when a point first comes within `reach` (m) of a triangle, as a share of the way, or
  /// `no_impact()`. 0 when `distance`, that of `from` (m, signed or not), is not above `reach`.
  /// Never allocates.
  Scalar sweep(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& reach,
               const Scalar& distance) const {
    const Scalar tolerance = touch_tolerance<Scalar>(from, to, reach + extent_);
    if (distance - reach <= tolerance) return Scalar(0);
    return boxes_.sweep(from, to, reach + tolerance, [&](int k, const Scalar& latest) {
      // The distance from a triangle is convex.
      const PreparedTriangle<Scalar>& t = triangles_[static_cast<std::size_t>(k)];
      const auto closest = [&t](const Vector3<Scalar>& x) {
        const TriangleOffset<Scalar> q = t.closest(x);
        const Direction<Scalar> way = direction_of<Scalar>(q.offset, q.offset);
        return NearestPoint<Scalar>{way.length, x - q.offset, way.unit};
      };
      return convex_sweep<Scalar>(closest, from, to, reach, latest, extent_);
    });
  }

 private:
  BoxTree<Scalar> boxes_;
  std::vector<PreparedTriangle<Scalar>> triangles_;
  /// The largest coordinate.
  Scalar extent_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
