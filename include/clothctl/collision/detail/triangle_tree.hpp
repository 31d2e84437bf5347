#pragma once

// A tree of boxes over the triangles of a closed mesh: exact signed distances and sweeps.
//
// Each node has the box of its triangles. A search keeps the best answer so far and leaves out
// nodes whose box is farther (a sweep: whose box the ball reaches later). Boxes are halved at the
// median of the triangles' centres along the longest axis of the centres.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "clothctl/collision/detail/closed_mesh.hpp"
#include "clothctl/collision/detail/convex_sweep.hpp"
#include "clothctl/collision/detail/triangle_point.hpp"
#include "clothctl/core/longest_axis.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Boxes around the triangles of a closed mesh that passed `validate_closed`.
template <RealScalar Scalar>
class TriangleTree {
 public:
  /// Sorts the triangles (3×n positions, m) into boxes. Allocates. Complexity: O(n log n).
  TriangleTree(const Points<Scalar>& x, const std::vector<std::array<int, 3>>& triangles,
               const std::vector<Pseudonormals<Scalar>>& normals);

  /// Returns the closest point of the surface, with the signed distance. Never allocates.
  NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const;
  /// Returns the time of impact of a ball; 0 for one that starts inside or closer than its radius.
  /// Never allocates.
  Scalar sweep(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& radius) const;
  /// Returns the box of the mesh.
  BoundingBox<Scalar> bounds() const { return nodes_.front().box; }

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

  int build(std::vector<int>& order, int begin, int end, const Points<Scalar>& x,
            const std::vector<std::array<int, 3>>& triangles, const Points<Scalar>& centres);
  static Scalar squared_distance(const BoundingBox<Scalar>& box, const Vector3<Scalar>& x);
  NearestPoint<Scalar> signed_point(std::size_t triangle, const Vector3<Scalar>& x) const;
  Scalar triangle_sweep(const PreparedTriangle<Scalar>& triangle, const Vector3<Scalar>& from,
                        const Vector3<Scalar>& to, const Scalar& radius,
                        const Scalar& latest) const;

  std::vector<Node> nodes_;
  /// The largest coordinate of the mesh.
  Scalar extent_;
  std::vector<PreparedTriangle<Scalar>> triangles_;
  std::vector<Pseudonormals<Scalar>> normals_;
};

/// Returns the share of the way from `from` to `to` at which a point enters a box, or
/// `no_impact()` when it does not by the time `latest`.
template <RealScalar Scalar>
Scalar box_entry(const BoundingBox<Scalar>& box, const Vector3<Scalar>& from,
                 const Vector3<Scalar>& to, const Scalar& latest) {
  Scalar enter(0), leave = latest;
  for (int i = 0; i < 3; ++i) {
    const Scalar way = to[i] - from[i], low = box.lower[i] - from[i], high = box.upper[i] - from[i];
    if (way == Scalar(0)) {
      if (Scalar(0) < low || high < Scalar(0)) return no_impact<Scalar>();
      continue;
    }
    Scalar first = low / way, second = high / way;
    if (second < first) std::swap(first, second);
    if (enter < first) enter = first;
    if (second < leave) leave = second;
    if (leave < enter) return no_impact<Scalar>();
  }
  return enter;
}

template <RealScalar Scalar>
TriangleTree<Scalar>::TriangleTree(const Points<Scalar>& x,
                                   const std::vector<std::array<int, 3>>& triangles,
                                   const std::vector<Pseudonormals<Scalar>>& normals) {
  const int count = static_cast<int>(triangles.size());
  Points<Scalar> centres(3, count);
  std::vector<int> order(triangles.size());
  for (int t = 0; t < count; ++t) {
    const std::array<int, 3>& c = triangles[static_cast<std::size_t>(t)];
    order[static_cast<std::size_t>(t)] = t;
    centres.col(t) = (x.col(c[0]) + x.col(c[1]) + x.col(c[2])) / Scalar(3);
  }
  nodes_.reserve(2 * triangles.size());
  build(order, 0, count, x, triangles, centres);
  extent_ = largest_coordinate<Scalar>(nodes_.front().box.lower, nodes_.front().box.upper);
  triangles_.reserve(triangles.size());
  normals_.reserve(triangles.size());
  for (const int t : order) {
    const std::array<int, 3>& c = triangles[static_cast<std::size_t>(t)];
    triangles_.emplace_back(x.col(c[0]), x.col(c[1]), x.col(c[2]));
    normals_.push_back(normals[static_cast<std::size_t>(t)]);
  }
}

template <RealScalar Scalar>
int TriangleTree<Scalar>::build(std::vector<int>& order, int begin, int end,
                                const Points<Scalar>& x,
                                const std::vector<std::array<int, 3>>& triangles,
                                const Points<Scalar>& centres) {
  const int self = static_cast<int>(nodes_.size());
  nodes_.push_back({});
  const Vector3<Scalar> start =
      x.col(triangles[static_cast<std::size_t>(order[static_cast<std::size_t>(begin)])][0]);
  BoundingBox<Scalar> box{start, start};
  for (int i = begin; i < end; ++i) {
    for (const int v : triangles[static_cast<std::size_t>(order[static_cast<std::size_t>(i)])])
      box.include(Vector3<Scalar>(x.col(v)));
  }
  Node& node = nodes_[static_cast<std::size_t>(self)];
  node.box = box;
  if (end - begin <= kLeafTriangles) {
    node.first = begin;
    node.count = end - begin;
    return self;
  }
  const int middle = split_along_longest_axis(centres, order, begin, end);
  build(order, begin, middle, x, triangles, centres);
  const int second = build(order, middle, end, x, triangles, centres);
  nodes_[static_cast<std::size_t>(self)].first = second;
  return self;
}

template <RealScalar Scalar>
Scalar TriangleTree<Scalar>::squared_distance(const BoundingBox<Scalar>& box,
                                              const Vector3<Scalar>& x) {
  Scalar sum(0);
  for (int i = 0; i < 3; ++i) {
    const Scalar below = box.lower[i] - x[i], above = x[i] - box.upper[i];
    Scalar out = below < above ? above : below;
    if (out < Scalar(0)) out = Scalar(0);
    sum += out * out;
  }
  return sum;
}

template <RealScalar Scalar>
NearestPoint<Scalar> TriangleTree<Scalar>::nearest(const Vector3<Scalar>& x) const {
  std::array<Visit, kMostLevels> stack;
  std::size_t size = 0, best = 0;
  // The answer is never farther than a corner of the first triangle; far away, that is the answer
  // to rounding.
  Scalar best_square = Vector3<Scalar>(x - triangles_.front().corner()).squaredNorm();
  int at = 0;
  for (;;) {
    const Node& node = nodes_[static_cast<std::size_t>(at)];
    if (node.count == 0) {
      int closer = at + 1, other = node.first;
      Scalar d_closer = squared_distance(nodes_[static_cast<std::size_t>(closer)].box, x);
      Scalar d_other = squared_distance(nodes_[static_cast<std::size_t>(other)].box, x);
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
    for (int i = node.first; i < node.first + node.count; ++i) {
      const PreparedTriangle<Scalar>& triangle = triangles_[static_cast<std::size_t>(i)];
      if (!(triangle.plane_square(x) < best_square)) continue;
      const Scalar square = triangle.closest(x).square;
      if (square < best_square) {
        best_square = square;
        best = static_cast<std::size_t>(i);
      }
    }
    while (size > 0 && !(stack[size - 1].key < best_square)) --size;
    if (size == 0) break;
    at = stack[--size].node;
  }
  return signed_point(best, x);
}

template <RealScalar Scalar>
NearestPoint<Scalar> TriangleTree<Scalar>::signed_point(std::size_t triangle,
                                                        const Vector3<Scalar>& x) const {
  const PreparedTriangle<Scalar>& t = triangles_[triangle];
  const Pseudonormals<Scalar>& normals = normals_[triangle];
  const TriangleOffset<Scalar> q = t.closest(x);
  const std::size_t feature = static_cast<std::size_t>(q.feature);
  // The far side of a thin part of the mesh may be as close, to rounding. Its sign would be wrong.
  const bool outside = !nodes_.front().box.overlaps({x, x});
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

template <RealScalar Scalar>
Scalar TriangleTree<Scalar>::triangle_sweep(const PreparedTriangle<Scalar>& triangle,
                                            const Vector3<Scalar>& from, const Vector3<Scalar>& to,
                                            const Scalar& radius, const Scalar& latest) const {
  // The distance from a triangle is convex, too.
  const auto unsigned_point = [&triangle](const Vector3<Scalar>& x) {
    const TriangleOffset<Scalar> q = triangle.closest(x);
    const Direction<Scalar> way = direction_of<Scalar>(q.offset, q.offset);
    return NearestPoint<Scalar>{way.length, x - q.offset, way.unit};
  };
  return convex_sweep<Scalar>(unsigned_point, from, to, radius, latest, extent_);
}

template <RealScalar Scalar>
Scalar TriangleTree<Scalar>::sweep(const Vector3<Scalar>& from, const Vector3<Scalar>& to,
                                   const Scalar& radius) const {
  std::array<Visit, kMostLevels> stack;
  std::size_t size = 0;
  const Scalar tolerance = touch_tolerance<Scalar>(from, to, radius + extent_);
  if (nearest(from).distance - radius <= tolerance) return Scalar(0);
  const Scalar reach = radius + tolerance;
  Scalar best = no_impact<Scalar>(), latest(1);
  const Scalar entry = box_entry<Scalar>(nodes_.front().box.grown(reach), from, to, latest);
  if (latest < entry) return best;
  int at = 0;
  for (;;) {
    const Node& node = nodes_[static_cast<std::size_t>(at)];
    if (node.count == 0) {
      int sooner = at + 1, other = node.first;
      Scalar t_sooner = box_entry<Scalar>(nodes_[static_cast<std::size_t>(sooner)].box.grown(reach),
                                          from, to, latest);
      Scalar t_other = box_entry<Scalar>(nodes_[static_cast<std::size_t>(other)].box.grown(reach),
                                         from, to, latest);
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
    for (int i = node.first; i < node.first + node.count; ++i) {
      const Scalar t =
          triangle_sweep(triangles_[static_cast<std::size_t>(i)], from, to, radius, latest);
      if (t < best) best = t;
      if (best < latest) latest = best;
    }
    while (size > 0 && !(stack[size - 1].key <= latest)) --size;
    if (size == 0) return best;
    at = stack[--size].node;
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
