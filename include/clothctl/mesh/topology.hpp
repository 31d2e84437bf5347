#pragma once

// The connectivity of a triangle mesh: every edge once, the edges of the border, the neighbours of
// a vertex, and the hinges (two triangles that share an edge). All lists are sorted, so every run
// gives the same lists for the same mesh.

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// An undirected edge a < b and the one or two triangles that have it.
struct MeshEdge {
  /// The end with the smaller index.
  int a = 0;
  /// The end with the larger index.
  int b = 0;
  /// The triangles that have the edge, ascending. The second is -1 on the border.
  std::array<int, 2> triangle{-1, -1};
  /// The vertex of each triangle that is not on the edge; -1 if there is no triangle.
  std::array<int, 2> opposite{-1, -1};

  /// Returns true when only one triangle has the edge.
  bool is_boundary() const { return triangle[1] < 0; }
};

/// Two triangles that share an edge.
struct Hinge {
  /// The ends a, b of the edge, then the opposite vertices of its first and second triangle.
  std::array<int, 4> vertex{};
  /// Index of the edge.
  int edge = 0;
};

/// The connectivity of a triangle mesh. `make_topology` makes it.
struct Topology {
  /// Every edge once, ascending in (a, b).
  std::vector<MeshEdge> edges;
  /// Indices of the edges with one triangle, ascending.
  std::vector<int> boundary_edges;
  /// One hinge for every edge with two triangles, in edge order.
  std::vector<Hinge> hinges;
  /// The index in `neighbour_list` of the first neighbour of each vertex. There is one entry more
  /// than there are vertices.
  std::vector<int> neighbour_start;
  /// The neighbours of all vertices, vertex by vertex, ascending for each vertex.
  std::vector<int> neighbour_list;
  /// True when the two triangles at each interior edge traverse it in opposite directions, so that
  /// all normals point to the same side of the sheet. False when a triangle is flipped.
  bool consistently_oriented = true;

  /// Returns the vertices that share an edge with `vertex`, ascending.
  std::span<const int> neighbours(int vertex) const {
    const std::size_t v = static_cast<std::size_t>(vertex);
    const std::size_t first = static_cast<std::size_t>(neighbour_start[v]);
    return std::span<const int>(neighbour_list)
        .subspan(first, static_cast<std::size_t>(neighbour_start[v + 1]) - first);
  }
};

namespace detail {

/// Returns why a mesh of these counts is too large (vertices, edges and ends of edges are numbered
/// with ints), or "".
inline std::string bad_mesh_counts(std::int64_t vertices, std::size_t triangles) {
  constexpr std::int64_t most = (std::numeric_limits<int>::max)();
  if (vertices < 0) return "vertex count must not be negative, got " + std::to_string(vertices);
  if (vertices > most)
    return "vertex count must be at most " + std::to_string(most) + ", got " +
           std::to_string(vertices);
  if (triangles > static_cast<std::size_t>(most / 6))
    return "triangle count must be at most " + std::to_string(most / 6) + ", got " +
           std::to_string(triangles);
  return {};
}

/// One side of a triangle.
struct HalfEdge {
  /// The ends of the edge, a < b.
  int a, b;
  int triangle;
  /// The vertex of the triangle that is not on the edge.
  int opposite;
  /// True when the triangle traverses the edge from a to b.
  bool forward;
};

/// Returns the half-edges of all triangles, ascending in (a, b, triangle). Allocates. Complexity:
/// O(n log n). Fails when: a triangle has a vertex off the mesh or twice.
inline Result<std::vector<HalfEdge>> half_edges(std::int64_t vertex_count,
                                                const std::vector<std::array<int, 3>>& triangles) {
  std::vector<HalfEdge> sides;
  sides.reserve(3 * triangles.size());
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const std::array<int, 3>& corner = triangles[t];
    const std::string name = "triangle " + std::to_string(t);
    for (std::size_t i = 0; i < 3; ++i) {
      if (corner[i] < 0 || corner[i] >= vertex_count)
        return Error{name + " holds vertex " + std::to_string(corner[i]) + " off the mesh of " +
                     std::to_string(vertex_count) + " vertices"};
      if (corner[i] == corner[(i + 1) % 3])
        return Error{name + " holds vertex " + std::to_string(corner[i]) + " twice"};
      const int from = corner[i], to = corner[(i + 1) % 3];
      sides.push_back({(std::min)(from, to), (std::max)(from, to), static_cast<int>(t),
                       corner[(i + 2) % 3], from < to});
    }
  }
  std::sort(sides.begin(), sides.end(), [](const HalfEdge& p, const HalfEdge& q) {
    if (p.a != q.a) return p.a < q.a;
    return p.b != q.b ? p.b < q.b : p.triangle < q.triangle;
  });
  return sides;
}

/// Fills edges, border, hinges and orientation from sorted half-edges. Returns why the mesh is not
/// a manifold, or "". Allocates.
inline std::string pair_half_edges(const std::vector<HalfEdge>& sides, Topology& topology) {
  topology.edges.reserve(sides.size() / 2 + 1);
  for (std::size_t i = 0; i < sides.size();) {
    std::size_t end = i + 1;
    while (end < sides.size() && sides[end].a == sides[i].a && sides[end].b == sides[i].b) ++end;
    if (end - i > 2)
      return "edge " + std::to_string(sides[i].a) + "-" + std::to_string(sides[i].b) +
             " is shared by " + std::to_string(end - i) + " triangles, the third is triangle " +
             std::to_string(sides[i + 2].triangle);
    MeshEdge edge;
    edge.a = sides[i].a;
    edge.b = sides[i].b;
    for (std::size_t k = i; k < end; ++k) {
      edge.triangle[k - i] = sides[k].triangle;
      edge.opposite[k - i] = sides[k].opposite;
    }
    const int index = static_cast<int>(topology.edges.size());
    if (edge.is_boundary()) {
      topology.boundary_edges.push_back(index);
    } else {
      if (edge.opposite[0] == edge.opposite[1])
        return "triangle " + std::to_string(edge.triangle[1]) + " repeats triangle " +
               std::to_string(edge.triangle[0]);
      if (sides[i].forward == sides[i + 1].forward) topology.consistently_oriented = false;
      topology.hinges.push_back({{edge.a, edge.b, edge.opposite[0], edge.opposite[1]}, index});
    }
    topology.edges.push_back(edge);
    i = end;
  }
  return {};
}

/// Fills the neighbours of all vertices from the edges, which ascend in (a, b). Allocates.
inline void list_neighbours(std::int64_t vertex_count, Topology& topology) {
  topology.neighbour_start.assign(static_cast<std::size_t>(vertex_count) + 1, 0);
  for (const MeshEdge& edge : topology.edges) {
    ++topology.neighbour_start[static_cast<std::size_t>(edge.a) + 1];
    ++topology.neighbour_start[static_cast<std::size_t>(edge.b) + 1];
  }
  for (std::size_t v = 0; v < static_cast<std::size_t>(vertex_count); ++v)
    topology.neighbour_start[v + 1] += topology.neighbour_start[v];
  topology.neighbour_list.resize(2 * topology.edges.size());
  std::vector<int> next(topology.neighbour_start.begin(), topology.neighbour_start.end() - 1);
  // The first loop writes the smaller neighbours of each vertex in ascending order, the second loop
  // the larger ones.
  for (const MeshEdge& edge : topology.edges)
    topology.neighbour_list[static_cast<std::size_t>(next[static_cast<std::size_t>(edge.b)]++)] =
        edge.a;
  for (const MeshEdge& edge : topology.edges)
    topology.neighbour_list[static_cast<std::size_t>(next[static_cast<std::size_t>(edge.a)]++)] =
        edge.b;
}

}  // namespace detail

/// Finds edges, border, neighbours and hinges of a mesh. A vertex may belong to no triangle; it
/// then has no neighbours. Allocates. Complexity: O(n log n). Fails when: the vertex count is
/// negative or exceeds the range of int, there are more than 357 million triangles, an index is off
/// the mesh, a triangle has a vertex twice or repeats another triangle, or three triangles share an
/// edge.
inline Result<Topology> make_topology(std::int64_t vertex_count,
                                      const std::vector<std::array<int, 3>>& triangles) {
  if (std::string bad = detail::bad_mesh_counts(vertex_count, triangles.size()); !bad.empty())
    return Error{std::move(bad)};
  Result<std::vector<detail::HalfEdge>> made = detail::half_edges(vertex_count, triangles);
  if (!made) return Error{made.error()};
  Topology topology;
  if (std::string bad = detail::pair_half_edges(made.value(), topology); !bad.empty())
    return Error{std::move(bad)};
  detail::list_neighbours(vertex_count, topology);
  return topology;
}

/// Returns the border of a mesh as loops of vertices. A half-edge a -> b of a triangle is on the
/// border when no triangle has b -> a; the loops follow these half-edges, so the mesh is on their
/// left. Each loop starts at its smallest index, and the loops ascend by their first vertex. A
/// closed mesh has none. Allocates. Complexity: O(n log n). Fails when: `make_topology` refuses the
/// mesh, two neighbouring triangles have opposite orientations, or the border passes twice through
/// a vertex.
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
