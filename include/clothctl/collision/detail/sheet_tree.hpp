#pragma once

// A tree of boxes over the parts of a sheet: triangles, edges of no triangle (threads), and
// vertices of neither. The tree is made once, from the sheet's shape at rest; later only its boxes
// change.

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/collision/detail/box_tree.hpp"
#include "clothctl/mesh/topology.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A part of a sheet.
struct SheetPart {
  /// Its vertices; unused entries are -1.
  std::array<int, 3> vertex{-1, -1, -1};
  /// Its edges: of a triangle, 0-1, 1-2 and 2-0; unused entries are -1.
  std::array<int, 3> edge{-1, -1, -1};
  /// Index of the triangle; -1 for a thread or a vertex.
  int triangle = -1;

  /// Returns the number of vertices.
  int count() const { return vertex[1] < 0 ? 1 : (vertex[2] < 0 ? 2 : 3); }
};

/// Returns the edges of a sheet, ascending: those of its triangles and the threads. Allocates.
inline std::vector<std::array<int, 2>> sheet_edges(const std::vector<std::array<int, 3>>& triangles,
                                                   const std::vector<std::array<int, 2>>& threads) {
  std::vector<std::array<int, 2>> edges;
  for (const std::array<int, 3>& t : triangles) {
    for (std::size_t i = 0; i < 3; ++i) edges.push_back({t[i], t[(i + 1) % 3]});
  }
  edges.insert(edges.end(), threads.begin(), threads.end());
  for (std::array<int, 2>& e : edges) {
    if (e[1] < e[0]) std::swap(e[0], e[1]);
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

/// Returns the parts of a sheet: triangles, then threads, then single vertices. Allocates.
inline std::vector<SheetPart> sheet_parts(int vertex_count,
                                          const std::vector<std::array<int, 3>>& triangles,
                                          const std::vector<std::array<int, 2>>& edges) {
  std::vector<SheetPart> parts;
  std::vector<bool> vertex_used(static_cast<std::size_t>(vertex_count), false);
  std::vector<bool> edge_used(edges.size(), false);
  const auto add = [&](SheetPart part) {
    const int count = part.count();
    for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
      vertex_used[static_cast<std::size_t>(part.vertex[i])] = true;
      if (count == 1 || (count == 2 && i == 1)) continue;
      std::array<int, 2> key{part.vertex[i], part.vertex[(i + 1) % 3]};
      if (key[1] < key[0]) std::swap(key[0], key[1]);
      const auto at = std::lower_bound(edges.begin(), edges.end(), key);
      const std::size_t e = static_cast<std::size_t>(at - edges.begin());
      part.edge[i] = static_cast<int>(e);
      edge_used[e] = true;
    }
    parts.push_back(part);
  };
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    SheetPart part;
    part.vertex = triangles[t];
    part.triangle = static_cast<int>(t);
    add(part);
  }
  for (std::size_t e = 0; e < edges.size(); ++e) {
    SheetPart part;
    part.vertex = {edges[e][0], edges[e][1], -1};
    if (!edge_used[e]) add(part);
  }
  for (int v = 0; v < vertex_count; ++v) {
    SheetPart part;
    part.vertex = {v, -1, -1};
    if (!vertex_used[static_cast<std::size_t>(v)]) add(part);
  }
  return parts;
}

/// Returns the means of the vertices of the parts of a sheet with positions `x` (3×n, m).
/// Allocates.
template <RealScalar Scalar>
Points<Scalar> part_centres(const PointsView<Scalar>& x, const std::vector<SheetPart>& parts) {
  Points<Scalar> centres(3, static_cast<Index>(parts.size()));
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const SheetPart& part = parts[i];
    Vector3<Scalar> sum = x.col(part.vertex[0]);
    for (int k = 1; k < part.count(); ++k) sum += x.col(part.vertex[static_cast<std::size_t>(k)]);
    centres.col(static_cast<Index>(i)) = sum / Scalar(static_cast<double>(part.count()));
  }
  return centres;
}

/// The tree of boxes.
template <RealScalar Scalar>
class SheetTree {
 public:
  /// Sorts the parts by the sheet's shape `x` (3×n, m). Allocates. Complexity: O(n log n).
  SheetTree(const PointsView<Scalar>& x, const std::vector<SheetPart>& parts) {
    parts_ = in_order(parts, boxes_.build(part_centres<Scalar>(x, parts)));
  }

  /// The parts, in the order of the tree.
  const std::vector<SheetPart>& parts() const { return parts_; }

  /// Fits the boxes to the positions `x` and `y` (3×n, m), the start and the end of a motion. Never
  /// allocates. Complexity: O(n).
  void fit(const PointsView<Scalar>& x, const PointsView<Scalar>& y) {
    boxes_.fit([&](int k) {
      const std::array<int, 3>& vertex = parts_[static_cast<std::size_t>(k)].vertex;
      BoundingBox<Scalar> box = way_box(x, y, vertex[0]);
      for (std::size_t i = 1; i < 3 && 0 <= vertex[i]; ++i)
        box = common_box<Scalar>(box, way_box(x, y, vertex[i]));
      return box;
    });
  }

  /// Calls `visit(first, count)` for ranges of parts whose common box overlaps `box`, in the order
  /// of the tree. Never allocates.
  template <class Visit>
  void for_each_overlap(const BoundingBox<Scalar>& box, const Visit& visit) const {
    boxes_.for_each_overlap(box, visit);
  }

 private:
  /// Returns the box of the way of a vertex.
  static BoundingBox<Scalar> way_box(const PointsView<Scalar>& x, const PointsView<Scalar>& y,
                                     int v) {
    return {x.col(v).cwiseMin(y.col(v)), x.col(v).cwiseMax(y.col(v))};
  }

  std::vector<SheetPart> parts_;
  BoxTree<Scalar> boxes_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
