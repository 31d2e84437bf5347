#pragma once

// Where the triangles and edges of a changed mesh lie in the old one. Corner i of a new triangle is
// c'_i = Σ_k B_ik c_k, with c_k the corners of its parent (remap.hpp). Then
//
//   area                 A' = A det B, with A the area of the parent
//   side from i to j     on the edge of the parent opposite to its corner k if B_ik = B_jk = 0, and
//                        the whole of it if both ends are corners of the parent; else inside it
//   length of a side     |Σ_k (B_ik - B_jk) c_k|, with the corners c_k at rest
//
// An old edge continues as undivided edges where it is neither cut through nor divided by a new
// vertex; if it has opened, as two. A hinge lives while its triangles are whole and share their
// edge, a row of three vertices while its two edges are undivided and meet at the same copy of the
// vertex between.

#include <algorithm>
#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "clothctl/mesh/mesh_editor.hpp"
#include "clothctl/network/detail/old_network.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// An edge of the changed mesh as a side of one of its triangles, and where it lies in the parent
/// of the triangle.
template <RealScalar Scalar>
struct NewSide {
  /// The new triangle; -1 if there is none.
  int triangle = -1;
  /// The old edge that it is on; -1 inside the parent.
  int old_edge = -1;
  /// True when it is the whole old edge.
  bool undivided = false;
  /// True when the new edge, from its end a to b, runs as the old edge does.
  bool forward = true;
  /// Length at rest in the parent, m.
  Scalar length = Scalar(0);
};

/// Where the triangles and edges of a changed mesh lie in the old one.
template <RealScalar Scalar>
class MeshCorrespondence {
 public:
  using Side = NewSide<Scalar>;
  /// New vertices (a', m', b') of a row.
  using Row = std::array<int, 3>;

  /// Takes an old network, the change of its mesh and the topology of the changed mesh; all must
  /// outlive this. Allocates. Complexity: O(n log n).
  MeshCorrespondence(const OldNetwork<Scalar>& old, const MeshChange<Scalar>& change,
                     const Topology& topology)
      : old_(old), change_(change) {
    for (int t = 0; t < static_cast<int>(change.triangles.size()); ++t)
      areas_.push_back(old.triangle(parent(t)).area * area_share(change.remap.corners(t)));
    undivided_.resize(old.topology().edges.size());
    for (const MeshEdge& edge : topology.edges) {
      std::array<Side, 2> sides;
      for (std::size_t i = 0; i < 2; ++i) {
        if (edge.triangle[i] < 0) continue;
        sides[i] = locate(edge.triangle[i], edge);
        if (sides[i].undivided) add_undivided(sides[i], edge);
      }
      sides_.push_back(sides);
    }
  }

  /// Returns the corners of a new triangle.
  const std::array<int, 3>& triangle(int t) const { return change_.triangles[index(t)]; }
  /// Returns the old triangle that a new one is a part of.
  int parent(int t) const { return change_.remap.parent(t); }
  /// Returns the corners of the parent of a new triangle.
  const std::array<int, 3>& parent_corners(int t) const { return old_triangle(parent(t)); }
  /// Returns true when a new triangle is its parent unchanged.
  bool whole(int t) const { return is_whole(change_.remap.corners(t)); }
  /// Returns the area of a new triangle at rest in its parent, m².
  const Scalar& area(int t) const { return areas_[index(t)]; }

  /// Returns the sides of the triangles at an edge of the changed mesh, in the order of
  /// `MeshEdge::triangle`; the triangle of the second one is -1 on the border.
  const std::array<Side, 2>& sides(std::size_t edge) const { return sides_[edge]; }

  /// Returns true when an edge of the changed mesh and its triangles are as they were.
  bool kept(std::size_t edge) const {
    const Side &one = sides_[edge][0], &two = sides_[edge][1];
    if (one.old_edge < 0 || !whole(one.triangle)) return false;
    const bool was_border = old_.topology().edges[index(one.old_edge)].is_boundary();
    if (two.triangle < 0) return was_border;
    return !was_border && two.old_edge == one.old_edge && whole(two.triangle);
  }

  /// Returns the new vertex that an old vertex of the triangles at a kept edge has become; the
  /// first copy of any other vertex.
  int kept_vertex(std::size_t edge, int old_vertex) const {
    for (const Side& side : sides_[edge]) {
      if (side.triangle < 0) continue;
      const std::array<int, 3>& from = parent_corners(side.triangle);
      for (std::size_t i = 0; i < 3; ++i) {
        if (from[i] == old_vertex) return triangle(side.triangle)[i];
      }
    }
    return change_.remap.first_copy(old_vertex);
  }

  /// Returns the new rows along undivided copies of the old edges a-m and m-b, which must exist.
  /// Allocates.
  std::vector<Row> rows_through(int a, int m, int b) const {
    std::vector<Row> rows;
    const auto& one = undivided_[index(old_.find_edge(a, m))];
    const auto& two = undivided_[index(old_.find_edge(m, b))];
    const std::size_t middle_one = a < m ? 1 : 0, middle_two = b < m ? 1 : 0;
    for (const std::array<int, 2>& p : one) {
      for (const std::array<int, 2>& q : two) {
        if (p[middle_one] == q[middle_two])
          rows.push_back({p[1 - middle_one], p[middle_one], q[1 - middle_two]});
      }
    }
    return rows;
  }

  /// Returns the share of a row in those of `rows` that meet at its middle vertex: 1 or less.
  static double share(const std::vector<Row>& rows, const Row& row) {
    const auto sharing = std::count_if(rows.begin(), rows.end(),
                                       [&row](const Row& other) { return other[1] == row[1]; });
    return 1.0 / static_cast<double>(sharing);
  }

  /// Returns the new vertices opposite to an old edge, in the order of `MeshEdge::opposite`, when
  /// both of its triangles are whole and still share it; else none.
  std::optional<std::array<int, 2>> living_hinge(int old_edge) const {
    const MeshEdge& edge = old_.topology().edges[index(old_edge)];
    if (edge.is_boundary()) return std::nullopt;
    std::array<std::array<int, 2>, 2> ends{};
    std::array<int, 2> opposite{};
    for (std::size_t i = 0; i < 2; ++i) {
      const auto children = change_.remap.children(edge.triangle[i]);
      if (children.size() != 1) return std::nullopt;
      const std::array<int, 3>&from = old_triangle(edge.triangle[i]), &to = triangle(children[0]);
      ends[i] = {to[corner_of(from, edge.a)], to[corner_of(from, edge.b)]};
      opposite[i] = to[corner_of(from, edge.opposite[i])];
    }
    if (ends[0] != ends[1]) return std::nullopt;
    return opposite;
  }

  /// Returns true when a new triangle, at rest in its parent, has an area beyond rounding.
  bool has_area(int t) const {
    const Vector3<Scalar> x = place(t, 0), u = place(t, 1) - x, w = place(t, 2) - x;
    const Scalar rounding = Scalar(16.0) * scalar_traits<Scalar>::epsilon();
    return rounding * (u.squaredNorm() + w.squaredNorm()) < u.cross(w).norm();
  }

  /// Returns the cotangent of the angle of a new triangle at one of its vertices, at rest in its
  /// parent; 0 when the triangle has no area.
  Scalar cotangent(int t, int vertex) const {
    const std::size_t i = corner_of(triangle(t), vertex);
    const Vector3<Scalar> x = place(t, i);
    const Vector3<Scalar> u = place(t, (i + 1) % 3) - x, w = place(t, (i + 2) % 3) - x;
    return has_area(t) ? Scalar(u.dot(w) / u.cross(w).norm()) : Scalar(0);
  }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  const std::array<int, 3>& old_triangle(int t) const { return old_.network().triangles[index(t)]; }
  static std::size_t corner_of(const std::array<int, 3>& corner, int vertex) {
    return corner[0] == vertex ? 0 : (corner[1] == vertex ? 1 : 2);
  }

  /// Returns the place of a corner of a new triangle in the rest shape of its parent.
  Vector3<Scalar> place(int t, std::size_t corner) const {
    const std::array<Scalar, 3>& weight = change_.remap.corners(t)[corner];
    Vector3<Scalar> sum = Vector3<Scalar>::Zero();
    for (std::size_t k = 0; k < 3; ++k)
      sum += weight[k] * old_.network().rest_positions.col(parent_corners(t)[k]);
    return sum;
  }

  /// Returns where a side of a new triangle lies in the parent.
  Side locate(int t, const MeshEdge& edge) const {
    const CornerWeights<Scalar>& weight = change_.remap.corners(t);
    const std::array<int, 3>& corners = parent_corners(t);
    const std::size_t i = corner_of(triangle(t), edge.a), j = corner_of(triangle(t), edge.b);
    Side side;
    side.triangle = t;
    side.length = (place(t, i) - place(t, j)).norm();
    for (std::size_t k = 0; k < 3; ++k) {
      const bool off = Scalar(0) < weight[i][k] || Scalar(0) < weight[j][k];
      if (off) continue;
      const std::size_t p = (k + 1) % 3, q = (k + 2) % 3;
      side.old_edge = old_.find_edge(corners[p], corners[q]);
      const auto is_corner = [&](std::size_t corner) {
        return !(weight[corner][p] < Scalar(1)) || !(weight[corner][q] < Scalar(1));
      };
      side.undivided = is_corner(i) && is_corner(j);
      side.forward = (weight[j][p] < weight[i][p]) == (corners[p] < corners[q]);
      break;
    }
    return side;
  }

  void add_undivided(const Side& side, const MeshEdge& edge) {
    std::array<int, 2> ends{edge.a, edge.b};
    if (!side.forward) std::swap(ends[0], ends[1]);
    std::vector<std::array<int, 2>>& copies = undivided_[index(side.old_edge)];
    if (std::find(copies.begin(), copies.end(), ends) == copies.end()) copies.push_back(ends);
  }

  const OldNetwork<Scalar>& old_;
  const MeshChange<Scalar>& change_;
  std::vector<Scalar> areas_;
  std::vector<std::array<Side, 2>> sides_;
  /// For each old edge, its undivided copies as (copy of a, copy of b).
  std::vector<std::vector<std::array<int, 2>>> undivided_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
