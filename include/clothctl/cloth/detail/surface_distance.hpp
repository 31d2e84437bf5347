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

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Two vertices and the length of the edge between them, m.
struct SurfaceEdge {
  int a = 0, b = 0;
  double length = 0.0;
};

/// A surface by its edges; computes distances from sources.
class SurfaceDistance {
 public:
  /// Every side of a triangle must be among the edges for the triangle to be used. Allocates.
  SurfaceDistance(int vertex_count, const std::vector<SurfaceEdge>& edges,
                  const std::vector<std::array<int, 3>>& triangles);

  /// Calls `visit(vertex, distance)` for each vertex whose distance from `source` is at most
  /// `radius`, nearest first; each vertex once. Allocates.
  template <class Visit>
  void spread(int source, double radius, Visit&& visit);

 private:
  struct Neighbour {
    int vertex;
    double length;
  };
  /// The side opposite to a vertex in a triangle, with the lengths of the three sides.
  struct Wedge {
    int first, second;
    double to_first, to_second, between;
  };

  double length_of(int a, int b) const;
  void improve(int vertex, double distance, double radius);
  static double across(const Wedge& wedge, double first, double second);

  std::vector<std::vector<Neighbour>> neighbours_;
  /// For each vertex, the triangles around it, seen from each of its corners: entry (v, wedge, c)
  /// says how v and another corner give the distance of c.
  std::vector<std::vector<std::pair<int, Wedge>>> reach_;
  std::vector<double> distance_;
  std::vector<int> touched_;
  std::priority_queue<std::pair<double, int>, std::vector<std::pair<double, int>>,
                      std::greater<std::pair<double, int>>>
      queue_;
};

inline SurfaceDistance::SurfaceDistance(int vertex_count, const std::vector<SurfaceEdge>& edges,
                                        const std::vector<std::array<int, 3>>& triangles)
    : neighbours_(static_cast<std::size_t>(vertex_count)),
      reach_(static_cast<std::size_t>(vertex_count)),
      distance_(static_cast<std::size_t>(vertex_count), -1.0) {
  for (const SurfaceEdge& edge : edges) {
    neighbours_[static_cast<std::size_t>(edge.a)].push_back({edge.b, edge.length});
    neighbours_[static_cast<std::size_t>(edge.b)].push_back({edge.a, edge.length});
  }
  for (const std::array<int, 3>& t : triangles) {
    const std::array<double, 3> side{length_of(t[1], t[2]), length_of(t[2], t[0]),
                                     length_of(t[0], t[1])};
    if (side[0] < 0.0 || side[1] < 0.0 || side[2] < 0.0) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const std::size_t i = (c + 1) % 3, j = (c + 2) % 3;
      const Wedge wedge{t[i], t[j], side[j], side[i], side[c]};
      reach_[static_cast<std::size_t>(t[i])].push_back({t[c], wedge});
      reach_[static_cast<std::size_t>(t[j])].push_back({t[c], wedge});
    }
  }
}

inline double SurfaceDistance::length_of(int a, int b) const {
  for (const Neighbour& n : neighbours_[static_cast<std::size_t>(a)]) {
    if (n.vertex == b) return n.length;
  }
  return -1.0;
}

inline void SurfaceDistance::improve(int vertex, double distance, double radius) {
  double& known = distance_[static_cast<std::size_t>(vertex)];
  if (distance > radius) return;
  if (known >= 0.0 && known <= distance * (1.0 + 1e-12)) return;
  if (known < 0.0) touched_.push_back(vertex);
  known = distance;
  queue_.push({distance, vertex});
}

inline double SurfaceDistance::across(const Wedge& wedge, double first, double second) {
  // The first corner is the origin, the second (between, 0); the source lies below, c above.
  const double l = wedge.between;
  const double sx = (first * first - second * second + l * l) / (2.0 * l);
  const double sy = std::sqrt((std::max)(0.0, first * first - sx * sx));
  const double cx =
      (wedge.to_first * wedge.to_first - wedge.to_second * wedge.to_second + l * l) / (2.0 * l);
  const double cy = std::sqrt((std::max)(0.0, wedge.to_first * wedge.to_first - cx * cx));
  if (!(0.0 < sy + cy)) return -1.0;
  const double crossing = sx + (cx - sx) * sy / (sy + cy);
  if (crossing < -1e-9 * l || crossing > (1.0 + 1e-9) * l) return -1.0;
  return std::sqrt((cx - sx) * (cx - sx) + (cy + sy) * (cy + sy));
}

template <class Visit>
void SurfaceDistance::spread(int source, double radius, Visit&& visit) {
  touched_.clear();
  improve(source, 0.0, radius);
  std::vector<std::pair<double, int>> order;
  while (!queue_.empty()) {
    const auto [distance, v] = queue_.top();
    queue_.pop();
    const std::size_t at = static_cast<std::size_t>(v);
    if (distance != distance_[at]) continue;
    for (const Neighbour& n : neighbours_[at]) improve(n.vertex, distance + n.length, radius);
    for (const auto& [corner, wedge] : reach_[at]) {
      const double first = distance_[static_cast<std::size_t>(wedge.first)];
      const double second = distance_[static_cast<std::size_t>(wedge.second)];
      if (first < 0.0 || second < 0.0) continue;
      const double reached = across(wedge, first, second);
      if (reached >= 0.0) improve(corner, reached, radius);
    }
  }
  for (int v : touched_) order.push_back({distance_[static_cast<std::size_t>(v)], v});
  for (int v : touched_) distance_[static_cast<std::size_t>(v)] = -1.0;
  std::sort(order.begin(), order.end());
  for (const auto& [distance, v] : order) visit(v, distance);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
