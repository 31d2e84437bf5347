#pragma once

// Joins vertices on the border of a mesh: the reverse of a tear, and the end of a seam. Vertices
// that are joined become one, at the weighted mean of their places (weights w, for example their
// masses, which keeps the centre of mass and the momentum):
//
//   x' = Σ w_i x_i / Σ w_i
//
// Where both ends of two border edges are joined, the edges become one inner edge.

#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/mesh/mesh_editor.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Marks the vertices that are on an edge with one triangle.
inline std::vector<bool> border_vertices(std::int64_t vertex_count, const Topology& topology) {
  std::vector<bool> border(static_cast<std::size_t>(vertex_count), false);
  for (const int e : topology.boundary_edges) {
    const MeshEdge& edge = topology.edges[static_cast<std::size_t>(e)];
    border[static_cast<std::size_t>(edge.a)] = border[static_cast<std::size_t>(edge.b)] = true;
  }
  return border;
}

/// Returns what is wrong with the pairs of a seam, or "".
template <RealScalar Scalar>
std::string check_pairs(const std::vector<std::array<int, 2>>& pairs,
                        const std::vector<bool>& border, const VectorX<Scalar>& weights) {
  const std::string count = std::to_string(border.size());
  if (weights.size() != 0 && weights.size() != static_cast<Index>(border.size()))
    return "there are " + std::to_string(weights.size()) + " weights for " + count + " vertices";
  for (Index v = 0; v < weights.size(); ++v) {
    if (!is_finite(weights[v]) || !(Scalar(0) < weights[v]))
      return "weight of vertex " + std::to_string(v) + " must be positive, got " +
             number_text(weights[v]);
  }
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const std::string name = "pair " + std::to_string(i) + ": ";
    for (const int v : pairs[i]) {
      if (v < 0 || v >= static_cast<int>(border.size()))
        return name + "vertex " + std::to_string(v) + " is off the mesh of " + count + " vertices";
      if (!border[static_cast<std::size_t>(v)])
        return name + "vertex " + std::to_string(v) + " is not on the border";
    }
    if (pairs[i][0] == pairs[i][1])
      return name + "vertex " + std::to_string(pairs[i][0]) + " is paired with itself";
  }
  return {};
}

/// Returns the lowest vertex of the group that each vertex belongs to.
inline std::vector<int> joined_groups(std::size_t count,
                                      const std::vector<std::array<int, 2>>& pairs) {
  std::vector<int> root(count);
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&root](int v) {
    while (root[static_cast<std::size_t>(v)] != v) v = root[static_cast<std::size_t>(v)];
    return v;
  };
  for (const std::array<int, 2>& pair : pairs) {
    const int a = find(pair[0]), b = find(pair[1]);
    root[static_cast<std::size_t>((std::max)(a, b))] = (std::min)(a, b);
  }
  for (int v = 0; v < static_cast<int>(count); ++v) root[static_cast<std::size_t>(v)] = find(v);
  return root;
}

}  // namespace detail

/// Joins pairs of border vertices; a vertex in several pairs joins them all. The vertices that
/// remain keep their order, and a joined vertex has the place of its lowest index. `weights` (n,
/// positive) are those of the mean; none means equal weights. Allocates. Complexity: O(n log n).
/// Fails when: a vertex of a pair is off the mesh, not on the border or paired with itself, a
/// weight is not positive and finite, a triangle would lose a corner, or `make_topology` refuses
/// the mesh, before or afterwards.
template <RealScalar Scalar>
Result<MeshChange<Scalar>> stitch_vertices(std::int64_t vertex_count,
                                           const std::vector<std::array<int, 3>>& triangles,
                                           const std::vector<std::array<int, 2>>& pairs,
                                           const VectorX<Scalar>& weights = {}) {
  const Result<Topology> topology = make_topology(vertex_count, triangles);
  if (!topology) return Error{topology.error()};
  const std::vector<bool> border = detail::border_vertices(vertex_count, topology.value());
  if (std::string problem = detail::check_pairs(pairs, border, weights); !problem.empty())
    return Error{std::move(problem)};
  const std::vector<int> root = detail::joined_groups(border.size(), pairs);
  std::vector<int> number(root.size(), -1);
  std::vector<std::vector<VertexShare<Scalar>>> origins;
  for (std::size_t v = 0; v < root.size(); ++v) {
    if (root[v] == static_cast<int>(v)) {
      number[v] = static_cast<int>(origins.size());
      origins.emplace_back();
    }
    number[v] = number[static_cast<std::size_t>(root[v])];
    origins[static_cast<std::size_t>(number[v])].push_back(
        {static_cast<int>(v), weights.size() == 0 ? Scalar(1) : weights[static_cast<Index>(v)]});
  }

  typename Remap<Scalar>::Tables tables;
  for (std::vector<VertexShare<Scalar>>& origin : origins) {
    Scalar sum = Scalar(0);
    for (const VertexShare<Scalar>& share : origin) sum += share.weight;
    for (const VertexShare<Scalar>& share : origin)
      tables.origins.items.push_back(
          {share.vertex, origin.size() == 1 ? Scalar(1) : Scalar(share.weight / sum)});
    tables.origins.close();
  }
  MeshChange<Scalar> change;
  for (const int v : number) {
    tables.copies.items.push_back(v);
    tables.copies.close();
  }
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    std::array<int, 3> corner{};
    for (std::size_t i = 0; i < 3; ++i)
      corner[i] = number[static_cast<std::size_t>(triangles[t][i])];
    for (std::size_t i = 0; i < 3; ++i) {
      if (corner[i] == corner[(i + 1) % 3])
        return Error{"stitching joins two corners of triangle " + std::to_string(t) +
                     ": vertices " + std::to_string(triangles[t][i]) + " and " +
                     std::to_string(triangles[t][(i + 1) % 3])};
    }
    change.triangles.push_back(corner);
    tables.parents.push_back(static_cast<int>(t));
  }
  tables.corners.assign(triangles.size(), whole_triangle<Scalar>());
  tables.old_triangles = static_cast<Index>(triangles.size());
  const Result<Topology> joined =
      make_topology(static_cast<std::int64_t>(origins.size()), change.triangles);
  if (!joined) return Error{"stitching: " + joined.error()};
  change.remap = Remap<Scalar>(std::move(tables));
  return change;
}

/// Returns the pairs of border vertices that are closer to each other than `tolerance` (m): what
/// `stitch_vertices` needs to close a cut in the rest positions (3×n, m). Pairs ascend in (first,
/// second). Vertices of one triangle are no pair. Allocates. Complexity: O(n log n) when few
/// vertices have the same x. Fails when: `make_topology` refuses the mesh, a position is not
/// finite, or the tolerance is negative or not finite.
template <RealScalar Scalar>
Result<std::vector<std::array<int, 2>>> coincident_border_vertices(
    const std::type_identity_t<PointsView<Scalar>>& positions,
    const std::vector<std::array<int, 3>>& triangles, const Scalar& tolerance) {
  const Result<Topology> topology = make_topology(positions.cols(), triangles);
  if (!topology) return Error{topology.error()};
  if (!is_finite(tolerance) || tolerance < Scalar(0))
    return Error{"tolerance must not be negative, got " + number_text(tolerance)};
  const std::vector<bool> border = detail::border_vertices(positions.cols(), topology.value());
  std::vector<int> order;
  for (int v = 0; v < static_cast<int>(positions.cols()); ++v) {
    if (!all_finite(positions.col(v)))
      return Error{"position of vertex " + std::to_string(v) + " is not finite"};
    if (border[static_cast<std::size_t>(v)]) order.push_back(v);
  }
  std::sort(order.begin(), order.end(), [&positions](int a, int b) {
    if (positions(0, a) < positions(0, b)) return true;
    return !(positions(0, b) < positions(0, a)) && a < b;
  });
  std::vector<std::array<int, 2>> pairs;
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (std::size_t j = i + 1; j < order.size(); ++j) {
      const int a = (std::min)(order[i], order[j]), b = (std::max)(order[i], order[j]);
      if (tolerance < positions(0, order[j]) - positions(0, order[i])) break;
      const Vector3<Scalar> gap = positions.col(b) - positions.col(a);
      if (tolerance * tolerance < gap.squaredNorm()) continue;
      const std::span<const int> beside = topology.value().neighbours(a);
      if (!std::binary_search(beside.begin(), beside.end(), b)) pairs.push_back({a, b});
    }
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
