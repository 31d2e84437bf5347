#pragma once

// How the vertices and triangles of a mesh continue in a changed mesh, after a tear, a cut or a
// seam. With x the old positions and x' the new ones:
//
//   x'_i   = Σ_v w_iv x_v          origin of the new vertex i: one old vertex, or a weighted mean
//   c'_i   = Σ_k B_ik c_k          corner i of a new triangle, by the corners c_k of its parent
//
// The weights w_i and each row of B sum to one. A new triangle has the share det B of the area of
// its parent; the shares of all children of a triangle sum to one. An old vertex v continues as one
// or more new vertices, its copies: a tear doubles it, a seam makes one of two.

#include <algorithm>
#include <array>
#include <cassert>
#include <span>
#include <utility>
#include <vector>

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Lists of items, one list after the other.
template <class Item>
struct PackedLists {
  std::vector<std::size_t> start{0};
  std::vector<Item> items;

  /// Ends the current list; what is appended to `items` afterwards belongs to the next one.
  void close() { start.push_back(items.size()); }
  std::size_t count() const { return start.size() - 1; }
  std::span<const Item> operator[](int list) const {
    const std::size_t i = static_cast<std::size_t>(list);
    return std::span<const Item>(items).subspan(start[i], start[i + 1] - start[i]);
  }
  /// The items of the list that is not closed yet.
  std::span<Item> open() { return std::span<Item>(items).subspan(start.back()); }
};

}  // namespace detail

/// An old vertex and its weight in a new one.
template <RealScalar Scalar>
struct VertexShare {
  /// The old vertex.
  int vertex = 0;
  /// Its weight.
  Scalar weight = Scalar(1);
};

/// The corners of a triangle as weighted sums of the corners of its parent: entry (i, k) is the
/// weight of the parent's corner k in corner i.
template <RealScalar Scalar>
using CornerWeights = std::array<std::array<Scalar, 3>, 3>;

/// Returns the weights of a triangle that is its parent unchanged.
template <RealScalar Scalar>
CornerWeights<Scalar> whole_triangle() {
  const Scalar o = Scalar(0), l = Scalar(1);
  return {{{l, o, o}, {o, l, o}, {o, o, l}}};
}

/// Returns true when a triangle with these weights is its parent unchanged.
template <RealScalar Scalar>
bool is_whole(const CornerWeights<Scalar>& corners) {
  return corners == whole_triangle<Scalar>();
}

/// Returns the share of its parent's area that a triangle with these weights has: det B.
template <RealScalar Scalar>
Scalar area_share(const CornerWeights<Scalar>& b) {
  return b[0][0] * (b[1][1] * b[2][2] - b[1][2] * b[2][1]) -
         b[0][1] * (b[1][0] * b[2][2] - b[1][2] * b[2][0]) +
         b[0][2] * (b[1][0] * b[2][1] - b[1][1] * b[2][0]);
}

/// How vertices and triangles continue in a changed mesh. A value; `then` chains two changes.
template <RealScalar Scalar>
class Remap {
 public:
  /// An old vertex with its weight.
  using Share = VertexShare<Scalar>;
  /// The tables of a remap.
  struct Tables {
    /// For each new vertex, the old vertices that make it up, with weights of sum 1.
    detail::PackedLists<Share> origins;
    /// For each old vertex, the new vertices that continue it, at least one.
    detail::PackedLists<int> copies;
    /// For each new triangle, the old one that it is a part of.
    std::vector<int> parents;
    /// For each new triangle, where its corners lie in its parent.
    std::vector<CornerWeights<Scalar>> corners;
    /// Number of old triangles.
    Index old_triangles = 0;
  };

  /// Maps an empty mesh.
  Remap() = default;
  /// Takes tables with indices in range. Allocates. Complexity: O(triangles).
  explicit Remap(Tables tables) : tables_(std::move(tables)) { list_children(); }

  /// Returns the remap of a mesh that does not change. Allocates.
  static Remap identity(Index vertices, Index triangles);

  /// Number of vertices before the change.
  Index old_vertex_count() const { return static_cast<Index>(tables_.copies.count()); }
  /// Number of vertices after it.
  Index vertex_count() const { return static_cast<Index>(tables_.origins.count()); }
  /// Number of triangles before the change.
  Index old_triangle_count() const { return tables_.old_triangles; }
  /// Number of triangles after it.
  Index triangle_count() const { return static_cast<Index>(tables_.parents.size()); }

  /// Returns the old vertices that make up a new one; their weights sum to 1.
  std::span<const Share> origin(int vertex) const { return tables_.origins[vertex]; }
  /// Returns the new vertices that continue an old one; at least one, the first copy first.
  std::span<const int> copies(int old_vertex) const { return tables_.copies[old_vertex]; }
  /// Returns the first copy of an old vertex. A tear leaves it in its place in the numbering.
  int first_copy(int old_vertex) const { return tables_.copies[old_vertex].front(); }
  /// Returns the old triangle that a new one is a part of.
  int parent(int triangle) const { return tables_.parents[static_cast<std::size_t>(triangle)]; }
  /// Returns where the corners of a new triangle lie in its parent; also the map for texture
  /// coordinates.
  const CornerWeights<Scalar>& corners(int triangle) const {
    return tables_.corners[static_cast<std::size_t>(triangle)];
  }
  /// Returns the new triangles that make up an old one, ascending.
  std::span<const int> children(int old_triangle) const { return children_[old_triangle]; }
  /// Returns true when nothing changed. Complexity: O(vertices + triangles).
  bool is_identity() const;

  /// Returns the remap of this change followed by `next`, which must start from the mesh that this
  /// one ends at. Allocates.
  Remap then(const Remap& next) const;

  /// Returns the values of the new vertices (3×n') from those of the old ones (3×n): positions,
  /// velocities. Allocates.
  Points<Scalar> interpolate(const PointsView<Scalar>& old) const;

  /// Returns all copies of a list of old vertices, each once, in the order of the list: pinned
  /// vertices, for example, of which all copies stay pinned. Allocates.
  std::vector<int> all_copies(const std::vector<int>& old_vertices) const;

 private:
  void list_children();

  Tables tables_;
  detail::PackedLists<int> children_;
};

template <RealScalar Scalar>
auto Remap<Scalar>::identity(Index vertices, Index triangles) -> Remap {
  Tables tables;
  for (int v = 0; v < static_cast<int>(vertices); ++v) {
    tables.origins.items.push_back({v, Scalar(1)});
    tables.origins.close();
    tables.copies.items.push_back(v);
    tables.copies.close();
  }
  for (int t = 0; t < static_cast<int>(triangles); ++t) tables.parents.push_back(t);
  tables.corners.assign(static_cast<std::size_t>(triangles), whole_triangle<Scalar>());
  tables.old_triangles = triangles;
  return Remap(std::move(tables));
}

template <RealScalar Scalar>
void Remap<Scalar>::list_children() {
  const std::size_t count = static_cast<std::size_t>(tables_.old_triangles);
  children_.start.assign(count + 1, 0);
  children_.items.resize(tables_.parents.size());
  for (const int p : tables_.parents) ++children_.start[static_cast<std::size_t>(p) + 1];
  for (std::size_t t = 0; t < count; ++t) children_.start[t + 1] += children_.start[t];
  std::vector<std::size_t> next = children_.start;
  for (std::size_t t = 0; t < tables_.parents.size(); ++t)
    children_.items[next[static_cast<std::size_t>(tables_.parents[t])]++] = static_cast<int>(t);
}

template <RealScalar Scalar>
bool Remap<Scalar>::is_identity() const {
  if (vertex_count() != old_vertex_count() || triangle_count() != old_triangle_count())
    return false;
  for (int v = 0; v < static_cast<int>(vertex_count()); ++v) {
    if (origin(v).size() != 1 || origin(v)[0].vertex != v || copies(v).size() != 1) return false;
  }
  for (int t = 0; t < static_cast<int>(triangle_count()); ++t) {
    if (parent(t) != t || !is_whole(corners(t))) return false;
  }
  return true;
}

template <RealScalar Scalar>
auto Remap<Scalar>::then(const Remap& next) const -> Remap {
  assert(next.old_vertex_count() == vertex_count());
  assert(next.old_triangle_count() == triangle_count());
  Tables out;
  for (int v = 0; v < static_cast<int>(next.vertex_count()); ++v) {
    for (const Share& outer : next.origin(v)) {
      for (const Share& inner : origin(outer.vertex)) {
        const Scalar weight = outer.weight * inner.weight;
        const std::span<Share> so_far = out.origins.open();
        const auto same = std::find_if(so_far.begin(), so_far.end(), [&inner](const Share& share) {
          return share.vertex == inner.vertex;
        });
        if (same != so_far.end()) {
          same->weight += weight;
        } else {
          out.origins.items.push_back({inner.vertex, weight});
        }
      }
    }
    out.origins.close();
  }
  for (int v = 0; v < static_cast<int>(old_vertex_count()); ++v) {
    for (const int middle : copies(v)) {
      for (const int copy : next.copies(middle)) {
        const std::span<int> so_far = out.copies.open();
        if (std::find(so_far.begin(), so_far.end(), copy) == so_far.end())
          out.copies.items.push_back(copy);
      }
    }
    out.copies.close();
  }
  for (int t = 0; t < static_cast<int>(next.triangle_count()); ++t) {
    const CornerWeights<Scalar>&outer = next.corners(t), &inner = corners(next.parent(t));
    CornerWeights<Scalar> both;
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t k = 0; k < 3; ++k)
        both[i][k] =
            outer[i][0] * inner[0][k] + outer[i][1] * inner[1][k] + outer[i][2] * inner[2][k];
    }
    out.parents.push_back(parent(next.parent(t)));
    out.corners.push_back(both);
  }
  out.old_triangles = old_triangle_count();
  return Remap(std::move(out));
}

template <RealScalar Scalar>
Points<Scalar> Remap<Scalar>::interpolate(const PointsView<Scalar>& old) const {
  assert(old.cols() == old_vertex_count());
  Points<Scalar> out(3, vertex_count());
  for (int v = 0; v < static_cast<int>(vertex_count()); ++v) {
    const std::span<const Share> shares = origin(v);
    if (shares.size() == 1) {
      out.col(v) = old.col(shares[0].vertex);
      continue;
    }
    Vector3<Scalar> sum = Vector3<Scalar>::Zero();
    for (const Share& share : shares) sum += share.weight * old.col(share.vertex);
    out.col(v) = sum;
  }
  return out;
}

template <RealScalar Scalar>
std::vector<int> Remap<Scalar>::all_copies(const std::vector<int>& old_vertices) const {
  std::vector<int> out;
  std::vector<bool> seen(static_cast<std::size_t>(vertex_count()), false);
  for (const int old : old_vertices) {
    for (const int copy : copies(old)) {
      if (!seen[static_cast<std::size_t>(copy)]) out.push_back(copy);
      seen[static_cast<std::size_t>(copy)] = true;
    }
  }
  return out;
}

/// Returns the state of the changed sheet: every new vertex has the mean position and velocity of
/// its origin. Copies start where the old vertex was. Allocates.
template <RealScalar Scalar>
ClothState<Scalar> remap_state(const ClothState<Scalar>& state, const Remap<Scalar>& remap) {
  return {remap.interpolate(state.positions), remap.interpolate(state.velocities)};
}

/// Returns the input for the changed sheet. All copies of a driven vertex are driven to its
/// position (where a seam joins two driven vertices: to the position of the first). A force acts on
/// the first copy of its vertex, so the total force stays the same. All copies of an attached
/// vertex are attached to its point and share the stiffness equally. The vertices of the input must
/// be on the old mesh. Allocates.
template <RealScalar Scalar>
ClothInput<Scalar> remap_input(const ClothInput<Scalar>& input, const Remap<Scalar>& remap) {
  ClothInput<Scalar> out;
  out.wind = input.wind;
  out.forces = input.forces;
  for (const int v : input.force_vertices) out.force_vertices.push_back(remap.first_copy(v));
  out.driven_vertices = remap.all_copies(input.driven_vertices);
  out.driven_positions.resize(3, static_cast<Index>(out.driven_vertices.size()));
  std::vector<Index> source(static_cast<std::size_t>(remap.vertex_count()), Index(-1));
  for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
    for (const int copy : remap.copies(input.driven_vertices[i])) {
      Index& from = source[static_cast<std::size_t>(copy)];
      if (from < 0) from = static_cast<Index>(i);
    }
  }
  for (std::size_t j = 0; j < out.driven_vertices.size(); ++j)
    out.driven_positions.col(static_cast<Index>(j)) =
        input.driven_positions.col(source[static_cast<std::size_t>(out.driven_vertices[j])]);
  std::vector<Index> attachment;
  for (std::size_t i = 0; i < input.attached_vertices.size(); ++i) {
    for (const int copy : remap.copies(input.attached_vertices[i])) {
      out.attached_vertices.push_back(copy);
      attachment.push_back(static_cast<Index>(i));
    }
  }
  const Index attached = static_cast<Index>(attachment.size());
  out.attached_positions.resize(3, attached);
  out.attachment_stiffness.resize(attached);
  for (Index j = 0; j < attached; ++j) {
    const Index i = attachment[static_cast<std::size_t>(j)];
    const std::size_t shares =
        remap.copies(input.attached_vertices[static_cast<std::size_t>(i)]).size();
    out.attached_positions.col(j) = input.attached_positions.col(i);
    out.attachment_stiffness[j] =
        input.attachment_stiffness[i] / Scalar(static_cast<double>(shares));
  }
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
