#pragma once

// What the coarse levels of any mesh are made of: the sheet as a graph, and the order in which its
// vertices are offered a place on a level.

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "clothctl/mesh/topology.hpp"
#include "clothctl/network/spring_network.hpp"
#include "clothctl/network/surface_distance.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What levels are made of. Vertices of the sheet have the order of the model.
struct LevelInput {
  /// More pinned vertices than this have no tethers.
  static constexpr std::size_t kTethers = 4;

  /// Rest positions, 3×n, m: only differences between near vertices matter.
  Points<double> rest;
  /// Masses, kg.
  std::vector<double> mass;
  /// Springs with a stiffness that do not bend.
  std::vector<SurfaceEdge<>> edges;
  std::vector<std::array<int, 3>> triangles;
  /// When each vertex is offered a place on the levels (level_ranks).
  std::vector<int> ranks;
  /// Vertices in the order in which they are offered a place (level_order).
  std::vector<int> order;
  /// Vertices with tethers.
  std::vector<int> tethered;
};

/// Returns for each of n vertices when it is offered a place: 0 pinned, 1 a corner of the boundary
/// (two triangles at most), 2 the rest of the boundary, 3 inside. A mesh that is no surface has the
/// number of its triangles instead. Allocates.
inline std::vector<int> level_ranks(int n, const std::vector<std::array<int, 3>>& triangles,
                                    const std::vector<int>& pinned) {
  std::vector<int> rank(static_cast<std::size_t>(n), 0);
  for (const std::array<int, 3>& t : triangles) {
    for (int v : t) ++rank[static_cast<std::size_t>(v)];
  }
  const Result<Topology> topology = make_topology(n, triangles);
  if (topology) {
    std::vector<unsigned char> boundary(rank.size(), 0);
    for (const MeshEdge& edge : topology.value().edges) {
      if (!edge.is_boundary()) continue;
      for (int v : {edge.a, edge.b}) boundary[static_cast<std::size_t>(v)] = 1;
    }
    for (std::size_t v = 0; v < rank.size(); ++v)
      rank[v] = boundary[v] == 0 ? 3 : (rank[v] <= 2 ? 1 : 2);
  }
  for (int v : pinned) rank[static_cast<std::size_t>(v)] = 0;
  return rank;
}

/// Returns the vertices by rank; within a rank they are scattered, differently for each `set` (0 or
/// 1). Allocates.
inline std::vector<int> level_order(const std::vector<int>& ranks, std::size_t set) {
  struct Place {
    int rank;
    std::uint32_t scattered;
    int vertex;
  };
  std::vector<Place> places;
  places.reserve(ranks.size());
  for (std::size_t v = 0; v < ranks.size(); ++v) {
    // Multiplication by an odd number permutes the 32-bit numbers.
    const std::uint32_t mixed =
        (static_cast<std::uint32_t>(v) + 1u) * (set == 0 ? 2654435761u : 2246822519u);
    places.push_back({ranks[v], mixed ^ (mixed >> 15), static_cast<int>(v)});
  }
  std::sort(places.begin(), places.end(), [](const Place& a, const Place& b) {
    return a.rank != b.rank ? a.rank < b.rank : a.scattered < b.scattered;
  });
  std::vector<int> order;
  order.reserve(places.size());
  for (const Place& place : places) order.push_back(place.vertex);
  return order;
}

/// Returns the input of levels of a network, in the order of the first set. Allocates.
template <RealScalar Scalar>
LevelInput level_input(const SpringNetwork<Scalar>& network, const std::vector<int>& pinned) {
  LevelInput input;
  const int n = static_cast<int>(network.vertex_count());
  input.rest = network.rest_positions.template cast<double>();
  for (Index v = 0; v < n; ++v) input.mass.push_back(static_cast<double>(network.mass[v]));
  for (const Spring<Scalar>& s : network.springs) {
    if (s.kind != SpringKind::Bend && Scalar(0) < s.stiffness)
      input.edges.push_back({s.a, s.b, static_cast<double>(s.rest_length)});
  }
  input.triangles = network.triangles;
  if (pinned.size() <= LevelInput::kTethers) input.tethered = pinned;
  input.ranks = level_ranks(n, network.triangles, pinned);
  input.order = level_order(input.ranks, 0);
  return input;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
