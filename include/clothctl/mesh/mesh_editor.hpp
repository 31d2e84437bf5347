#pragma once

// Changes of a triangle mesh that keep its surface: a vertex inserted on an edge or in a triangle,
// and edges opened by doubling vertices. Marked edges are opened all at once:
//
//   The triangles around a vertex form a fan. Two triangles of the fan hang together if they share
//   an edge at the vertex that is not marked. Every connected part of the fan gets its own copy of
//   the vertex.
//
// So an inner edge opens only where an end of it is doubled: a marked path of k edges between two
// inner vertices becomes a slit with k - 1 new vertices; one that starts at the border doubles that
// end too; one from border to border severs the sheet. A single marked edge between inner vertices
// stays closed. Marks on border edges change nothing. The result is always a manifold, and each
// opened edge adds one to the number of edges, so with V, E, F vertices, edges, triangles
//
//   χ = V - E + F    changes by   new vertices - opened edges.

#include <algorithm>
#include <array>
#include <cassert>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/mesh/remap.hpp"
#include "clothctl/mesh/topology.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A changed mesh and how it came from the old one. The old vertices keep their indices unless a
/// seam joined them; new ones follow.
template <RealScalar Scalar>
struct MeshChange {
  /// The triangles after the change.
  std::vector<std::array<int, 3>> triangles;
  /// From the old mesh to the changed one.
  Remap<Scalar> remap;
};

/// A mesh that is being changed. All functions allocate.
template <RealScalar Scalar>
class MeshEditor {
 public:
  /// Starts from vertex positions (3×n, m) and triangles. Complexity: O(n log n). Fails when: a
  /// position is not finite, or `make_topology` refuses the mesh.
  static Result<MeshEditor> create(const PointsView<Scalar>& positions,
                                   std::vector<std::array<int, 3>> triangles);

  /// Number of vertices now.
  int vertex_count() const { return static_cast<int>(positions_.size()); }
  /// Returns the position of a vertex, m.
  const Vector3<Scalar>& position(int vertex) const { return positions_[index(vertex)]; }
  /// Returns the triangles now.
  const std::vector<std::array<int, 3>>& triangles() const { return triangles_; }
  /// Returns the triangles that have a vertex, in no particular order.
  std::span<const int> around(int vertex) const { return around_[index(vertex)]; }
  /// Returns the one or two triangles that have the edge a-b; -1 for those that do not exist.
  std::array<int, 2> triangles_at(int a, int b) const;
  /// Returns true when a triangle has the edge a-b.
  bool has_edge(int a, int b) const { return triangles_at(a, b)[0] >= 0; }
  /// Returns true when exactly one triangle has the edge a-b.
  bool is_border(int a, int b) const {
    const std::array<int, 2> at = triangles_at(a, b);
    return at[0] >= 0 && at[1] < 0;
  }

  /// Inserts a vertex on the edge a-b at (1-t) x_a + t x_b and divides the triangles at the edge.
  /// Returns its index. Both parts of a marked edge stay marked. Fails when: there is no such edge,
  /// or t is not between 0 and 1.
  Result<int> insert_on_edge(int a, int b, const Scalar& t);
  /// Inserts a vertex in a triangle at the mean of its corners with these positive weights, which
  /// are divided by their sum, and divides the triangle in three. Returns the index of the vertex.
  /// Fails when: there is no such triangle, or a weight is not positive and finite.
  Result<int> insert_in_triangle(int triangle, const std::array<Scalar, 3>& weights);

  /// Marks the edge a-b. Returns false when there is no such edge.
  bool mark(int a, int b);
  /// Marks the inner edges at a vertex at which the fan passes through the plane through the vertex
  /// with this normal; a triangle is on the side of its centroid. Returns the number of these
  /// edges: 0 when all triangles are on one side.
  int mark_across(int vertex, const Vector3<Scalar>& normal);
  /// Returns the number of marked inner edges.
  int marked_count() const;
  /// Opens the marked edges and forgets the marks. Returns the number of new vertices. Complexity:
  /// O(marks · log(marks)).
  int open_marked();
  /// Number of inner edges that `open_marked` has opened so far.
  int opened_count() const { return opened_; }

  /// Returns the changed mesh.
  MeshChange<Scalar> change() const;

 private:
  using Share = VertexShare<Scalar>;
  /// A corner of a triangle that gets a copy of its vertex.
  struct Move {
    int triangle, from, to;
  };

  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  static std::array<int, 2> key(int a, int b) { return {(std::min)(a, b), (std::max)(a, b)}; }
  std::size_t corner_of(int triangle, int vertex) const {
    const std::array<int, 3>& corner = triangles_[index(triangle)];
    return corner[0] == vertex ? 0 : (corner[1] == vertex ? 1 : 2);
  }
  bool off_mesh(int vertex) const { return vertex < 0 || vertex >= vertex_count(); }

  /// Appends a vertex with this place and origin.
  int add_vertex(const Vector3<Scalar>& position, std::vector<Share> origin);
  /// Appends a triangle that is a part of the same parent as `like`.
  int add_triangle(int like);
  /// Puts `vertex` at a corner of a triangle, with its weights in the parent.
  void set_corner(int triangle, std::size_t corner, int vertex,
                  const std::array<Scalar, 3>& weights);
  /// Adds `weight` times the origin of `vertex` to `sum`.
  void add_origin(int vertex, const Scalar& weight, std::vector<Share>& sum) const;
  /// Lists the corners at `vertex` that get a copy of it. Returns the number of copies, which are
  /// numbered from `next` on.
  int divide_fan(int vertex, int next, std::vector<Move>& moves) const;

  std::vector<Vector3<Scalar>> positions_;
  std::vector<std::array<int, 3>> triangles_;
  std::vector<std::vector<int>> around_;
  std::vector<std::vector<Share>> origins_;
  std::vector<std::vector<int>> copies_;  // of the vertices at the start
  std::vector<int> parents_;
  std::vector<CornerWeights<Scalar>> corners_;
  std::set<std::array<int, 2>> marks_;
  Index old_triangles_ = 0;
  int opened_ = 0;
};

template <RealScalar Scalar>
auto MeshEditor<Scalar>::create(const PointsView<Scalar>& positions,
                                std::vector<std::array<int, 3>> triangles) -> Result<MeshEditor> {
  for (Index v = 0; v < positions.cols(); ++v) {
    if (!all_finite(positions.col(v)))
      return Error{"position of vertex " + std::to_string(v) + " is not finite"};
  }
  const Result<Topology> topology = make_topology(positions.cols(), triangles);
  if (!topology) return Error{topology.error()};
  MeshEditor mesh;
  const std::size_t n = static_cast<std::size_t>(positions.cols());
  mesh.positions_.reserve(n);
  mesh.around_.resize(n);
  for (int v = 0; v < static_cast<int>(n); ++v) {
    mesh.positions_.push_back(positions.col(v));
    mesh.origins_.push_back({{v, Scalar(1)}});
    mesh.copies_.push_back({v});
  }
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    for (const int v : triangles[t]) mesh.around_[index(v)].push_back(static_cast<int>(t));
    mesh.parents_.push_back(static_cast<int>(t));
  }
  mesh.corners_.assign(triangles.size(), whole_triangle<Scalar>());
  mesh.old_triangles_ = static_cast<Index>(triangles.size());
  mesh.triangles_ = std::move(triangles);
  return mesh;
}

template <RealScalar Scalar>
std::array<int, 2> MeshEditor<Scalar>::triangles_at(int a, int b) const {
  std::array<int, 2> found{-1, -1};
  if (off_mesh(a) || off_mesh(b) || a == b) return found;
  std::size_t count = 0;
  for (const int t : around_[index(a)]) {
    const std::array<int, 3>& corner = triangles_[index(t)];
    if (count < 2 && (corner[0] == b || corner[1] == b || corner[2] == b)) found[count++] = t;
  }
  return found;
}

template <RealScalar Scalar>
int MeshEditor<Scalar>::add_vertex(const Vector3<Scalar>& position, std::vector<Share> origin) {
  positions_.push_back(position);
  origins_.push_back(std::move(origin));
  around_.emplace_back();
  return vertex_count() - 1;
}

template <RealScalar Scalar>
int MeshEditor<Scalar>::add_triangle(int like) {
  const int t = static_cast<int>(triangles_.size());
  const std::array<int, 3> corner = triangles_[index(like)];
  const CornerWeights<Scalar> weights = corners_[index(like)];
  triangles_.push_back(corner);
  parents_.push_back(parents_[index(like)]);
  corners_.push_back(weights);
  for (const int v : corner) around_[index(v)].push_back(t);
  return t;
}

template <RealScalar Scalar>
void MeshEditor<Scalar>::set_corner(int triangle, std::size_t corner, int vertex,
                                    const std::array<Scalar, 3>& weights) {
  int& slot = triangles_[index(triangle)][corner];
  std::vector<int>& left = around_[index(slot)];
  left.erase(std::find(left.begin(), left.end(), triangle));
  slot = vertex;
  around_[index(vertex)].push_back(triangle);
  corners_[index(triangle)][corner] = weights;
}

template <RealScalar Scalar>
void MeshEditor<Scalar>::add_origin(int vertex, const Scalar& weight,
                                    std::vector<Share>& sum) const {
  for (const Share& share : origins_[index(vertex)]) {
    const auto same = std::find_if(sum.begin(), sum.end(), [&share](const Share& other) {
      return other.vertex == share.vertex;
    });
    if (same != sum.end()) {
      same->weight += weight * share.weight;
    } else {
      sum.push_back({share.vertex, weight * share.weight});
    }
  }
}

template <RealScalar Scalar>
Result<int> MeshEditor<Scalar>::insert_on_edge(int a, int b, const Scalar& t) {
  const std::array<int, 2> divided = triangles_at(a, b);
  const std::string name = "edge " + std::to_string(a) + "-" + std::to_string(b);
  if (divided[0] < 0) return Error{name + " does not exist"};
  if (!is_finite(t) || !(Scalar(0) < t) || !(t < Scalar(1)))
    return Error{name + ": a new vertex must lie between its ends, got t = " + number_text(t)};
  const Scalar s = Scalar(1) - t;
  std::vector<Share> origin;
  add_origin(a, s, origin);
  add_origin(b, t, origin);
  const int middle =
      add_vertex(Vector3<Scalar>(s * position(a) + t * position(b)), std::move(origin));
  for (const int triangle : divided) {
    if (triangle < 0) continue;
    const int part = add_triangle(triangle);
    const CornerWeights<Scalar> before = corners_[index(triangle)];
    const std::size_t i = corner_of(triangle, a), j = corner_of(triangle, b);
    std::array<Scalar, 3> weights;
    for (std::size_t k = 0; k < 3; ++k) weights[k] = s * before[i][k] + t * before[j][k];
    set_corner(triangle, j, middle, weights);
    set_corner(part, i, middle, weights);
  }
  if (marks_.erase(key(a, b)) > 0) {
    marks_.insert(key(a, middle));
    marks_.insert(key(middle, b));
  }
  return middle;
}

template <RealScalar Scalar>
Result<int> MeshEditor<Scalar>::insert_in_triangle(int triangle,
                                                   const std::array<Scalar, 3>& weights) {
  const std::string name = "triangle " + std::to_string(triangle);
  if (triangle < 0 || triangle >= static_cast<int>(triangles_.size()))
    return Error{name + " does not exist"};
  Scalar sum = Scalar(0);
  for (const Scalar& w : weights) {
    if (!is_finite(w) || !(Scalar(0) < w))
      return Error{name + ": a new vertex needs positive weights, got " + number_text(w)};
    sum += w;
  }
  const std::array<int, 3> corner = triangles_[index(triangle)];
  const CornerWeights<Scalar> before = corners_[index(triangle)];
  Vector3<Scalar> place = Vector3<Scalar>::Zero();
  std::array<Scalar, 3> inner{Scalar(0), Scalar(0), Scalar(0)};
  std::vector<Share> origin;
  for (std::size_t i = 0; i < 3; ++i) {
    const Scalar w = weights[i] / sum;
    place += w * position(corner[i]);
    add_origin(corner[i], w, origin);
    for (std::size_t k = 0; k < 3; ++k) inner[k] += w * before[i][k];
  }
  const int middle = add_vertex(place, std::move(origin));
  for (std::size_t i = 1; i < 3; ++i) set_corner(add_triangle(triangle), i, middle, inner);
  set_corner(triangle, 0, middle, inner);
  return middle;
}

template <RealScalar Scalar>
bool MeshEditor<Scalar>::mark(int a, int b) {
  const std::array<int, 2> at = triangles_at(a, b);
  if (at[1] >= 0) marks_.insert(key(a, b));
  return at[0] >= 0;
}

template <RealScalar Scalar>
int MeshEditor<Scalar>::mark_across(int vertex, const Vector3<Scalar>& normal) {
  if (off_mesh(vertex)) return 0;
  const auto in_front = [&](int triangle) {
    Vector3<Scalar> sum = Vector3<Scalar>::Zero();
    for (const int v : triangles_[index(triangle)]) sum += position(v) - position(vertex);
    return Scalar(0) < normal.dot(sum);
  };
  std::set<std::array<int, 2>> crossed;
  for (const int t : around_[index(vertex)]) {
    for (const int v : triangles_[index(t)]) {
      if (v == vertex) continue;
      const std::array<int, 2> at = triangles_at(vertex, v);
      if (at[1] >= 0 && in_front(at[0]) != in_front(at[1])) crossed.insert(key(vertex, v));
    }
  }
  marks_.insert(crossed.begin(), crossed.end());
  return static_cast<int>(crossed.size());
}

template <RealScalar Scalar>
int MeshEditor<Scalar>::marked_count() const {
  return static_cast<int>(marks_.size());
}

template <RealScalar Scalar>
int MeshEditor<Scalar>::divide_fan(int vertex, int next, std::vector<Move>& moves) const {
  std::vector<int> left = around_[index(vertex)];
  std::sort(left.begin(), left.end());
  int parts = 0;
  std::vector<int> stack;
  while (!left.empty()) {
    stack.assign(1, left.front());
    left.erase(left.begin());
    while (!stack.empty()) {
      const int t = stack.back();
      stack.pop_back();
      if (parts > 0) moves.push_back({t, vertex, next + parts - 1});
      for (const int v : triangles_[index(t)]) {
        if (v == vertex || marks_.count(key(vertex, v)) > 0) continue;
        for (const int other : triangles_at(vertex, v)) {
          const auto found = std::find(left.begin(), left.end(), other);
          if (found == left.end()) continue;
          left.erase(found);
          stack.push_back(other);
        }
      }
    }
    ++parts;
  }
  return parts > 0 ? parts - 1 : 0;
}

template <RealScalar Scalar>
int MeshEditor<Scalar>::open_marked() {
  std::vector<int> touched;
  for (const std::array<int, 2>& edge : marks_)
    touched.insert(touched.end(), edge.begin(), edge.end());
  std::sort(touched.begin(), touched.end());
  touched.erase(std::unique(touched.begin(), touched.end()), touched.end());
  const int before = vertex_count();
  int next = before;
  std::vector<Move> moves;
  for (const int v : touched) {
    const int copies = divide_fan(v, next, moves);
    next += copies;
    for (int i = 0; i < copies; ++i) {
      const Vector3<Scalar> place = position(v);
      const std::vector<Share> origin = origins_[index(v)];
      const int copy = add_vertex(place, origin);
      if (origin.size() == 1) copies_[index(origin[0].vertex)].push_back(copy);
    }
  }
  const std::set<std::array<int, 2>> marks = std::move(marks_);
  marks_.clear();
  std::vector<std::array<int, 2>> sides;
  sides.reserve(marks.size());
  for (const std::array<int, 2>& edge : marks) sides.push_back(triangles_at(edge[0], edge[1]));
  for (const Move& move : moves) {
    const std::size_t corner = corner_of(move.triangle, move.from);
    const std::array<Scalar, 3> weights = corners_[index(move.triangle)][corner];
    set_corner(move.triangle, corner, move.to, weights);
  }
  for (const std::array<int, 2>& pair : sides) {
    int shared = 0;
    for (const int v : triangles_[index(pair[0])]) {
      const std::array<int, 3>& other = triangles_[index(pair[1])];
      if (std::find(other.begin(), other.end(), v) != other.end()) ++shared;
    }
    if (shared < 2) ++opened_;
  }
  return vertex_count() - before;
}

template <RealScalar Scalar>
MeshChange<Scalar> MeshEditor<Scalar>::change() const {
  typename Remap<Scalar>::Tables tables;
  for (const std::vector<Share>& origin : origins_) {
    tables.origins.items.insert(tables.origins.items.end(), origin.begin(), origin.end());
    tables.origins.close();
  }
  for (const std::vector<int>& copies : copies_) {
    tables.copies.items.insert(tables.copies.items.end(), copies.begin(), copies.end());
    tables.copies.close();
  }
  tables.parents = parents_;
  tables.corners = corners_;
  tables.old_triangles = old_triangles_;
  return {triangles_, Remap<Scalar>(std::move(tables))};
}

}  // namespace clothctl::inline CLOTHCTL_ABI
