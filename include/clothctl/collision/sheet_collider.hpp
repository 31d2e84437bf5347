#pragma once

// A sheet of triangles with a thickness, at rest: all points within half the thickness w of the
// triangles T. The sheet may be open, and of any topology.
//
//   d(x) = |x - m(x)| - w/2,     m(x) = the point of T that is closest to x
//   n(x) = (x - m)/|x - m|,      q(x) = m + (w/2) n
//
// The normal points away from the sheet on the side of x; on T itself it is that of a triangle. d
// changes by no more than the way. Outside it is the distance from the solid; inside it understates
// the depth, and q may lie inside of another part of the sheet, as in a union: where layers are
// closer than w.
//
// A ball of radius r touches where its centre comes within r + w/2 of a triangle. The distance from
// a triangle is convex, so that the sweep is exact (detail/convex_sweep.hpp).

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "clothctl/collision/detail/basic_shape.hpp"
#include "clothctl/collision/detail/movable_triangles.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A sheet with a thickness, at rest. It may follow a sheet that moves: `update` in each frame.
/// Copies share nothing. Models Collider.
template <RealScalar Scalar>
class SheetCollider : public detail::PointQueries<SheetCollider<Scalar>, Scalar> {
 public:
  /// Makes a sheet of the vertices (3×n, m) and the triangles, of any orientation and topology;
  /// vertices of no triangle are nowhere. `thickness` w (m): see above. A triangle without area
  /// counts as its sides, so that {a, b, b} is a thread. Allocates. Complexity: O(triangles log
  /// triangles). Fails when: a coordinate is not finite, there are no triangles, one holds a vertex
  /// that does not exist, the thickness is not positive, or the friction coefficient is negative.
  static Result<SheetCollider> create(const PointsView<Scalar>& vertices,
                                      const std::vector<std::array<int, 3>>& triangles,
                                      const Scalar& thickness,
                                      const ColliderSurface<Scalar>& surface = {}) {
    std::string bad = find_bad_vertex(vertices);
    if (bad.empty()) bad = find_bad_triangle(vertices.cols(), triangles);
    if (bad.empty()) bad = detail::validate_size<Scalar>("thickness", thickness);
    if (bad.empty()) bad = surface.validate();
    if (!bad.empty()) return Error{"the sheet has " + bad};
    return SheetCollider(vertices, triangles, thickness, surface);
  }

  /// Moves the vertices (3×n, m). Returns an empty string, or what is wrong: another number of
  /// vertices, or a coordinate that is not finite; nothing is changed then. Allocates only for the
  /// message. Complexity: O(triangles). Queries become slower where vertices that were close
  /// together are no longer; their answers stay exact.
  [[nodiscard]] std::string update(const PointsView<Scalar>& vertices) {
    if (vertices.cols() != vertex_count_)
      return "the sheet has " + std::to_string(vertex_count_) + " vertices, and got positions of " +
             std::to_string(vertices.cols());
    std::string bad = find_bad_vertex(vertices);
    if (!bad.empty()) return "the sheet has " + bad;
    tree_.fit(vertices);
    return bad;
  }

  /// Thickness w, m.
  const Scalar& thickness() const { return thickness_; }
  /// Friction and body of the surface.
  const ColliderSurface<Scalar>& surface() const { return surface_; }
  /// The box of the sheet.
  BoundingBox<Scalar> bounds(const Scalar&) const { return tree_.bounds().grown(half_); }

  /// Returns the signed distance of a finite point, m.
  Scalar distance_at(const Vector3<Scalar>& x) const { return tree_.nearest(x).distance - half_; }
  /// Returns everything about the surface closest to a finite point.
  SurfacePoint<Scalar> closest_at(const Vector3<Scalar>& x) const {
    const detail::NearestPoint<Scalar> m = tree_.nearest(x);
    SurfacePoint<Scalar> out;
    out.distance = m.distance - half_;
    out.point = m.point + half_ * m.normal;
    out.normal = m.normal;
    out.friction = surface_.friction;
    out.body = surface_.body;
    return out;
  }
  /// Returns the time of impact of a ball with a finite path.
  Scalar sweep_at(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& radius,
                  const Scalar&) const {
    return tree_.sweep(from, to, radius + half_);
  }

 private:
  SheetCollider(const PointsView<Scalar>& vertices,
                const std::vector<std::array<int, 3>>& triangles, const Scalar& thickness,
                const ColliderSurface<Scalar>& surface)
      : tree_(vertices, triangles),
        vertex_count_(vertices.cols()),
        thickness_(thickness),
        half_(Scalar(0.5) * thickness),
        surface_(surface) {}

  /// Returns an empty string, or the first coordinate that is not finite.
  static std::string find_bad_vertex(const PointsView<Scalar>& x) {
    for (Index v = 0; v < x.cols(); ++v) {
      bool good = true;
      for (Index i = 0; i < 3; ++i) good = good && is_finite(x(i, v)) && !is_unbounded(x(i, v));
      if (good) continue;
      const std::string name = "vertex " + std::to_string(v);
      return detail::validate_point<Scalar>(name.c_str(), x.col(v)).substr(4);
    }
    return {};
  }
  /// Returns an empty string, or what is wrong with the triangles.
  static std::string find_bad_triangle(Index vertex_count,
                                       const std::vector<std::array<int, 3>>& triangles) {
    if (triangles.empty()) return "no triangles";
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      for (const int v : triangles[t]) {
        if (v < 0 || vertex_count <= v)
          return "triangle " + std::to_string(t) + " with " +
                 missing_item_line("vertex", v, vertex_count);
      }
    }
    return {};
  }

  detail::MovableTriangles<Scalar> tree_;
  Index vertex_count_;
  Scalar thickness_, half_;
  ColliderSurface<Scalar> surface_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
