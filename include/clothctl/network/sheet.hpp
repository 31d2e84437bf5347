#pragma once

// Spring networks of sheets: a grid with threads along rows and columns, or any triangle mesh.
//
// Grid with spacing dx along a row (weft) and dz along a column (warp). A spring replaces a strip
// of cloth whose width w is the other spacing (half of it on the border). A uniform strain then
// costs the same energy on every grid:
//
//   edge of length l          k  = stretch · w / l, with stretch_weft in a row, stretch_warp in a
//                             column
//   both diagonals of a cell  k  = shear · (dx² + dz²)/(2 dx dz), since a shear angle γ stretches a
//                             diagonal of length L by γ dx dz / L
//   stencil 1,-2,1 on a row   kb = bending_weft · (dz/dx) / dx², from ½ bending ∫ κ² dA, curvature
//                             κ = |Σ w_i x_i| / dx² on the area dx dz
//        and on a column      kb = bending_warp · (dx/dz) / dz²; not halved on the border
//   mass                      each cell gives a quarter of its mass to each of its vertices
//
// On square cells k is stretch (half on the border) and shear, and kb is bending / dx².
//
// Triangles of area A, edges of rest length l:
//
//   edge      k  = Σ Y A / l², summed over the one or two triangles at the edge. Where warp
//             and weft are the same, Y = stretch; if the edges then point evenly in all
//             directions, the sheet has Young's modulus `stretch`, Poisson's ratio 1/3 and
//             shear modulus 3/8 stretch. Material::shear is not used
//   hinge     U  = ½ B/(A0+A1) |K x|², with K the cotangent weights of the two triangles at an
//             interior edge and B = bending where warp and weft are the same
//   mass      each triangle gives a third of its mass to each of its vertices
//
// Otherwise Y depends on the angle between the edge and the warp, and B on that between the fold's
// curvature and the warp; detail/thread_profile.hpp states both. The warp of a triangle is a given
// direction of space, projected onto its plane.
//
// With c_i, d_i the cotangents of the two triangles' angles at the ends i = 0, 1 of the edge, K has
// the weights (c1+d1, c0+d0) on the ends and -(c0+c1), -(d0+d1) on the opposite vertices. K x = 0
// for every affine map of a flat pair of triangles; at small angles |K x| is edge length times fold
// angle. The energy is quadratic, so its Hessian is constant. Hinges rest flat, so a mesh that is
// curved at rest is pulled flat; `set_rest_folds` (rest_folds.hpp) keeps its angles instead.
// Limits: the energy of a cylinder is exact on equilateral triangles and for bending along the legs
// of right-angled triangles; on other meshes it depends on the directions of the edges. Reference:
// quadratic bending of isometric sheets (Bergou et al. 2006). They have 3/(A0+A1) instead of
// 1/(A0+A1), which would give a cylinder on equilateral triangles three times its energy.

#include <array>
#include <string>
#include <type_traits>
#include <vector>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/mesh/topology.hpp"
#include "clothctl/network/detail/thread_profile.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Adds a spring of the given stiffness. Its rest length is the distance of its vertices.
template <RealScalar Scalar>
void add_spring(SpringNetwork<Scalar>& network, int a, int b, const Scalar& stiffness,
                const Scalar& damping_time, SpringKind kind = SpringKind::Structural) {
  Spring<Scalar> spring;
  spring.a = a;
  spring.b = b;
  const Vector3<Scalar> d = network.rest_positions.col(b) - network.rest_positions.col(a);
  spring.rest_length = d.norm();
  spring.stiffness = stiffness;
  spring.damping = damping_time * stiffness;
  spring.kind = kind;
  network.springs.push_back(spring);
}

/// Adds the bending stencil 1,-2,1 over three vertices in a row.
template <RealScalar Scalar>
void add_second_difference(SpringNetwork<Scalar>& network, int a, int b, int c,
                           const Scalar& stiffness) {
  BendStencil<Scalar> stencil;
  stencil.vertex = {a, b, c, 0};
  stencil.weight = {Scalar(1), Scalar(-2), Scalar(1), Scalar(0)};
  stencil.stiffness = stiffness;
  stencil.count = 3;
  network.bends.push_back(stencil);
}

/// Returns what is wrong with the counts or spacings of a grid, or "".
template <RealScalar Scalar>
std::string validate_grid(const GridMesh<Scalar>& mesh) {
  if (mesh.rows < 2 || mesh.cols < 2 ||
      mesh.positions.cols() != static_cast<Index>(mesh.rows) * mesh.cols)
    return "grid of " + std::to_string(mesh.rows) + " rows and " + std::to_string(mesh.cols) +
           " columns has " + std::to_string(mesh.positions.cols()) + " positions";
  const Scalar dx = mesh.column_spacing(), dz = mesh.row_spacing();
  if (!is_finite(dx) || !(Scalar(0) < dx) || !is_finite(dz) || !(Scalar(0) < dz))
    return "grid width and height must be positive, got " + number_text(mesh.width) + " and " +
           number_text(mesh.height);
  return {};
}

/// Adds the springs along the edges of a grid, rows before columns.
template <RealScalar Scalar>
void add_edge_springs(const GridMesh<Scalar>& mesh, const Material<Scalar>& material,
                      SpringNetwork<Scalar>& network) {
  const int rows = mesh.rows, cols = mesh.cols;
  const Scalar half(0.5), one(1.0);
  const Scalar dx = mesh.column_spacing(), dz = mesh.row_spacing();
  const Scalar horizontal = material.stretch_weft * (dz / dx),
               vertical = material.stretch_warp * (dx / dz);
  for (int row = 0; row < rows; ++row) {
    const Scalar share = row == 0 || row == rows - 1 ? half : one;
    for (int col = 0; col + 1 < cols; ++col)
      add_spring(network, mesh.vertex(row, col), mesh.vertex(row, col + 1),
                 Scalar(share * horizontal), material.damping_time);
  }
  for (int row = 0; row + 1 < rows; ++row) {
    for (int col = 0; col < cols; ++col) {
      const Scalar share = col == 0 || col == cols - 1 ? half : one;
      add_spring(network, mesh.vertex(row, col), mesh.vertex(row + 1, col),
                 Scalar(share * vertical), material.damping_time);
    }
  }
}

/// Adds the shear springs of a grid (two diagonals of each cell) and the mass of its cells.
template <RealScalar Scalar>
void add_cells(const GridMesh<Scalar>& mesh, const Material<Scalar>& material,
               SpringNetwork<Scalar>& network) {
  const Scalar dx = mesh.column_spacing(), dz = mesh.row_spacing();
  const Scalar diagonal = material.shear * ((dx * dx + dz * dz) / (Scalar(2.0) * dx * dz));
  const Scalar quarter_cell = Scalar(0.25) * material.area_density * dx * dz;
  for (int row = 0; row + 1 < mesh.rows; ++row) {
    for (int col = 0; col + 1 < mesh.cols; ++col) {
      const int a = mesh.vertex(row, col), b = mesh.vertex(row, col + 1);
      const int c = mesh.vertex(row + 1, col + 1), d = mesh.vertex(row + 1, col);
      add_spring(network, a, c, diagonal, material.damping_time, SpringKind::Shear);
      add_spring(network, b, d, diagonal, material.damping_time, SpringKind::Shear);
      for (int v : {a, b, c, d}) network.mass[v] += quarter_cell;
    }
  }
}

/// Adds the bending stencils of a grid, those along rows first.
template <RealScalar Scalar>
void add_bending(const GridMesh<Scalar>& mesh, const Material<Scalar>& material,
                 SpringNetwork<Scalar>& network) {
  const Scalar dx = mesh.column_spacing(), dz = mesh.row_spacing();
  const Scalar along_row = material.bending_weft * (dz / dx) / (dx * dx);
  const Scalar along_column = material.bending_warp * (dx / dz) / (dz * dz);
  for (int row = 0; row < mesh.rows; ++row) {
    for (int col = 1; col + 1 < mesh.cols; ++col)
      add_second_difference(network, mesh.vertex(row, col - 1), mesh.vertex(row, col),
                            mesh.vertex(row, col + 1), along_row);
  }
  for (int row = 1; row + 1 < mesh.rows; ++row) {
    for (int col = 0; col < mesh.cols; ++col)
      add_second_difference(network, mesh.vertex(row - 1, col), mesh.vertex(row, col),
                            mesh.vertex(row + 1, col), along_column);
  }
}

/// Area of each triangle and the cotangent of the angle at each of its corners.
template <RealScalar Scalar>
struct TriangleMeasures {
  std::vector<Scalar> area;
  std::vector<std::array<Scalar, 3>> cotangent;

  /// The cotangent at the corner of `triangles[triangle]` that is `vertex`.
  const Scalar& cotangent_at(const std::vector<std::array<int, 3>>& triangles, int triangle,
                             int vertex) const {
    const std::size_t t = static_cast<std::size_t>(triangle);
    const std::size_t i = triangles[t][0] == vertex ? 0 : (triangles[t][1] == vertex ? 1 : 2);
    return cotangent[t][i];
  }
};

/// Measures the triangles of a mesh. Allocates. Fails when: a triangle has no area.
template <RealScalar Scalar>
Result<TriangleMeasures<Scalar>> measure_triangles(
    const Points<Scalar>& positions, const std::vector<std::array<int, 3>>& triangles) {
  const Scalar zero(0.0), tiny = Scalar(16.0) * scalar_traits<Scalar>::epsilon();
  TriangleMeasures<Scalar> measures;
  measures.area.assign(triangles.size(), zero);
  measures.cotangent.assign(triangles.size(), {zero, zero, zero});
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    std::array<Vector3<Scalar>, 3> corner;
    for (std::size_t i = 0; i < 3; ++i) corner[i] = positions.col(triangles[t][i]);
    const Vector3<Scalar> u = corner[1] - corner[0], w = corner[2] - corner[0];
    const Vector3<Scalar> normal(u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2],
                                 u[0] * w[1] - u[1] * w[0]);
    const Scalar twice = normal.norm();
    if (!(tiny * (u.squaredNorm() + w.squaredNorm()) < twice))
      return Error{"triangle " + std::to_string(t) + " has no area"};
    measures.area[t] = Scalar(0.5) * twice;
    // The cotangent is the dot product of the two sides over twice the area.
    for (std::size_t i = 0; i < 3; ++i) {
      const Vector3<Scalar> p = corner[(i + 1) % 3] - corner[i],
                            q = corner[(i + 2) % 3] - corner[i];
      measures.cotangent[t][i] = p.dot(q) / twice;
    }
  }
  return measures;
}

/// Adds a spring along each edge of a triangle mesh.
template <RealScalar Scalar>
void add_edge_springs(const Topology& topology, const TriangleMeasures<Scalar>& measures,
                      const Material<Scalar>& material, const EdgeCosines<Scalar>& cosines,
                      SpringNetwork<Scalar>& network) {
  const ThreadProfile<Scalar> modulus = stretch_profile(material);
  network.springs.reserve(topology.edges.size());
  for (const MeshEdge& edge : topology.edges) {
    Scalar share = measures.area[static_cast<std::size_t>(edge.triangle[0])];
    if (!edge.is_boundary()) share += measures.area[static_cast<std::size_t>(edge.triangle[1])];
    const Vector3<Scalar> d =
        network.rest_positions.col(edge.b) - network.rest_positions.col(edge.a);
    const Scalar along =
        edge_stiffness(modulus, edge, network.triangles, measures.area, cosines, Scalar(1));
    add_spring(network, edge.a, edge.b, Scalar(along * share / d.squaredNorm()),
               material.damping_time);
  }
}

/// Adds the bending stencil K of each hinge of a triangle mesh. A fold curves across its edge.
template <RealScalar Scalar>
void add_bending(const Topology& topology, const TriangleMeasures<Scalar>& measures,
                 const Material<Scalar>& material, const EdgeCosines<Scalar>& cosines,
                 SpringNetwork<Scalar>& network) {
  const ThreadProfile<Scalar> bending = bending_profile(material);
  network.bends.reserve(topology.hinges.size());
  for (const Hinge& hinge : topology.hinges) {
    const MeshEdge& edge = topology.edges[static_cast<std::size_t>(hinge.edge)];
    const int t0 = edge.triangle[0], t1 = edge.triangle[1];
    const Scalar c0 = measures.cotangent_at(network.triangles, t0, edge.a),
                 c1 = measures.cotangent_at(network.triangles, t0, edge.b),
                 d0 = measures.cotangent_at(network.triangles, t1, edge.a),
                 d1 = measures.cotangent_at(network.triangles, t1, edge.b);
    BendStencil<Scalar> stencil;
    stencil.vertex = hinge.vertex;
    stencil.weight = {c1 + d1, c0 + d0, Scalar(0) - (c0 + c1), Scalar(0) - (d0 + d1)};
    stencil.stiffness =
        edge_stiffness(bending, edge, network.triangles, measures.area, cosines, Scalar(-1)) /
        (measures.area[static_cast<std::size_t>(t0)] + measures.area[static_cast<std::size_t>(t1)]);
    stencil.count = 4;
    network.bends.push_back(stencil);
  }
}

/// Gives a third of the mass of each triangle to each of its vertices. Returns "", or which vertex
/// belongs to no triangle.
template <RealScalar Scalar>
std::string lump_mass(const std::vector<Scalar>& area, const Scalar& area_density,
                      SpringNetwork<Scalar>& network) {
  for (std::size_t t = 0; t < area.size(); ++t) {
    for (int v : network.triangles[t]) network.mass[v] += area_density * area[t] / Scalar(3.0);
  }
  for (Index v = 0; v < network.mass.size(); ++v) {
    if (!(Scalar(0) < network.mass[v]))
      return "vertex " + std::to_string(v) + " belongs to no triangle";
  }
  return {};
}

}  // namespace detail

/// Makes the spring network of a grid. The order of its springs is: horizontal edges row by row,
/// vertical edges row by row, then two diagonals of each cell (up-right, up-left). Bending stencils
/// along rows come before those along columns. Allocates. Complexity: O(vertices). Fails when: a
/// value of the material is out of range, or the mesh has no cells, the wrong number of positions,
/// or two neighbours in one place.
template <RealScalar Scalar>
Result<SpringNetwork<Scalar>> sheet_network(const GridMesh<Scalar>& mesh,
                                            const Material<Scalar>& material) {
  if (std::string problem = material.validate(); !problem.empty()) return Error{problem};
  if (std::string problem = detail::validate_grid(mesh); !problem.empty()) return Error{problem};
  const std::size_t rows = static_cast<std::size_t>(mesh.rows),
                    cols = static_cast<std::size_t>(mesh.cols), cells = (rows - 1) * (cols - 1);
  SpringNetwork<Scalar> network;
  network.rest_positions = mesh.positions;
  network.triangles = mesh.triangles;
  network.mass = VectorX<Scalar>::Zero(mesh.positions.cols());
  network.springs.reserve(4 * cells + rows + cols);
  network.bends.reserve(2 * cells);
  detail::add_edge_springs(mesh, material, network);
  detail::add_cells(mesh, material, network);
  detail::add_bending(mesh, material, network);
  if (std::string problem = network.validate(); !problem.empty()) return Error{problem};
  return network;
}

/// Makes the spring network of a triangle mesh (positions 3×n, m). `warp` (any length) is the
/// direction of the warp threads in the rest shape; each triangle takes its projection onto its
/// plane. It has no effect where the material is the same along warp and weft. Springs have the
/// order of the edges of `make_topology`, stencils that of its hinges. Allocates. Complexity:
/// O(n log n). Fails when: a value of the material is out of range, stretch or bending of warp and
/// weft differ by more than a factor of 5, the mesh is not a manifold, a position is not finite, a
/// triangle has no area, a vertex belongs to no triangle, `warp` is zero or not finite, or (when it
/// has an effect) a triangle is perpendicular to it.
template <RealScalar Scalar>
Result<SpringNetwork<Scalar>> sheet_network(
    const std::type_identity_t<PointsView<Scalar>>& positions,
    const std::vector<std::array<int, 3>>& triangles, const Material<Scalar>& material,
    const std::type_identity_t<Vector3<Scalar>>& warp = {Scalar(0), Scalar(0), Scalar(1)}) {
  if (std::string problem = material.validate(); !problem.empty()) return Error{problem};
  const Result<Topology> made = make_topology(static_cast<int>(positions.cols()), triangles);
  if (!made) return Error{made.error()};
  const Topology& topology = made.value();

  SpringNetwork<Scalar> network;
  network.rest_positions = positions;
  network.triangles = triangles;
  network.mass = VectorX<Scalar>::Zero(positions.cols());
  for (Index v = 0; v < positions.cols(); ++v) {
    if (!all_finite(positions.col(v)))
      return Error{"position of vertex " + std::to_string(v) + " is not finite"};
  }
  const auto measured = detail::measure_triangles(network.rest_positions, triangles);
  if (!measured) return Error{measured.error()};
  const detail::TriangleMeasures<Scalar>& measures = measured.value();
  if (std::string problem = detail::lump_mass(measures.area, material.area_density, network);
      !problem.empty())
    return Error{problem};
  const auto cosines =
      detail::edge_cosines<Scalar>(network.rest_positions, triangles, material, warp);
  if (!cosines) return Error{cosines.error()};
  detail::add_edge_springs(topology, measures, material, cosines.value(), network);
  detail::add_bending(topology, measures, material, cosines.value(), network);
  if (std::string problem = network.validate(); !problem.empty()) return Error{problem};
  return network;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(Result<SpringNetwork<double>> sheet_network<double>(const GridMesh<double>&,
                                                                         const Material<double>&));

}  // namespace clothctl::inline CLOTHCTL_ABI
