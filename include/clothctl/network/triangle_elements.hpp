#pragma once

// Sheets of elastic triangles: gives each triangle of a network an element that resists elongation
// along warp and weft, shear between them, and change of area. spring_network.hpp states the
// energy; PositionBased simulates it.
//
// For small strains ε_u, ε_v, γ and a sheet with the moduli k of an element, the tensions (N/m) are
//
//   n_u = k_warp ε_u + k_area (ε_u + ε_v),   n_v = k_weft ε_v + k_area (ε_u + ε_v),
//   n_uv = k_shear γ
//
// An isotropic sheet of tensile modulus E t (N/m) and Poisson's ratio ν has
// k_warp = k_weft = E t/(1 + ν), k_area = E t ν/(1 - ν²) and k_shear = E t/(2 (1 + ν)).

#include <array>
#include <cstddef>
#include <string>
#include <utility>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/network/spring_network.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// Moduli of a sheet of triangle elements, N/m. Zero switches a constraint off.
template <RealScalar Scalar>
struct MembraneStiffness {
  /// Along warp, along weft, in shear, and against a change of area.
  Scalar warp = Scalar(0), weft = Scalar(0), shear = Scalar(0), area = Scalar(0);

  /// Returns the moduli of an isotropic sheet of tensile modulus `tensile` (N/m) and Poisson's
  /// ratio `poisson` (0 to below 1).
  static MembraneStiffness isotropic(const Scalar& tensile, const Scalar& poisson) {
    const Scalar one = Scalar(1), along = tensile / (one + poisson);
    return {along, along, Scalar(0.5) * along, along * poisson / (one - poisson)};
  }
};

/// Coordinates along warp (first row) and weft (second row), 2×k, m.
template <RealScalar Scalar>
using MaterialPoints = DenseMatrix<Scalar, 2, Eigen::Dynamic>;

namespace detail {

/// Returns the error of a triangle of this area at rest, m². Allocates.
template <RealScalar Scalar>
Error degenerate_triangle(std::size_t triangle, const Scalar& area) {
  return Error{"triangle " + std::to_string(triangle) +
               " is degenerate or inverted at rest: area " + number_text(area) + " m²"};
}

/// Appends an element for each triangle; `edges(t, corners)` returns the edges 0-1 and 0-2 of
/// triangle t in warp and weft, the columns of a 2×2 matrix, or why there are none.
template <RealScalar Scalar, class Edges>
Result<SpringNetwork<Scalar>> append_elements(SpringNetwork<Scalar> network,
                                              const MembraneStiffness<Scalar>& stiffness,
                                              Edges edges) {
  if (network.triangles.empty()) return Error{"the network has no triangles to make elements of"};
  if (std::string problem = network.validate(); !problem.empty()) return Error{std::move(problem)};
  for (std::size_t t = 0; t < network.triangles.size(); ++t) {
    TriangleElement<Scalar> element;
    element.vertex = network.triangles[t];
    const Result<DenseMatrix<Scalar, 2, 2>> found = edges(t, network.triangles[t]);
    if (!found) return Error{found.error()};
    const DenseMatrix<Scalar, 2, 2>& rest = found.value();
    if (!element.set_rest(rest))
      return degenerate_triangle<Scalar>(t, Scalar(0.5) * element_determinant<Scalar>(rest));
    element.warp = stiffness.warp;
    element.weft = stiffness.weft;
    element.shear = stiffness.shear;
    element.area = stiffness.area;
    network.elements.push_back(element);
  }
  if (std::string problem = network.validate(); !problem.empty()) return Error{std::move(problem)};
  return network;
}

}  // namespace detail

/// Appends an element over each triangle of a network; springs and other elements stay.
/// `coordinates` has the warp and weft coordinates of every vertex at rest. Allocates. Fails when:
/// the network has no triangles or is not valid, there is another number of coordinates than
/// vertices, one is not finite, a triangle is degenerate or inverted (clockwise) in them, or a
/// modulus is negative or not finite.
template <RealScalar Scalar>
Result<SpringNetwork<Scalar>> add_flat_triangle_elements(
    SpringNetwork<Scalar> network, const Eigen::Ref<const MaterialPoints<Scalar>>& coordinates,
    const MembraneStiffness<Scalar>& stiffness) {
  if (coordinates.cols() != network.vertex_count())
    return Error{std::to_string(coordinates.cols()) + " material coordinates for " +
                 std::to_string(network.vertex_count()) + " vertices"};
  for (Index v = 0; v < coordinates.cols(); ++v) {
    for (Index c = 0; c < 2; ++c) {
      if (!is_finite(coordinates(c, v)))
        return Error{"material coordinate of vertex " + std::to_string(v) + ": " +
                     (c == 0 ? "warp" : "weft") + " is " + number_text(coordinates(c, v))};
    }
  }
  return detail::append_elements<Scalar>(
      std::move(network), stiffness,
      [&](std::size_t, const std::array<int, 3>& t) -> Result<DenseMatrix<Scalar, 2, 2>> {
        DenseMatrix<Scalar, 2, 2> edges;
        for (Index c = 0; c < 2; ++c) {
          edges(c, 0) = coordinates(c, t[1]) - coordinates(c, t[0]);
          edges(c, 1) = coordinates(c, t[2]) - coordinates(c, t[0]);
        }
        return edges;
      });
}

/// Appends an element over each triangle of a sheet that may be curved at rest; springs and other
/// elements stay. The shape of each triangle is that of the network's `rest_positions`, and its
/// warp is the projection of `warp_direction` (3-vector, any length) onto its plane. Allocates.
/// Fails when: the network has no triangles or is not valid, the direction is zero, not finite or
/// normal to a triangle (within 1e-6 rad), a triangle is degenerate, or a modulus is negative or
/// not finite.
template <RealScalar Scalar>
Result<SpringNetwork<Scalar>> add_triangle_elements(SpringNetwork<Scalar> network,
                                                    const Vector3<Scalar>& warp_direction,
                                                    const MembraneStiffness<Scalar>& stiffness) {
  if (!all_finite(warp_direction)) return Error{"the warp direction is not finite"};
  const Scalar largest = warp_direction.cwiseAbs().maxCoeff();
  if (!(Scalar(0) < largest)) return Error{"the warp direction is zero"};
  const Vector3<Scalar> direction = warp_direction / largest;  // its square fits the scalar
  const Points<Scalar> rest = network.rest_positions;
  return detail::append_elements<Scalar>(
      std::move(network), stiffness,
      [&](std::size_t triangle, const std::array<int, 3>& t) -> Result<DenseMatrix<Scalar, 2, 2>> {
        const Vector3<Scalar> first = rest.col(t[1]) - rest.col(t[0]);
        const Vector3<Scalar> second = rest.col(t[2]) - rest.col(t[0]);
        Vector3<Scalar> normal = first.cross(second);
        const Scalar twice = normal.norm();
        if (!(Scalar(1e-6) * (first.squaredNorm() + second.squaredNorm()) < twice))
          return detail::degenerate_triangle<Scalar>(triangle, Scalar(0.5) * twice);
        normal = normal / twice;
        Vector3<Scalar> warp = direction - normal * normal.dot(direction);
        const Scalar size = warp.norm();
        if (!(Scalar(1e-6) * direction.norm() < size))
          return Error{"the warp direction is normal to triangle " + std::to_string(triangle)};
        warp = warp / size;
        const Vector3<Scalar> weft = normal.cross(warp);
        DenseMatrix<Scalar, 2, 2> edges;
        edges(0, 0) = warp.dot(first);
        edges(0, 1) = warp.dot(second);
        edges(1, 0) = weft.dot(first);
        edges(1, 1) = weft.dot(second);
        return edges;
      });
}

}  // namespace clothctl::inline CLOTHCTL_ABI
