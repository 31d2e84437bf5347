#pragma once

// Spring networks of sheets: a grid with threads along rows and columns, or any triangle mesh.
//
// Grid, spacing dx along a row and dz along a column. A spring stands for a strip of cloth as wide as its tributary
// width w (the other spacing; half of it on the border), so that a uniform strain costs the same energy on every grid:
//
//   edge of length l         k  = stretch · w / l                 square cells: stretch, half on the border
//   both diagonals of a cell k  = shear · (dx² + dz²)/(2 dx dz)   square cells: shear; G t = shear (γ stretches a
//                                                                 diagonal L by γ dx dz / L)
//   stencil 1,-2,1 on a row  kb = bending · (dz/dx) / dx²         from ½ B ∫ κ² dA with κ = |Σ w x| / dx², area dx dz;
//        and on a column     kb = bending · (dx/dz) / dz²         square cells: B/dx². Border rows count in full.
//   mass                     each cell gives a quarter of its mass to each of its vertices
//
// Triangles of area A, rest lengths l:
//
//   edge      k  = stretch · Σ A / l²         sum over the one or two triangles at the edge. Springs of one length in all
//                                             directions then have Young's modulus `stretch`, Poisson's ratio 1/3 and
//                                             shear modulus 3/8 stretch; Material::shear is not used
//   hinge     U  = ½ B/(A0+A1) |K x|²         K: cotangent weights of the two triangles at an interior edge
//   mass      each triangle gives a third of its mass to each of its vertices
//
// With c_i, d_i the cotangents of the two triangles' angles at the edge's ends i = 0, 1, K = (c1+d1, c0+d0) on the ends
// and -(c0+c1), -(d0+d1) on the opposite vertices. K annihilates affine maps of a flat pair; at small angles |K x| is
// edge length times fold angle. The energy is quadratic, so its Hessian is constant.
// Limits: the rest shape of a hinge is flat (a mesh that is curved at rest is pulled flat); it is exact for a cylinder on
// equilateral triangles and for bending along the legs of right-angled ones, else it depends on the mesh's directions.
// Reference: quadratic bending of isometric sheets (Bergou et al. 2006), with the factor 1/(A0+A1) in place of
// 3/(A0+A1), which counts a cylinder on equilateral triangles three times.

#include <array>
#include <string>
#include <type_traits>
#include <vector>

#include "clothctl/cloth/materials.hpp"
#include "clothctl/cloth/spring_network.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/mesh/topology.hpp"

namespace clothctl {

namespace detail {

/// Adds a spring of the given stiffness whose rest length is the distance of its vertices.
template <RealScalar Scalar>
void add_spring(SpringNetwork<Scalar>& network, int a, int b, const Scalar& stiffness, const Scalar& damping_time) {
  Spring<Scalar> spring;
  spring.a = a;
  spring.b = b;
  const Vector3<Scalar> d = network.rest_positions.col(b) - network.rest_positions.col(a);
  spring.rest_length = d.norm();
  spring.stiffness = stiffness;
  spring.damping = damping_time * stiffness;
  network.springs.push_back(spring);
}

/// Adds the second difference 1,-2,1 over three vertices in a row.
template <RealScalar Scalar>
void add_second_difference(SpringNetwork<Scalar>& network, int a, int b, int c, const Scalar& stiffness) {
  BendStencil<Scalar> stencil;
  stencil.vertex = {a, b, c, 0};
  stencil.weight = {Scalar(1), Scalar(-2), Scalar(1), Scalar(0)};
  stencil.stiffness = stiffness;
  stencil.count = 3;
  network.bends.push_back(stencil);
}

}  // namespace detail

/// Makes the spring network of a grid. Springs come in the order horizontal edges (row by row), vertical edges (row by
/// row), two diagonals a cell (up-right, then up-left); stencils in the order rows, columns. Allocates.
/// Complexity: O(vertices). Fails when: the material is out of range, or the mesh has no cells, the wrong number of
/// positions, or two neighbours in one place.
template <RealScalar Scalar>
Result<SpringNetwork<Scalar>> sheet_network(const GridMesh<Scalar>& mesh, const Material<Scalar>& material) {
  if (std::string problem = material.check(); !problem.empty()) return Error{problem};
  if (mesh.rows < 2 || mesh.cols < 2 || mesh.positions.cols() != static_cast<Index>(mesh.rows) * mesh.cols)
    return Error{"grid of " + std::to_string(mesh.rows) + " rows and " + std::to_string(mesh.cols) + " columns has " +
                 std::to_string(mesh.positions.cols()) + " positions"};
  const int rows = mesh.rows, cols = mesh.cols;
  const std::size_t cells = static_cast<std::size_t>(rows - 1) * static_cast<std::size_t>(cols - 1);
  const Scalar half(0.5), one(1.0);
  const Scalar dx = mesh.column_spacing(), dz = mesh.row_spacing();
  if (!is_finite(dx) || !(Scalar(0) < dx) || !is_finite(dz) || !(Scalar(0) < dz))
    return Error{"grid width and height must be positive, got " + number_text(mesh.width) + " and " + number_text(mesh.height)};

  SpringNetwork<Scalar> network;
  network.rest_positions = mesh.positions;
  network.triangles = mesh.triangles;
  network.mass = VectorX<Scalar>::Zero(mesh.positions.cols());
  network.springs.reserve(4 * cells + static_cast<std::size_t>(rows + cols));
  network.bends.reserve(2 * cells);

  const Scalar horizontal = material.stretch * (dz / dx), vertical = material.stretch * (dx / dz);
  const Scalar diagonal = material.shear * ((dx * dx + dz * dz) / (Scalar(2.0) * dx * dz));
  const Scalar time = material.damping_time;
  for (int row = 0; row < rows; ++row) {
    const Scalar share = row == 0 || row == rows - 1 ? half : one;
    for (int col = 0; col + 1 < cols; ++col)
      detail::add_spring(network, mesh.vertex(row, col), mesh.vertex(row, col + 1), Scalar(share * horizontal), time);
  }
  for (int row = 0; row + 1 < rows; ++row) {
    for (int col = 0; col < cols; ++col) {
      const Scalar share = col == 0 || col == cols - 1 ? half : one;
      detail::add_spring(network, mesh.vertex(row, col), mesh.vertex(row + 1, col), Scalar(share * vertical), time);
    }
  }
  const Scalar quarter_cell = Scalar(0.25) * material.area_density * dx * dz;
  for (int row = 0; row + 1 < rows; ++row) {
    for (int col = 0; col + 1 < cols; ++col) {
      const int a = mesh.vertex(row, col), b = mesh.vertex(row, col + 1);
      const int c = mesh.vertex(row + 1, col + 1), d = mesh.vertex(row + 1, col);
      detail::add_spring(network, a, c, diagonal, time);
      detail::add_spring(network, b, d, diagonal, time);
      for (int v : {a, b, c, d}) network.mass[v] += quarter_cell;
    }
  }
  const Scalar along_row = material.bending * (dz / dx) / (dx * dx);
  const Scalar along_column = material.bending * (dx / dz) / (dz * dz);
  for (int row = 0; row < rows; ++row) {
    for (int col = 1; col + 1 < cols; ++col)
      detail::add_second_difference(network, mesh.vertex(row, col - 1), mesh.vertex(row, col), mesh.vertex(row, col + 1),
                                    along_row);
  }
  for (int row = 1; row + 1 < rows; ++row) {
    for (int col = 0; col < cols; ++col)
      detail::add_second_difference(network, mesh.vertex(row - 1, col), mesh.vertex(row, col), mesh.vertex(row + 1, col),
                                    along_column);
  }
  if (std::string problem = network.check(); !problem.empty()) return Error{problem};
  return network;
}

/// Makes the spring network of a triangle mesh (positions 3×n, m). Springs come in the order of the topology's edges,
/// stencils in the order of its hinges. Allocates. Complexity: O(n log n).
/// Fails when: the material is out of range, the mesh is not a manifold, a position is not finite, a triangle has no
/// area, or a vertex belongs to no triangle.
template <RealScalar Scalar>
Result<SpringNetwork<Scalar>> sheet_network(const std::type_identity_t<PointsView<Scalar>>& positions,
                                            const std::vector<std::array<int, 3>>& triangles,
                                            const Material<Scalar>& material) {
  if (std::string problem = material.check(); !problem.empty()) return Error{problem};
  const Result<Topology> made = make_topology(static_cast<int>(positions.cols()), triangles);
  if (!made) return Error{made.error()};
  const Topology& topology = made.value();

  SpringNetwork<Scalar> network;
  network.rest_positions = positions;
  network.triangles = triangles;
  network.mass = VectorX<Scalar>::Zero(positions.cols());
  const Scalar zero(0.0), tiny = Scalar(16.0) * scalar_traits<Scalar>::epsilon();
  for (Index v = 0; v < positions.cols(); ++v) {
    if (!all_finite(positions.col(v))) return Error{"position of vertex " + std::to_string(v) + " is not finite"};
  }

  // Per triangle: area, and the cotangent at each corner (dot over twice the area).
  std::vector<Scalar> area(triangles.size(), zero);
  std::vector<std::array<Scalar, 3>> cotangent(triangles.size(), {zero, zero, zero});
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    std::array<Vector3<Scalar>, 3> corner;
    for (std::size_t i = 0; i < 3; ++i) corner[i] = positions.col(triangles[t][i]);
    const Vector3<Scalar> u = corner[1] - corner[0], w = corner[2] - corner[0];
    const Vector3<Scalar> normal(u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]);
    const Scalar twice = normal.norm();
    if (!(tiny * (u.squaredNorm() + w.squaredNorm()) < twice)) return Error{"triangle " + std::to_string(t) + " has no area"};
    area[t] = Scalar(0.5) * twice;
    for (std::size_t i = 0; i < 3; ++i) {
      const Vector3<Scalar> p = corner[(i + 1) % 3] - corner[i], q = corner[(i + 2) % 3] - corner[i];
      cotangent[t][i] = p.dot(q) / twice;
      network.mass[triangles[t][i]] += material.area_density * area[t] / Scalar(3.0);
    }
  }
  for (Index v = 0; v < positions.cols(); ++v) {
    if (!(zero < network.mass[v])) return Error{"vertex " + std::to_string(v) + " belongs to no triangle"};
  }

  network.springs.reserve(topology.edges.size());
  for (const MeshEdge& edge : topology.edges) {
    Scalar share = area[static_cast<std::size_t>(edge.triangle[0])];
    if (!edge.is_boundary()) share += area[static_cast<std::size_t>(edge.triangle[1])];
    const Vector3<Scalar> d = positions.col(edge.b) - positions.col(edge.a);
    detail::add_spring(network, edge.a, edge.b, Scalar(material.stretch * share / d.squaredNorm()), material.damping_time);
  }

  const auto cotangent_at = [&](int triangle, int vertex) {
    const std::size_t t = static_cast<std::size_t>(triangle);
    const std::size_t i = triangles[t][0] == vertex ? 0 : (triangles[t][1] == vertex ? 1 : 2);
    return cotangent[t][i];
  };
  network.bends.reserve(topology.hinges.size());
  for (const Hinge& hinge : topology.hinges) {
    const MeshEdge& edge = topology.edges[static_cast<std::size_t>(hinge.edge)];
    const int t0 = edge.triangle[0], t1 = edge.triangle[1];
    const Scalar c0 = cotangent_at(t0, edge.a), c1 = cotangent_at(t0, edge.b);
    const Scalar d0 = cotangent_at(t1, edge.a), d1 = cotangent_at(t1, edge.b);
    BendStencil<Scalar> stencil;
    stencil.vertex = hinge.vertex;
    stencil.weight = {c1 + d1, c0 + d0, zero - (c0 + c1), zero - (d0 + d1)};
    stencil.stiffness = material.bending / (area[static_cast<std::size_t>(t0)] + area[static_cast<std::size_t>(t1)]);
    stencil.count = 4;
    network.bends.push_back(stencil);
  }
  if (std::string problem = network.check(); !problem.empty()) return Error{problem};
  return network;
}

}  // namespace clothctl
