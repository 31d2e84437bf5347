#pragma once

// Moves a spring network to a changed mesh. network_change.hpp states the rules.

#include <algorithm>
#include <array>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

#include "clothctl/mesh/mesh_editor.hpp"
#include "clothctl/network/detail/mesh_correspondence.hpp"
#include "clothctl/network/detail/old_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A spring and its place in the order of the new network.
template <RealScalar Scalar>
struct OrderedSpring {
  std::size_t order = 0;
  Spring<Scalar> spring;
};

/// Moves a network to a changed mesh.
template <RealScalar Scalar>
class NetworkTransfer {
 public:
  /// Takes an old network, the change of its mesh, the changed mesh's topology, and 1 for every
  /// spring to leave out; all must outlive this. Allocates.
  NetworkTransfer(const OldNetwork<Scalar>& old, const MeshChange<Scalar>& change,
                  const Topology& topology, const std::vector<unsigned char>& removed)
      : old_(old),
        change_(change),
        topology_(topology),
        removed_(removed),
        mesh_(old, change, topology) {}

  /// Returns the new network. Allocates. Complexity: O(n log n).
  SpringNetwork<Scalar> run() {
    out_.rest_positions = change_.remap.interpolate(old_.network().rest_positions);
    out_.triangles = change_.triangles;
    move_mass();
    for (std::size_t e = 0; e < topology_.edges.size(); ++e) move_edge_springs(e);
    for (const int s : old_.free_springs()) move_free_spring(s);
    std::stable_sort(springs_.begin(), springs_.end(),
                     [](const OrderedSpring<Scalar>& a, const OrderedSpring<Scalar>& b) {
                       return a.order < b.order;
                     });
    for (const OrderedSpring<Scalar>& s : springs_) out_.springs.push_back(s.spring);
    move_rows();
    for (const int b : old_.free_stencils()) move_free_stencil(b);
    for (std::size_t e = 0; e < topology_.edges.size(); ++e) move_hinge(e);
    return std::move(out_);
  }

 private:
  using Mesh = MeshCorrespondence<Scalar>;
  using Side = NewSide<Scalar>;
  using Row = typename Mesh::Row;
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  const Spring<Scalar>& old_spring(int s) const { return old_.network().springs[index(s)]; }
  const BendStencil<Scalar>& old_stencil(int b) const { return old_.network().bends[index(b)]; }
  /// Each old vertex gives its mass to its triangles by their area; a divided triangle spreads what
  /// it got evenly.
  void move_mass() {
    const VectorX<Scalar>& mass = old_.network().mass;
    const auto given = [&](int v, int parent) {
      const Scalar around = old_.area_around(v);
      if (Scalar(0) < around) return Scalar(mass[v] * old_.triangle(parent).area / around);
      return Scalar(mass[v] / Scalar(static_cast<double>(old_.count_around(v))));
    };
    out_.mass = VectorX<Scalar>::Zero(out_.rest_positions.cols());
    std::vector<bool> touched(index(static_cast<int>(out_.mass.size())), false);
    for (int t = 0; t < static_cast<int>(change_.triangles.size()); ++t) {
      const int parent = mesh_.parent(t);
      const std::array<int, 3>& from = mesh_.parent_corners(t);
      Scalar all = Scalar(0);
      for (const int v : from) all += given(v, parent);
      const Scalar part = all * area_share(change_.remap.corners(t)) / Scalar(3.0);
      for (std::size_t i = 0; i < 3; ++i) {
        const int v = mesh_.triangle(t)[i];
        out_.mass[v] += mesh_.whole(t) ? given(from[i], parent) : part;
        if (!mesh_.whole(t)) touched[index(v)] = true;
      }
    }
    for (int v = 0; v < static_cast<int>(mass.size()); ++v) {
      const int first = change_.remap.first_copy(v);
      if (old_.count_around(v) == 0) {
        out_.mass[first] += mass[v];
      } else if (change_.remap.copies(v).size() == 1 && change_.remap.origin(first).size() == 1 &&
                 !touched[index(first)]) {
        out_.mass[first] = mass[v];  // the same bits
      }
    }
  }

  /// Gives an edge of the new mesh its share of the springs of old edges and triangles. Springs of
  /// one kind become one.
  void move_edge_springs(std::size_t e) {
    const MeshEdge& edge = topology_.edges[e];
    const std::size_t first = springs_.size(), last_order = old_.network().springs.size() + e;
    for (const Side& side : mesh_.sides(e)) {
      if (side.triangle < 0) continue;
      if (side.old_edge < 0) {
        const TriangleContent<Scalar>& parent = old_.triangle(mesh_.parent(side.triangle));
        if (!(Scalar(0) < parent.stretch)) continue;
        Spring<Scalar> spring;
        spring.stiffness = parent.stretch * mesh_.area(side.triangle) / (side.length * side.length);
        spring.damping = parent.damping_time * spring.stiffness;
        spring.rest_length = parent.slack * side.length;
        add_spring_part(first, last_order, edge, spring);
        continue;
      }
      const EdgeContent<Scalar>& content = old_.edge(side.old_edge);
      for (const int s : content.springs) {
        if (removed_[index(s)] != 0) continue;
        Spring<Scalar> spring = old_spring(s);
        if (mesh_.kept(e)) {
          spring.a = mesh_.kept_vertex(e, spring.a);
          spring.b = mesh_.kept_vertex(e, spring.b);
          if (side.triangle == mesh_.sides(e)[0].triangle) springs_.push_back({index(s), spring});
          continue;
        }
        const Scalar longer = side.length / content.length;
        const Scalar part = mesh_.area(side.triangle) / content.area / (longer * longer);
        spring.stiffness *= part;
        spring.damping *= part;
        spring.rest_length *= longer;
        add_spring_part(first, index(s), edge, spring);
      }
    }
  }

  void add_spring_part(std::size_t first, std::size_t order, const MeshEdge& edge,
                       Spring<Scalar> part) {
    for (std::size_t i = first; i < springs_.size(); ++i) {
      Spring<Scalar>& sum = springs_[i].spring;
      if (sum.kind != part.kind) continue;
      const Scalar all = sum.stiffness + part.stiffness;
      if (Scalar(0) < all)
        sum.rest_length =
            (sum.stiffness * sum.rest_length + part.stiffness * part.rest_length) / all;
      sum.stiffness = all;
      sum.damping += part.damping;
      return;
    }
    part.a = edge.a;
    part.b = edge.b;
    springs_.push_back({order, part});
  }

  void add_free_spring(int s, int a, int b, double share = 1.0) {
    if (a == b) return;
    Spring<Scalar> spring = old_spring(s);
    spring.a = a;
    spring.b = b;
    if (share < 1.0) {
      spring.stiffness *= Scalar(share);
      spring.damping *= Scalar(share);
    }
    springs_.push_back({index(s), spring});
  }

  /// Moves a spring that is on no edge: over a hinge (shear), along two edges, or free in space.
  void move_free_spring(int s) {
    if (removed_[index(s)] != 0) return;
    const Spring<Scalar>& spring = old_spring(s);
    const int a = spring.a, b = spring.b;
    std::vector<int> middles;
    if (spring.kind != SpringKind::Seam) {
      const auto one = old_.topology().neighbours(a), two = old_.topology().neighbours(b);
      std::set_intersection(one.begin(), one.end(), two.begin(), two.end(),
                            std::back_inserter(middles));
    }
    if (middles.empty()) {
      add_free_spring(s, change_.remap.first_copy(a), change_.remap.first_copy(b));
      return;
    }
    if (spring.kind == SpringKind::Shear && move_over_hinge(s, middles)) return;
    const Points<Scalar>& x = old_.network().rest_positions;
    const Vector3<Scalar> centre = Scalar(0.5) * (x.col(a) + x.col(b));
    const int middle = *std::min_element(middles.begin(), middles.end(), [&](int u, int v) {
      return (x.col(u) - centre).squaredNorm() < (x.col(v) - centre).squaredNorm();
    });
    const std::vector<Row> rows = mesh_.rows_through(a, middle, b);
    for (const Row& row : rows) add_free_spring(s, row[0], row[2], Mesh::share(rows, row));
  }

  /// Moves a spring between the vertices opposite to an edge, if the hinge lives. Returns false
  /// when it spans no edge. `middles`: the common neighbours of its ends.
  bool move_over_hinge(int s, const std::vector<int>& middles) {
    bool found = false;
    for (const int u : middles) {
      for (const int v : middles) {
        const int e = u < v ? old_.find_edge(u, v) : -1;
        if (e < 0 || !old_.spans(e, old_spring(s).a, old_spring(s).b)) continue;
        found = true;
        const std::optional<std::array<int, 2>> ends = mesh_.living_hinge(e);
        if (!ends) continue;
        const bool forward = old_.topology().edges[index(e)].opposite[0] == old_spring(s).a;
        add_free_spring(s, (*ends)[forward ? 0 : 1], (*ends)[forward ? 1 : 0]);
        return true;
      }
    }
    return found;
  }

  /// Moves the stencils over three vertices in a row. Those that share a middle vertex share the
  /// stiffness.
  void move_rows() {
    const std::size_t n = static_cast<std::size_t>(old_.network().vertex_count());
    rows_at_.resize(n);
    for (std::size_t r = 0; r < old_.rows().size(); ++r) {
      const RowStencil& row = old_.rows()[r];
      const BendStencil<Scalar>& stencil = old_stencil(row.stencil);
      const auto at = [&](std::size_t i) { return stencil.vertex[row.place[i]]; };
      const std::vector<Row> rows = mesh_.rows_through(at(1), at(0), at(2));
      row_lives_.push_back(!rows.empty());
      rows_at_[index(at(0))].push_back(r);
      for (const Row& moved : rows) {
        BendStencil<Scalar> next = stencil;
        next.vertex[row.place[0]] = moved[1];
        next.vertex[row.place[1]] = moved[0];
        next.vertex[row.place[2]] = moved[2];
        if (Mesh::share(rows, moved) < 1.0) next.stiffness *= Scalar(Mesh::share(rows, moved));
        out_.bends.push_back(next);
      }
    }
  }

  /// Moves a stencil that is on no edges of the mesh to the first copies of its vertices, unless it
  /// spans a spring that was removed.
  void move_free_stencil(int b) {
    BendStencil<Scalar> stencil = old_stencil(b);
    const std::size_t count = index(stencil.count);
    const auto holds = [&](int v) {
      const auto end = old_stencil(b).vertex.begin() + stencil.count;
      return std::find(old_stencil(b).vertex.begin(), end, v) != end;
    };
    for (const int s : old_.free_springs()) {
      if (removed_[index(s)] != 0 && holds(old_spring(s).a) && holds(old_spring(s).b)) return;
    }
    for (std::size_t i = 0; i < count; ++i) {
      stencil.vertex[i] = change_.remap.first_copy(stencil.vertex[i]);
      for (std::size_t j = 0; j < i; ++j) {
        if (stencil.vertex[i] == stencil.vertex[j]) return;
      }
    }
    out_.bends.push_back(stencil);
  }

  /// Moves the stencils of a hinge, or makes one where the triangles changed.
  void move_hinge(std::size_t e) {
    const Side &one = mesh_.sides(e)[0], &two = mesh_.sides(e)[1];
    if (two.triangle < 0) return;
    if (mesh_.kept(e)) {
      for (const int b : old_.edge(one.old_edge).hinges) {
        BendStencil<Scalar> stencil = old_stencil(b);
        for (int& v : stencil.vertex) v = mesh_.kept_vertex(e, v);
        out_.bends.push_back(stencil);
      }
      return;
    }
    const Scalar bending = new_bending(e);
    if (!(Scalar(0) < bending)) return;
    const MeshEdge& edge = topology_.edges[e];
    BendStencil<Scalar> stencil;
    stencil.count = 4;
    stencil.vertex = {edge.a, edge.b, edge.opposite[0], edge.opposite[1]};
    stencil.weight = {Scalar(0), Scalar(0), Scalar(0), Scalar(0)};
    for (std::size_t i = 0; i < 2; ++i) {
      const Scalar at_a = mesh_.cotangent(edge.triangle[i], edge.a),
                   at_b = mesh_.cotangent(edge.triangle[i], edge.b);
      stencil.weight[0] += at_b;
      stencil.weight[1] += at_a;
      stencil.weight[2 + i] = Scalar(0) - (at_a + at_b);
      if (!(stencil.weight[2 + i] < Scalar(0))) return;  // a triangle without area has no normal
    }
    stencil.stiffness = bending / (mesh_.area(one.triangle) + mesh_.area(two.triangle));
    stencil.rest_fold = new_fold(e);
    out_.bends.push_back(stencil);
  }

  /// Returns the rest fold of an inner edge whose triangles changed: that of the old hinge, which
  /// may number its vertices in another order; 0 for other edges.
  Scalar new_fold(std::size_t e) const {
    const Side &one = mesh_.sides(e)[0], &two = mesh_.sides(e)[1];
    Scalar sum = Scalar(0), all = Scalar(0);
    if (one.old_edge < 0 || one.old_edge != two.old_edge) return sum;
    const MeshEdge& old_edge = old_.topology().edges[index(one.old_edge)];
    const int parent = mesh_.parent(one.triangle);
    const int opposite = old_edge.opposite[parent == old_edge.triangle[0] ? 0 : 1];
    for (const int b : old_.edge(one.old_edge).hinges) {
      const BendStencil<Scalar>& stencil = old_stencil(b);
      if (!(Scalar(0) < stencil.stiffness)) continue;
      const bool along = one.forward == (stencil.vertex[0] == old_edge.a);
      const bool same_sign = along == (stencil.vertex[2] == opposite);
      const Scalar part = stencil.stiffness * stencil.rest_fold;
      sum += same_sign ? part : Scalar(0) - part;
      all += stencil.stiffness;
    }
    return Scalar(0) < all ? Scalar(sum / all) : sum;
  }

  /// Returns the bending modulus of an inner edge whose triangles changed: that of the old edge or
  /// of the triangles, where a grid bends along rows only as far as rows are gone.
  Scalar new_bending(std::size_t e) const {
    const Side &one = mesh_.sides(e)[0], &two = mesh_.sides(e)[1];
    const int parent_one = mesh_.parent(one.triangle), parent_two = mesh_.parent(two.triangle);
    Scalar bending =
        Scalar(0.5) * (old_.triangle(parent_one).bending + old_.triangle(parent_two).bending);
    if (one.old_edge != two.old_edge) return bending;  // sewn
    if (one.old_edge < 0) return bending * lost_rows_of(parent_one);
    const EdgeContent<Scalar>& content = old_.edge(one.old_edge);
    if (Scalar(0) < content.bending) bending = content.bending;
    const double lost = lost_rows(one.old_edge);
    return lost < 0.0 ? bending : Scalar(bending * Scalar(lost));
  }

  /// Returns the share of the rows across an old edge that are gone; 1 if it has a hinge, -1 if no
  /// row crosses it.
  double lost_rows(int old_edge) const {
    if (!old_.edge(old_edge).hinges.empty()) return 1.0;
    const MeshEdge& edge = old_.topology().edges[index(old_edge)];
    double all = 0.0, gone = 0.0;
    for (const int end : {edge.a, edge.b}) {
      for (const std::size_t r : rows_at_[index(end)]) {
        const std::array<int, 2>& along = old_.rows()[r].edge;
        if (along[0] == old_edge || along[1] == old_edge) continue;
        all += 1.0;
        if (!row_lives_[r]) gone += 1.0;
      }
    }
    return all > 0.0 ? gone / all : -1.0;
  }

  /// The same for a triangle: the mean over its sides.
  Scalar lost_rows_of(int parent) const {
    double sum = 0.0, count = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::array<int, 3>& corner = old_.network().triangles[index(parent)];
      const double lost = lost_rows(old_.find_edge(corner[i], corner[(i + 1) % 3]));
      if (lost < 0.0) continue;
      sum += lost;
      count += 1.0;
    }
    return Scalar(count > 0.0 ? sum / count : 1.0);
  }

  const OldNetwork<Scalar>& old_;
  const MeshChange<Scalar>& change_;
  const Topology& topology_;
  const std::vector<unsigned char>& removed_;
  MeshCorrespondence<Scalar> mesh_;
  SpringNetwork<Scalar> out_;
  std::vector<OrderedSpring<Scalar>> springs_;
  std::vector<std::vector<std::size_t>> rows_at_;
  std::vector<bool> row_lives_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
