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
#include <utility>
#include <vector>

#include "clothctl/collision/detail/sheet_tree.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

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
    for (const std::array<int, 2>& e : edges)
      edge_alias_.push_back({alias_of(e[0]), alias_of(e[1])});
    edges_ = edges;
    own(parts, boxes_.build(part_centres<Scalar>(x, parts)));
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
      edge_box_[e] = common_box<Scalar>(box_of(edges_[e][0]), box_of(edges_[e][1]));
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      BoundingBox<Scalar> box = box_of(parts_[i].part.vertex[0]);
      for (std::size_t k = 1; k < 3 && parts_[i].part.vertex[k] >= 0; ++k)
        box = common_box<Scalar>(box, box_of(parts_[i].part.vertex[k]));
      part_box_[i] = box;
    }
    boxes_.fit([this](int i) -> const BoundingBox<Scalar>& {
      return part_box_[static_cast<std::size_t>(i)];
    });
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
    boxes_.for_each_overlap_within([&](int p, int p_end, int q, int q_end) {
      for (int i = p; i < p_end; ++i) {
        const BoundingBox<Scalar>& box = part_box_[static_cast<std::size_t>(i)];
        for (int j = (std::max)(i + 1, q); j < q_end; ++j) {
          if (boxes_overlap(box, part_box_[static_cast<std::size_t>(j)]))
            visit(static_cast<std::size_t>(i), static_cast<std::size_t>(j));
        }
      }
    });
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

  std::vector<int> alias_;
  std::vector<std::array<int, 2>> edges_, edge_alias_;
  std::vector<OwnedPart> parts_;
  std::vector<BoundingBox<Scalar>> vertex_box_, edge_box_, part_box_;
  BoxTree<Scalar, 2> boxes_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
