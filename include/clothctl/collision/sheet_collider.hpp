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
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/detail/basic_shape.hpp"
#include "clothctl/collision/detail/triangle_point.hpp"
#include "clothctl/collision/detail/triangle_tree.hpp"
#include "clothctl/core/longest_axis.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// A tree of boxes over triangles that have no inside, and may move. The order of the triangles is
/// that of the first positions; later only the boxes change.
template <RealScalar Scalar>
class MovableTriangles {
 public:
  /// Sorts the triangles (3×n positions, m) into boxes. Allocates. Complexity: O(n log n).
  MovableTriangles(const PointsView<Scalar>& x, const std::vector<std::array<int, 3>>& triangles);

  /// Takes other positions. Never allocates. Complexity: O(n).
  void fit(const PointsView<Scalar>& x);
  /// Returns the closest point, the distance from it (not signed), and the direction to x. Never
  /// allocates.
  NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const;
  /// Returns when a point first comes within `reach` (m), as a share of the way, or `no_impact()`.
  /// Never allocates.
  Scalar sweep(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& reach) const;
  /// Returns the box of all triangles.
  const BoundingBox<Scalar>& bounds() const { return nodes_.front().box; }

 private:
  static constexpr int kLeafTriangles = 4;
  /// Halving 2^31 triangles gives no more levels.
  static constexpr std::size_t kMostLevels = 64;

  struct Node {
    BoundingBox<Scalar> box;
    /// A leaf: its first triangle. Otherwise the second child; the first is the next node.
    int first = 0;
    /// Triangles of a leaf; 0 for an inner node.
    int count = 0;
  };
  struct Visit {
    int node;
    Scalar key;
  };

  int build(std::vector<int>& order, int begin, int end, const Points<Scalar>& centres);
  const Node& node(int i) const { return nodes_[static_cast<std::size_t>(i)]; }
  static Scalar box_square(const BoundingBox<Scalar>& box, const Vector3<Scalar>& x);
  NearestPoint<Scalar> point_of(std::size_t triangle, const Vector3<Scalar>& x) const;
  Vector3<Scalar> some_normal(std::size_t triangle) const;

  std::vector<Node> nodes_;
  /// The triangles in the order of the tree, their corners, and both prepared for queries.
  std::vector<std::array<int, 3>> corners_;
  Points<Scalar> x_;
  std::vector<PreparedTriangle<Scalar>> triangles_;
  /// The largest coordinate.
  Scalar extent_ = Scalar(0);
};

}  // namespace detail

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
  /// vertices, or a coordinate that is not finite; nothing is changed then. Allocates only in the
  /// second case. Complexity: O(triangles). Queries become slower where vertices that were close
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

namespace detail {

template <RealScalar Scalar>
MovableTriangles<Scalar>::MovableTriangles(const PointsView<Scalar>& x,
                                           const std::vector<std::array<int, 3>>& triangles)
    : x_(x) {
  const int count = static_cast<int>(triangles.size());
  Points<Scalar> centres(3, count);
  for (int t = 0; t < count; ++t) {
    const std::array<int, 3>& c = triangles[static_cast<std::size_t>(t)];
    centres.col(t) = (x.col(c[0]) + x.col(c[1]) + x.col(c[2])) / Scalar(3);
  }
  std::vector<int> order(triangles.size());
  std::iota(order.begin(), order.end(), 0);
  nodes_.reserve(2 * triangles.size());
  build(order, 0, count, centres);
  corners_.reserve(triangles.size());
  triangles_.reserve(triangles.size());
  for (const int t : order) {
    const std::array<int, 3>& c = triangles[static_cast<std::size_t>(t)];
    corners_.push_back(c);
    triangles_.emplace_back(x.col(c[0]), x.col(c[1]), x.col(c[2]));
  }
  fit(x);
}

template <RealScalar Scalar>
int MovableTriangles<Scalar>::build(std::vector<int>& order, int begin, int end,
                                    const Points<Scalar>& centres) {
  const int self = static_cast<int>(nodes_.size());
  nodes_.push_back({});
  if (end - begin <= kLeafTriangles) {
    nodes_.back().first = begin;
    nodes_.back().count = end - begin;
    return self;
  }
  const int middle = split_along_longest_axis(centres, order, begin, end);
  build(order, begin, middle, centres);
  const int second = build(order, middle, end, centres);
  nodes_[static_cast<std::size_t>(self)].first = second;
  return self;
}

template <RealScalar Scalar>
void MovableTriangles<Scalar>::fit(const PointsView<Scalar>& x) {
  x_ = x;
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    const std::array<int, 3>& c = corners_[t];
    triangles_[t] = PreparedTriangle<Scalar>(x_.col(c[0]), x_.col(c[1]), x_.col(c[2]));
  }
  // Children come after their parents.
  for (std::size_t i = nodes_.size(); i-- > 0;) {
    Node& at = nodes_[i];
    if (at.count == 0) {
      at.box = nodes_[i + 1].box;
      at.box.include(node(at.first).box);
      continue;
    }
    const Vector3<Scalar> start = x_.col(corners_[static_cast<std::size_t>(at.first)][0]);
    at.box = {start, start};
    for (int t = at.first; t < at.first + at.count; ++t) {
      for (const int v : corners_[static_cast<std::size_t>(t)])
        at.box.include(Vector3<Scalar>(x_.col(v)));
    }
  }
  extent_ = largest_coordinate<Scalar>(bounds().lower, bounds().upper);
}

template <RealScalar Scalar>
Scalar MovableTriangles<Scalar>::box_square(const BoundingBox<Scalar>& box,
                                            const Vector3<Scalar>& x) {
  Scalar sum(0);
  for (int i = 0; i < 3; ++i) {
    const Scalar below = box.lower[i] - x[i], above = x[i] - box.upper[i];
    const Scalar out = below < above ? above : below;
    if (Scalar(0) < out) sum += out * out;
  }
  return sum;
}

template <RealScalar Scalar>
NearestPoint<Scalar> MovableTriangles<Scalar>::nearest(const Vector3<Scalar>& x) const {
  std::array<Visit, kMostLevels> stack;
  std::size_t size = 0, best = 0;
  // The answer is never farther than a corner of the first triangle; far away, that is the answer
  // to rounding.
  Scalar best_square = Vector3<Scalar>(x - triangles_.front().corner()).squaredNorm();
  int at = 0;
  for (;;) {
    if (node(at).count == 0) {
      int closer = at + 1, other = node(at).first;
      Scalar d_closer = box_square(node(closer).box, x), d_other = box_square(node(other).box, x);
      if (d_other < d_closer) {
        std::swap(closer, other);
        std::swap(d_closer, d_other);
      }
      if (d_other < best_square) stack[size++] = {other, d_other};
      if (d_closer < best_square) {
        at = closer;
        continue;
      }
    }
    for (int i = node(at).first; i < node(at).first + node(at).count; ++i) {
      const PreparedTriangle<Scalar>& triangle = triangles_[static_cast<std::size_t>(i)];
      if (!(triangle.plane_square(x) < best_square)) continue;
      const Scalar square = triangle.closest(x).square;
      if (!(square < best_square)) continue;
      best_square = square;
      best = static_cast<std::size_t>(i);
    }
    while (size > 0 && !(stack[size - 1].key < best_square)) --size;
    if (size == 0) break;
    at = stack[--size].node;
  }
  return point_of(best, x);
}

template <RealScalar Scalar>
NearestPoint<Scalar> MovableTriangles<Scalar>::point_of(std::size_t triangle,
                                                        const Vector3<Scalar>& x) const {
  const PreparedTriangle<Scalar>& t = triangles_[triangle];
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

template <RealScalar Scalar>
Scalar MovableTriangles<Scalar>::sweep(const Vector3<Scalar>& from, const Vector3<Scalar>& to,
                                       const Scalar& reach) const {
  std::array<Visit, kMostLevels> stack;
  std::size_t size = 0;
  const Scalar tolerance = touch_tolerance<Scalar>(from, to, reach + extent_);
  if (nearest(from).distance - reach <= tolerance) return Scalar(0);
  const Scalar grown_by = reach + tolerance;
  Scalar best = no_impact<Scalar>(), latest(1);
  const auto entry = [&](int i) {
    return box_entry<Scalar>(node(i).box.grown(grown_by), from, to, latest);
  };
  if (latest < entry(0)) return best;
  int at = 0;
  for (;;) {
    if (node(at).count == 0) {
      int sooner = at + 1, other = node(at).first;
      Scalar t_sooner = entry(sooner), t_other = entry(other);
      if (t_other < t_sooner) {
        std::swap(sooner, other);
        std::swap(t_sooner, t_other);
      }
      if (t_other <= latest) stack[size++] = {other, t_other};
      if (t_sooner <= latest) {
        at = sooner;
        continue;
      }
    }
    for (int i = node(at).first; i < node(at).first + node(at).count; ++i) {
      const PreparedTriangle<Scalar>& triangle = triangles_[static_cast<std::size_t>(i)];
      const auto closest = [&triangle](const Vector3<Scalar>& x) {
        const TriangleOffset<Scalar> q = triangle.closest(x);
        const Direction<Scalar> way = direction_of<Scalar>(q.offset, q.offset);
        return NearestPoint<Scalar>{way.length, x - q.offset, way.unit};
      };
      const Scalar t = convex_sweep<Scalar>(closest, from, to, reach, latest, extent_);
      if (t < best) best = t;
      if (best < latest) latest = best;
    }
    while (size > 0 && !(stack[size - 1].key <= latest)) --size;
    if (size == 0) return best;
    at = stack[--size].node;
  }
}

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
