#pragma once

// A tree of boxes over the triangles and threads of a sheet that is compared with itself: which
// vertices and triangles, and which edges, have boxes that overlap. The tree is made once, from the
// shape at rest; later only its boxes change.
//
// Each vertex and edge belongs to the first part (triangle, thread, single vertex) that has it. A
// pair of parts lists what belongs to them, so each pair of features comes once.

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <utility>
#include <vector>

#include "clothctl/collision/detail/sheet_tree.hpp"
#include "clothctl/core/simd.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns true when the boxes have a point in common. Without branches: most answers are no.
template <RealScalar Scalar>
CLOTHCTL_KERNEL bool boxes_overlap(const BoundingBox<Scalar>& p, const BoundingBox<Scalar>& q) {
  const auto meet = [&](int i) CLOTHCTL_KERNEL_LAMBDA {
    return static_cast<int>(p.lower[i] <= q.upper[i]) & static_cast<int>(q.lower[i] <= p.upper[i]);
  };
  return (meet(0) & meet(1) & meet(2)) != 0;
}

/// A tree of boxes for searches of a sheet in itself. Making it allocates; `fit` and searches never
/// do.
template <RealScalar Scalar>
class SelfTree {
 public:
  /// Makes a tree over the parts of a sheet with positions `x` at rest (3×n) and `edges` as from
  /// `sheet_edges`. Vertices of equal `alias` count as one where features are tested for a common
  /// vertex. Allocates. Complexity: O(n log n).
  SelfTree(const PointsView<Scalar>& x, std::vector<SheetPart> parts,
           const std::vector<std::array<int, 2>>& edges, std::vector<int> alias)
      : alias_(std::move(alias)),
        vertex_box_(static_cast<std::size_t>(x.cols())),
        edge_box_(edges.size()),
        part_box_(parts.size()) {
    const Points<Scalar> centres = part_centres<Scalar>(x, parts);
    std::vector<int> order(parts.size());
    std::iota(order.begin(), order.end(), 0);
    if (!parts.empty()) build(order, 0, static_cast<int>(parts.size()), centres);
    for (const std::array<int, 2>& e : edges)
      edge_alias_.push_back({alias_of(e[0]), alias_of(e[1])});
    edges_ = edges;
    own(parts, order);
  }

  /// Sets the boxes to those of the vertices on their ways from `x` to `y` (3×n), grown by `grow`
  /// (m). Complexity: O(n).
  void fit(const PointsView<Scalar>& x, const PointsView<Scalar>& y, const Scalar& grow) {
    const Vector3<Scalar> by = Vector3<Scalar>::Constant(grow);
    for (std::size_t v = 0; v < vertex_box_.size(); ++v) {
      const Vector3<Scalar> p = x.col(static_cast<Index>(v)), q = y.col(static_cast<Index>(v));
      vertex_box_[v] = {p.cwiseMin(q) - by, p.cwiseMax(q) + by};
    }
    for (std::size_t e = 0; e < edges_.size(); ++e)
      edge_box_[e] = hull(box_of(edges_[e][0]), box_of(edges_[e][1]));
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      BoundingBox<Scalar> box = box_of(parts_[i].part.vertex[0]);
      for (std::size_t k = 1; k < 3 && parts_[i].part.vertex[k] >= 0; ++k)
        box = hull(box, box_of(parts_[i].part.vertex[k]));
      part_box_[i] = box;
    }
    for (std::size_t i = nodes_.size(); i-- > 0;) {
      Node& node = nodes_[i];
      const std::size_t first = static_cast<std::size_t>(node.first);
      if (node.count == 0) {
        node.box = hull(nodes_[i + 1].box, nodes_[first].box);
        continue;
      }
      node.box = part_box_[first];
      for (std::size_t k = 1; k < static_cast<std::size_t>(node.count); ++k)
        node.box = hull(node.box, part_box_[first + k]);
    }
  }

  /// Calls `visit(edges, a, b)` for each pair of features without a common vertex whose boxes
  /// overlap: vertex a and triangle b, or (`edges`) the edges a < b. Never allocates.
  template <class Visit>
  void for_each_pair(const Visit& visit) const {
    for_each_part_pair([&](std::size_t i, std::size_t j) {
      visit_vertices(parts_[i], j, visit);
      visit_vertices(parts_[j], i, visit);
      visit_edges(parts_[i], parts_[j], visit);
    });
  }

  /// Calls `visit(edge, triangle)` for each edge and triangle without a common vertex whose boxes
  /// overlap. Never allocates.
  template <class Visit>
  void for_each_edge_triangle(const Visit& visit) const {
    const auto one_way = [&](const OwnedPart& p, std::size_t j) {
      const OwnedPart& q = parts_[j];
      if (q.part.triangle < 0) return;
      for (std::size_t k = 0; k < 3; ++k) {
        if ((p.edges & (1u << k)) == 0) continue;
        const std::size_t e = static_cast<std::size_t>(p.part.edge[k]);
        if (!boxes_overlap(edge_box_[e], part_box_[j])) continue;
        const auto& [a, b] = edge_alias_[e];
        if (!has(q, a) && !has(q, b)) visit(p.part.edge[k], q.part.triangle);
      }
    };
    for_each_part_pair([&](std::size_t i, std::size_t j) {
      one_way(parts_[i], j);
      one_way(parts_[j], i);
    });
  }

 private:
  static constexpr int kLeafParts = 2;

  struct Node {
    BoundingBox<Scalar> box;
    /// A leaf: its first part. Otherwise the second child; the first is the next node.
    int first = 0;
    /// Parts of a leaf; 0 for an inner node.
    int count = 0;
    /// Parts below the node.
    int parts = 0;
  };
  /// A part, the aliases of its vertices, and bits for the vertices and edges that belong to it.
  struct OwnedPart {
    SheetPart part;
    std::array<int, 3> alias{-1, -1, -1};
    std::uint8_t vertices = 0, edges = 0;
  };

  int alias_of(int v) const { return alias_[static_cast<std::size_t>(v)]; }
  const BoundingBox<Scalar>& box_of(int v) const {
    return vertex_box_[static_cast<std::size_t>(v)];
  }
  static BoundingBox<Scalar> hull(const BoundingBox<Scalar>& p, const BoundingBox<Scalar>& q) {
    return {p.lower.cwiseMin(q.lower), p.upper.cwiseMax(q.upper)};
  }
  static bool has(const OwnedPart& p, int alias) {
    return p.alias[0] == alias || p.alias[1] == alias || p.alias[2] == alias;
  }

  template <class Visit>
  void visit_vertices(const OwnedPart& p, std::size_t j, const Visit& visit) const {
    const OwnedPart& q = parts_[j];
    if (q.part.triangle < 0) return;
    for (std::size_t k = 0; k < 3; ++k) {
      if ((p.vertices & (1u << k)) == 0 || has(q, p.alias[k])) continue;
      if (boxes_overlap(box_of(p.part.vertex[k]), part_box_[j]))
        visit(false, p.part.vertex[k], q.part.triangle);
    }
  }
  template <class Visit>
  void visit_edges(const OwnedPart& p, const OwnedPart& q, const Visit& visit) const {
    for (std::size_t k = 0; k < 3; ++k) {
      if ((p.edges & (1u << k)) == 0) continue;
      const std::size_t e = static_cast<std::size_t>(p.part.edge[k]);
      const auto& [a, b] = edge_alias_[e];
      for (std::size_t l = 0; l < 3; ++l) {
        if ((q.edges & (1u << l)) == 0) continue;
        const std::size_t f = static_cast<std::size_t>(q.part.edge[l]);
        const auto& [c, d] = edge_alias_[f];
        if (a == c || a == d || b == c || b == d) continue;
        if (!boxes_overlap(edge_box_[e], edge_box_[f])) continue;
        visit(true, (std::min)(p.part.edge[k], q.part.edge[l]),
              (std::max)(p.part.edge[k], q.part.edge[l]));
      }
    }
  }

  /// Calls `visit(i, j)`, i < j, for each pair of parts whose boxes overlap.
  template <class Visit>
  void for_each_part_pair(const Visit& visit) const {
    // A step down takes one entry and adds up to three, and the tree is at most 32 deep.
    std::array<std::array<int, 2>, 256> stack;
    std::size_t size = 0;
    if (!nodes_.empty()) stack[size++] = {0, 0};
    while (size > 0) {
      const auto [a, b] = stack[--size];
      const Node &p = nodes_[static_cast<std::size_t>(a)], &q = nodes_[static_cast<std::size_t>(b)];
      if (a == b) {
        if (p.count > 0) {
          visit_leaves(p, p, visit);
          continue;
        }
        stack[size++] = {p.first, p.first};
        stack[size++] = {a + 1, p.first};
        stack[size++] = {a + 1, a + 1};
        continue;
      }
      if (!boxes_overlap(p.box, q.box)) continue;
      if (p.count > 0 && q.count > 0) {
        visit_leaves(p, q, visit);
      } else if (q.count > 0 || (p.count == 0 && p.parts >= q.parts)) {
        stack[size++] = {p.first, b};
        stack[size++] = {a + 1, b};
      } else {
        stack[size++] = {a, q.first};
        stack[size++] = {a, b + 1};
      }
    }
  }
  template <class Visit>
  void visit_leaves(const Node& p, const Node& q, const Visit& visit) const {
    for (int i = p.first; i < p.first + p.count; ++i) {
      const BoundingBox<Scalar>& box = part_box_[static_cast<std::size_t>(i)];
      for (int j = (std::max)(i + 1, q.first); j < q.first + q.count; ++j) {
        if (boxes_overlap(box, part_box_[static_cast<std::size_t>(j)]))
          visit(static_cast<std::size_t>(i), static_cast<std::size_t>(j));
      }
    }
  }

  /// Takes the parts in the order of the tree and gives each vertex and edge to the first.
  void own(const std::vector<SheetPart>& parts, const std::vector<int>& order) {
    std::vector<bool> vertex_taken(vertex_box_.size()), edge_taken(edges_.size());
    for (const int i : order) {
      OwnedPart out;
      out.part = parts[static_cast<std::size_t>(i)];
      for (std::size_t k = 0; k < 3; ++k) {
        const int v = out.part.vertex[k], e = out.part.edge[k];
        const std::uint8_t bit = static_cast<std::uint8_t>(1u << k);
        if (v >= 0) out.alias[k] = alias_of(v);
        if (v >= 0 && !vertex_taken[static_cast<std::size_t>(v)]) {
          vertex_taken[static_cast<std::size_t>(v)] = true;
          out.vertices = static_cast<std::uint8_t>(out.vertices | bit);
        }
        if (e >= 0 && !edge_taken[static_cast<std::size_t>(e)]) {
          edge_taken[static_cast<std::size_t>(e)] = true;
          out.edges = static_cast<std::uint8_t>(out.edges | bit);
        }
      }
      parts_.push_back(out);
    }
  }

  void build(std::vector<int>& order, int begin, int end, const Points<Scalar>& centres) {
    const std::size_t self = nodes_.size();
    nodes_.push_back({});
    nodes_[self].parts = end - begin;
    if (end - begin <= kLeafParts) {
      nodes_[self].first = begin;
      nodes_[self].count = end - begin;
      return;
    }
    const int middle = split_along_longest_axis(centres, order, begin, end);
    build(order, begin, middle, centres);
    nodes_[self].first = static_cast<int>(nodes_.size());
    build(order, middle, end, centres);
  }

  std::vector<int> alias_;
  std::vector<std::array<int, 2>> edges_, edge_alias_;
  std::vector<OwnedPart> parts_;
  std::vector<BoundingBox<Scalar>> vertex_box_, edge_box_, part_box_;
  std::vector<Node> nodes_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
