#pragma once

// The border of a triangle mesh as closed loops. A half-edge a -> b of a triangle is on the border
// when no triangle has b -> a. The loops follow these half-edges, so the mesh is on their left: the
// outer loop of a flat mesh that is counter-clockwise runs counter-clockwise, a hole clockwise.

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/mesh/topology.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Returns the border of a mesh as loops of vertices. Each loop starts at its smallest index, and
/// the loops ascend by their first vertex. A closed mesh has none. Allocates. Complexity: O(n log
/// n). Fails when: `make_topology` refuses the mesh, two neighbouring triangles have opposite
/// orientations, or the border passes twice through a vertex.
inline Result<std::vector<std::vector<int>>> boundary_loops(
    std::int64_t vertex_count, const std::vector<std::array<int, 3>>& triangles) {
  const Result<Topology> topology = make_topology(vertex_count, triangles);
  if (!topology) return Error{topology.error()};
  if (!topology->consistently_oriented)
    return Error{"neighbouring triangles have opposite orientations"};
  std::vector<int> next(static_cast<std::size_t>(vertex_count), -1);
  for (const int index : topology->boundary_edges) {
    const MeshEdge& edge = topology->edges[static_cast<std::size_t>(index)];
    const std::array<int, 3>& t = triangles[static_cast<std::size_t>(edge.triangle[0])];
    std::size_t i = 0;
    while (t[i] != edge.opposite[0]) ++i;
    int& after = next[static_cast<std::size_t>(t[(i + 1) % 3])];
    if (after >= 0)
      return Error{"the border passes twice through vertex " + std::to_string(t[(i + 1) % 3])};
    after = t[(i + 2) % 3];
  }
  std::vector<std::vector<int>> loops;
  for (std::size_t start = 0; start < next.size(); ++start) {
    if (next[start] < 0) continue;
    std::vector<int> loop;
    for (int v = static_cast<int>(start); next[static_cast<std::size_t>(v)] >= 0;) {
      loop.push_back(v);
      v = std::exchange(next[static_cast<std::size_t>(v)], -1);
    }
    loops.push_back(std::move(loop));
  }
  return loops;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
