#pragma once

// Distances along a surface at rest.
//
// The distance of a vertex is found from those of the two other corners of a triangle: the triangle
// is laid into a plane, the source where both distances meet, on the far side of the edge between
// the corners. If the straight line from there to the vertex crosses that edge, its length is the
// distance; otherwise the shorter path along the edges is. Vertices are visited in the order of
// their distance (Dijkstra), and a smaller value found later is passed on again.
//
// On a flat sheet the distances are those in the plane, up to rounding, unless a corner of an
// obtuse triangle is reached before both its neighbours; they are then too large by the detour
// along the edges. A surface without triangles has the distances along its edges.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <queue>
#include <utility>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Two vertices and the length of the edge between them.
template <RealScalar Scalar = double>
struct SurfaceEdge {
  /// One vertex.
  int a = 0;
  /// The other one.
  int b = 0;
  /// Length, m.
  Scalar length = Scalar(0);
};

/// A surface by its edges; computes distances from sources.
template <RealScalar Scalar = double>
class SurfaceDistance {
 public:
  /// Every side of a triangle must be among the edges for the triangle to be used. Allocates.
  SurfaceDistance(int vertex_count, const std::vector<SurfaceEdge<Scalar>>& edges,
                  const std::vector<std::array<int, 3>>& triangles);

  /// Calls `visit(vertex, distance)` for each vertex whose distance from `source` is at most
  /// `radius` (m), nearest first; each vertex once. Allocates.
  template <class Visit>
  void spread(int source, const Scalar& radius, Visit&& visit);

 private:
  using Reached = std::pair<Scalar, int>;

  struct Neighbour {
    int vertex;
    Scalar length;
  };
  /// The side opposite to a vertex in a triangle, with the lengths of the three sides.
  struct Wedge {
    int first, second;
    Scalar to_first, to_second, between;
  };

  static bool is_known(const Scalar& distance) { return Scalar(0) <= distance; }

  Scalar length_of(int a, int b) const;
  void improve(int vertex, const Scalar& distance, const Scalar& radius);
  static Scalar across(const Wedge& wedge, const Scalar& first, const Scalar& second);

  std::vector<std::vector<Neighbour>> neighbours_;
  /// For each vertex, the triangles around it, seen from each of its corners: entry (v, wedge, c)
  /// says how v and another corner give the distance of c.
  std::vector<std::vector<std::pair<int, Wedge>>> reach_;
  std::vector<Scalar> distance_;  // negative: not known
  std::vector<int> touched_;
  std::priority_queue<Reached, std::vector<Reached>, std::greater<Reached>> queue_;
};

template <RealScalar Scalar>
SurfaceDistance<Scalar>::SurfaceDistance(int vertex_count,
                                         const std::vector<SurfaceEdge<Scalar>>& edges,
                                         const std::vector<std::array<int, 3>>& triangles)
    : neighbours_(static_cast<std::size_t>(vertex_count)),
      reach_(static_cast<std::size_t>(vertex_count)),
      distance_(static_cast<std::size_t>(vertex_count), Scalar(-1)) {
  for (const SurfaceEdge<Scalar>& edge : edges) {
    neighbours_[static_cast<std::size_t>(edge.a)].push_back({edge.b, edge.length});
    neighbours_[static_cast<std::size_t>(edge.b)].push_back({edge.a, edge.length});
  }
  for (const std::array<int, 3>& t : triangles) {
    const std::array<Scalar, 3> side{length_of(t[1], t[2]), length_of(t[2], t[0]),
                                     length_of(t[0], t[1])};
    if (!is_known(side[0]) || !is_known(side[1]) || !is_known(side[2])) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const std::size_t i = (c + 1) % 3, j = (c + 2) % 3;
      const Wedge wedge{t[i], t[j], side[j], side[i], side[c]};
      reach_[static_cast<std::size_t>(t[i])].push_back({t[c], wedge});
      reach_[static_cast<std::size_t>(t[j])].push_back({t[c], wedge});
    }
  }
}

template <RealScalar Scalar>
Scalar SurfaceDistance<Scalar>::length_of(int a, int b) const {
  for (const Neighbour& n : neighbours_[static_cast<std::size_t>(a)]) {
    if (n.vertex == b) return n.length;
  }
  return Scalar(-1);
}

template <RealScalar Scalar>
void SurfaceDistance<Scalar>::improve(int vertex, const Scalar& distance, const Scalar& radius) {
  Scalar& known = distance_[static_cast<std::size_t>(vertex)];
  if (radius < distance) return;
  if (is_known(known) && !(distance * Scalar(1.0 + 1e-12) < known)) return;
  if (!is_known(known)) touched_.push_back(vertex);
  known = distance;
  queue_.push({distance, vertex});
}

template <RealScalar Scalar>
Scalar SurfaceDistance<Scalar>::across(const Wedge& wedge, const Scalar& first,
                                       const Scalar& second) {
  using std::sqrt;
  const auto root = [](const Scalar& square) {
    return Scalar(0) < square ? Scalar(sqrt(square)) : Scalar(0);
  };
  // The first corner is the origin, the second (between, 0); the source lies below, c above.
  const Scalar l = wedge.between;
  const Scalar sx = (first * first - second * second + l * l) / (Scalar(2) * l);
  const Scalar sy = root(first * first - sx * sx);
  const Scalar cx = (wedge.to_first * wedge.to_first - wedge.to_second * wedge.to_second + l * l) /
                    (Scalar(2) * l);
  const Scalar cy = root(wedge.to_first * wedge.to_first - cx * cx);
  if (!(Scalar(0) < sy + cy)) return Scalar(-1);
  const Scalar crossing = sx + (cx - sx) * sy / (sy + cy);
  if (crossing < Scalar(-1e-9) * l || Scalar(1.0 + 1e-9) * l < crossing) return Scalar(-1);
  return sqrt((cx - sx) * (cx - sx) + (cy + sy) * (cy + sy));
}

template <RealScalar Scalar>
template <class Visit>
void SurfaceDistance<Scalar>::spread(int source, const Scalar& radius, Visit&& visit) {
  touched_.clear();
  improve(source, Scalar(0), radius);
  std::vector<Reached> order;
  while (!queue_.empty()) {
    const auto [distance, v] = queue_.top();
    queue_.pop();
    const std::size_t at = static_cast<std::size_t>(v);
    if (!(distance == distance_[at])) continue;
    for (const Neighbour& n : neighbours_[at]) improve(n.vertex, distance + n.length, radius);
    for (const auto& [corner, wedge] : reach_[at]) {
      const Scalar first = distance_[static_cast<std::size_t>(wedge.first)];
      const Scalar second = distance_[static_cast<std::size_t>(wedge.second)];
      if (!is_known(first) || !is_known(second)) continue;
      const Scalar reached = across(wedge, first, second);
      if (is_known(reached)) improve(corner, reached, radius);
    }
  }
  for (int v : touched_) order.push_back({distance_[static_cast<std::size_t>(v)], v});
  for (int v : touched_) distance_[static_cast<std::size_t>(v)] = Scalar(-1);
  std::sort(order.begin(), order.end());
  for (const auto& [distance, v] : order) visit(v, distance);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
