#pragma once

// Solids bounded by triangles: a closed mesh, the convex hull of points, and a grid of distances
// made from a mesh.
//
// MeshCollider and HullCollider are exact: a tree of boxes finds the closest triangle, and the
// angle-weighted pseudonormal of the closest face, edge or vertex gives the sign
// (detail/closed_mesh.hpp). A sweep is exact, too, and passes through no triangle however thin the
// solid is.
//
// GridCollider interpolates distances at the nodes of a lattice of spacing h. With the weights w_i
// of the eight nodes x_i around x,
//
//   d̃(x) = Σ w_i d(x_i),     |d̃ - d| <= Σ w_i |x - x_i| <= √(Σ w_i |x - x_i|²) <= (√3/2) h
//
// since d changes by no more than the way, and Σ w_i (x - x_i)² is at most h²/4 for each axis. The
// normal is that of ∇d̃, and the closest point x - d̃ n is as wrong as the distance.

#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/detail/convex_hull.hpp"
#include "clothctl/collision/detail/triangle_tree.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A solid bounded by a closed triangle mesh, at rest. Copies share the mesh. Models Collider.
template <RealScalar Scalar>
class MeshCollider : public detail::PointQueries<MeshCollider<Scalar>, Scalar> {
 public:
  /// Makes a solid of the vertices (3×n, m) and the triangles, counter-clockwise from outside.
  /// Vertices of no triangle are allowed, and several closed parts; an inverted part inside of
  /// another is a hollow. Self-intersections are not looked for; near them the sign
  /// may be wrong. Allocates. Complexity: O(triangles log triangles). Fails when: `make_topology`
  /// refuses the mesh, it is open, a triangle is flipped against its neighbour, a vertex joins two
  /// parts, a triangle has no area, a coordinate is not finite, the volume is not positive (the
  /// mesh is inverted), or the friction coefficient is negative.
  static Result<MeshCollider> create(const PointsView<Scalar>& vertices,
                                     const std::vector<std::array<int, 3>>& triangles,
                                     const ColliderSurface<Scalar>& surface = {}) {
    const Result<Topology> topology = make_topology(vertices.cols(), triangles);
    if (!topology) return Error{"the mesh is no surface: " + topology.error()};
    std::string bad = detail::validate_closed(triangles, *topology);
    const Points<Scalar> x = vertices;
    if (bad.empty()) bad = detail::validate_solid<Scalar>(x, triangles);
    if (!bad.empty()) return Error{"the mesh bounds no solid: " + bad};
    bad = surface.validate();
    if (!bad.empty()) return Error{"the mesh has " + bad};
    return MeshCollider(std::make_shared<const detail::TriangleTree<Scalar>>(
                            x, triangles, detail::pseudonormals<Scalar>(x, triangles, *topology)),
                        surface);
  }

  /// Friction and body of the surface.
  const ColliderSurface<Scalar>& surface() const { return surface_; }
  /// The box of the mesh.
  BoundingBox<Scalar> bounds(const Scalar&) const { return tree_->bounds(); }

  /// Returns the closest point of the surface.
  detail::NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const { return tree_->nearest(x); }
  /// Returns the signed distance of a finite point, m.
  Scalar distance_at(const Vector3<Scalar>& x) const { return tree_->nearest(x).distance; }
  /// Returns everything about the surface closest to a finite point.
  SurfacePoint<Scalar> closest_at(const Vector3<Scalar>& x) const {
    const detail::NearestPoint<Scalar> q = tree_->nearest(x);
    return {q.distance,        q.point,      q.normal, Vector3<Scalar>::Constant(Scalar(0)),
            surface_.friction, surface_.body};
  }
  /// Returns the time of impact of a ball with a finite path.
  Scalar sweep_at(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& radius,
                  const Scalar&) const {
    return tree_->sweep(from, to, radius);
  }

 private:
  MeshCollider(std::shared_ptr<const detail::TriangleTree<Scalar>> tree,
               const ColliderSurface<Scalar>& surface)
      : tree_(std::move(tree)), surface_(surface) {}

  std::shared_ptr<const detail::TriangleTree<Scalar>> tree_;
  ColliderSurface<Scalar> surface_;
};

/// The convex hull of points, at rest. Models Collider.
template <RealScalar Scalar>
class HullCollider : public detail::BasicShape<HullCollider<Scalar>, Scalar> {
 public:
  /// Makes the hull of the points (3×n, m). Points that are no corners of it are left out; so are
  /// corners that stand out by less than about 1e-8 of the extent. Allocates. Complexity: O(n f)
  /// for f triangles of the hull. Fails when: there are fewer than 4 points, a coordinate is not
  /// finite, the points are flat (within 1e-6 of their extent of a plane), or the friction
  /// coefficient is negative.
  static Result<HullCollider> create(const PointsView<Scalar>& points,
                                     const ColliderSurface<Scalar>& surface = {}) {
    Result<detail::HullTriangles> made = detail::convex_hull<Scalar>(points);
    if (!made) return Error{"the hull is no solid: " + made.error()};
    if (const std::string bad = surface.validate(); !bad.empty())
      return Error{"the hull has " + bad};
    detail::HullTriangles& hull = *made;
    Points<Scalar> x(3, static_cast<Index>(hull.vertices.size()));
    for (Index i = 0; i < x.cols(); ++i)
      x.col(i) = points.col(hull.vertices[static_cast<std::size_t>(i)]);
    const Result<Topology> topology = make_topology(x.cols(), hull.triangles);
    if (!topology) return Error{"the hull is no solid: " + topology.error()};
    HullCollider out(surface);
    out.tree_ = std::make_shared<const detail::TriangleTree<Scalar>>(
        x, hull.triangles,
        detail::pseudonormals<Scalar>(x, hull.triangles, *topology, face_normals(x, hull)));
    out.vertices_ = std::move(x);
    out.triangles_ = std::move(hull.triangles);
    return out;
  }

  /// The corners, 3×n, m.
  const Points<Scalar>& vertices() const { return vertices_; }
  /// The triangles of the hull, counter-clockwise from outside.
  const std::vector<std::array<int, 3>>& triangles() const { return triangles_; }
  /// The box of the hull.
  BoundingBox<Scalar> bounds(const Scalar&) const { return tree_->bounds(); }
  /// Returns the closest point of the surface.
  detail::NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const { return tree_->nearest(x); }

 private:
  explicit HullCollider(const ColliderSurface<Scalar>& surface)
      : detail::BasicShape<HullCollider, Scalar>(surface) {}

  /// Returns the normals of the triangles. Rounding may have turned a sliver over; on the lattice,
  /// where the hull was made, it faces outwards.
  static Points<Scalar> face_normals(const Points<Scalar>& x, const detail::HullTriangles& hull) {
    Points<Scalar> out = detail::face_normals<Scalar>(x, hull.triangles);
    for (Index t = 0; t < out.cols(); ++t) {
      const std::array<int, 3>& c = hull.triangles[static_cast<std::size_t>(t)];
      if (!detail::triangle_frame<Scalar>(x.col(c[0]), x.col(c[1]), x.col(c[2])).thin()) continue;
      for (Index k = 0; k < 3; ++k) out(k, t) = Scalar(hull.normals(k, t));
    }
    return out;
  }

  std::shared_ptr<const detail::TriangleTree<Scalar>> tree_;
  Points<Scalar> vertices_;
  std::vector<std::array<int, 3>> triangles_;
};

/// Distances of a mesh on a grid, at rest: faster than the mesh, and a little wrong. Outside of the
/// grid, and in sweeps, the mesh answers. Copies share the data. Models Collider.
template <RealScalar Scalar>
class GridCollider : public detail::PointQueries<GridCollider<Scalar>, Scalar> {
 public:
  /// Computes the distances of `mesh` at the nodes of a grid: `cells` cells (2 to 512) along the
  /// longest side of the mesh's box, which is grown by `margin` (m) on all sides. Allocates.
  /// Complexity: O(cells³ log triangles). Fails when: `cells` is out of range, the margin is
  /// negative, not finite or more than ten times the longest side, or there are more than 2^28
  /// nodes.
  static Result<GridCollider> create(const MeshCollider<Scalar>& mesh, int cells,
                                     const Scalar& margin) {
    if (cells < 2 || cells > 512)
      return Error{"the grid has " + std::to_string(cells) + " cells, must be 2 to 512"};
    const BoundingBox<Scalar> box = mesh.bounds(Scalar(0));
    Scalar longest(0);
    for (int i = 0; i < 3; ++i) {
      if (longest < box.upper[i] - box.lower[i]) longest = box.upper[i] - box.lower[i];
    }
    if (!is_finite(margin) || margin < Scalar(0) || Scalar(10) * longest < margin)
      return Error{"the grid has the margin " + number_text(margin) +
                   " m, must be 0 to ten times the longest side of the mesh, " +
                   number_text(longest) + " m"};
    const Scalar spacing = longest / Scalar(static_cast<double>(cells));
    const Lattice lattice = lattice_of(box.grown(margin), spacing);
    if (kMostNodes < lattice.size())
      return Error{"the grid has " + std::to_string(lattice.size()) + " nodes, must be at most " +
                   std::to_string(kMostNodes)};
    return GridCollider(mesh, lattice, spacing);
  }

  /// Spacing h of the nodes, m.
  const Scalar& spacing() const { return spacing_; }
  /// The largest error of a distance, (√3/2) h, m.
  Scalar error_bound() const {
    using std::sqrt;
    return sqrt(Scalar(0.75)) * spacing_;
  }
  /// The box of the mesh.
  BoundingBox<Scalar> bounds(const Scalar& dt) const { return mesh_.bounds(dt); }

  /// Returns the interpolated distance of a finite point, m.
  Scalar distance_at(const Vector3<Scalar>& x) const {
    Cell cell;
    if (!locate(x, cell)) return mesh_.distance_at(x);
    const std::array<Scalar, 4> along = edges_along_x(cell);
    const Scalar low = along[0] + cell.share[1] * (along[1] - along[0]);
    const Scalar high = along[2] + cell.share[1] * (along[3] - along[2]);
    return low + cell.share[2] * (high - low);
  }
  /// Returns the interpolated answer for a finite point.
  SurfacePoint<Scalar> closest_at(const Vector3<Scalar>& x) const {
    using std::sqrt;
    Cell cell;
    if (!locate(x, cell)) return mesh_.closest_at(x);
    const std::array<Scalar, 4> along = edges_along_x(cell);
    const Scalar low = along[0] + cell.share[1] * (along[1] - along[0]);
    const Scalar high = along[2] + cell.share[1] * (along[3] - along[2]);
    Vector3<Scalar> slope(Scalar(0), Scalar(0), high - low);
    for (std::size_t k = 0; k < 4; ++k) {
      const Scalar wy = k % 2 == 0 ? Scalar(Scalar(1) - cell.share[1]) : cell.share[1];
      const Scalar wz = k / 2 == 0 ? Scalar(Scalar(1) - cell.share[2]) : cell.share[2];
      slope[0] += wy * wz * (node(cell, k, 1) - node(cell, k, 0));
      if (k % 2 == 1) slope[1] += wz * (along[k] - along[k - 1]);
    }
    const Scalar length = sqrt(slope.squaredNorm());
    // Where the distance hardly changes over a cell, as on a ridge inside, it has no direction.
    if (!(Scalar(0.05) * spacing_ < length)) return mesh_.closest_at(x);
    SurfacePoint<Scalar> out;
    out.distance = low + cell.share[2] * (high - low);
    out.normal = slope / length;
    out.point = x - out.distance * out.normal;
    out.friction = mesh_.surface().friction;
    out.body = mesh_.surface().body;
    return out;
  }
  /// Returns the exact time of impact of a ball with a finite path.
  Scalar sweep_at(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& radius,
                  const Scalar& dt) const {
    return mesh_.sweep_at(from, to, radius, dt);
  }

 private:
  /// The node with the smallest coordinates, and the place of a point between it and its diagonal
  /// opposite, 0 to 1 along each axis.
  struct Cell {
    std::size_t first = 0;
    Vector3<Scalar> share;
  };

  /// The first node, and the number of cells along each axis.
  struct Lattice {
    Vector3<Scalar> origin;
    std::array<int, 3> cells{};

    /// Returns the number of nodes.
    std::uint64_t size() const {
      std::uint64_t nodes = 1;
      for (const int n : cells) nodes *= static_cast<std::uint64_t>(n) + 1;
      return nodes;
    }
  };
  static constexpr std::uint64_t kMostNodes = std::uint64_t(1) << 28;

  GridCollider(const MeshCollider<Scalar>& mesh, const Lattice& lattice, const Scalar& spacing);
  static Lattice lattice_of(const BoundingBox<Scalar>& box, const Scalar& spacing);
  bool locate(const Vector3<Scalar>& x, Cell& cell) const;
  static int whole_part(const Scalar& value, int most);
  /// Edge k of a cell along x starts at the node k % 2 along y and k / 2 along z.
  const Scalar& node(const Cell& cell, std::size_t k, std::size_t along_x) const {
    return (*values_)[cell.first + along_x + (k % 2) * row_ + (k / 2) * layer_];
  }
  std::array<Scalar, 4> edges_along_x(const Cell& cell) const {
    std::array<Scalar, 4> out;
    for (std::size_t k = 0; k < 4; ++k)
      out[k] = node(cell, k, 0) + cell.share[0] * (node(cell, k, 1) - node(cell, k, 0));
    return out;
  }

  MeshCollider<Scalar> mesh_;
  Vector3<Scalar> origin_;
  Scalar spacing_, inverse_spacing_;
  std::array<int, 3> cells_{};
  std::size_t row_ = 0, layer_ = 0;
  std::shared_ptr<const std::vector<Scalar>> values_;
};

template <RealScalar Scalar>
int GridCollider<Scalar>::whole_part(const Scalar& value, int most) {
  if constexpr (std::floating_point<Scalar>) {
    const int whole = static_cast<int>(value);
    return whole < most ? whole : most;
  } else {
    int whole = 0;  // a type that only compares: one bit after the other
    for (int bit = 8192; bit > 0; bit /= 2) {
      if (whole + bit <= most && !(value < Scalar(static_cast<double>(whole + bit)))) whole += bit;
    }
    return whole;
  }
}

template <RealScalar Scalar>
typename GridCollider<Scalar>::Lattice GridCollider<Scalar>::lattice_of(
    const BoundingBox<Scalar>& box, const Scalar& spacing) {
  Lattice out{box.lower, {}};
  for (int i = 0; i < 3; ++i)
    out.cells[static_cast<std::size_t>(i)] =
        whole_part((box.upper[i] - box.lower[i]) / spacing, 12000) + 1;
  return out;
}

template <RealScalar Scalar>
GridCollider<Scalar>::GridCollider(const MeshCollider<Scalar>& mesh, const Lattice& lattice,
                                   const Scalar& spacing)
    : mesh_(mesh),
      origin_(lattice.origin),
      spacing_(spacing),
      inverse_spacing_(Scalar(1) / spacing),
      cells_(lattice.cells) {
  row_ = static_cast<std::size_t>(cells_[0]) + 1;
  layer_ = row_ * (static_cast<std::size_t>(cells_[1]) + 1);
  std::vector<Scalar> values(layer_ * (static_cast<std::size_t>(cells_[2]) + 1));
  for (std::size_t k = 0; k < values.size(); ++k) {
    const std::array<std::size_t, 3> at{k % row_, k % layer_ / row_, k / layer_};
    Vector3<Scalar> x = origin_;
    for (std::size_t i = 0; i < 3; ++i)
      x[static_cast<int>(i)] += Scalar(static_cast<double>(at[i])) * spacing_;
    values[k] = mesh.distance_at(x);
  }
  values_ = std::make_shared<const std::vector<Scalar>>(std::move(values));
}

template <RealScalar Scalar>
bool GridCollider<Scalar>::locate(const Vector3<Scalar>& x, Cell& cell) const {
  const std::array<std::size_t, 3> stride{1, row_, layer_};
  cell.first = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const int axis = static_cast<int>(i);
    const Scalar at = (x[axis] - origin_[axis]) * inverse_spacing_;
    if (at < Scalar(0) || Scalar(static_cast<double>(cells_[i])) < at) return false;
    const int whole = whole_part(at, cells_[i] - 1);
    cell.first += static_cast<std::size_t>(whole) * stride[i];
    cell.share[axis] = at - Scalar(static_cast<double>(whole));
  }
  return true;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
