#pragma once

// Bending that rests in a curved shape. Every hinge takes the angle θ0 between its two triangles at
// given positions as its rest angle:
//
//   tan(θ0/2) = -2 m_3·(u × m_2) / |m_2 - m_3|²
//
// with u along the edge and m_2, m_3 perpendicular to it in the two triangles, unit vectors all
// (spring_network.hpp has the energy). Weights and stiffness of the stencils stay.

#include <array>
#include <cmath>
#include <string>
#include <type_traits>
#include <vector>

#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Returns tan(θ0/2) of the hinge of four vertices (BendStencil has their order) at positions `x`
/// (3×n, m); below rounding it is 0. Not finite or above 1e6 when the triangles are folded onto
/// each other; not finite when one has no area or a position is not finite.
template <RealScalar Scalar>
Scalar measure_fold(const std::array<int, 4>& vertex, const Points<Scalar>& x) {
  using std::sqrt;
  const auto cross = [](const Vector3<Scalar>& a, const Vector3<Scalar>& b) {
    return Vector3<Scalar>(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                           a[0] * b[1] - a[1] * b[0]);
  };
  const auto unit = [](const Vector3<Scalar>& a) {
    return Vector3<Scalar>(a * (Scalar(1) / sqrt(a.squaredNorm())));
  };
  const Vector3<Scalar> origin = x.col(vertex[0]);
  const Vector3<Scalar> u = unit(Vector3<Scalar>(x.col(vertex[1]) - origin));
  std::array<Vector3<Scalar>, 2> side;
  for (std::size_t i = 0; i < 2; ++i) {
    const Vector3<Scalar> a = x.col(vertex[2 + i]) - origin;
    side[i] = unit(Vector3<Scalar>(a - u * u.dot(a)));
  }
  const Vector3<Scalar> apart = side[0] - side[1];
  const Scalar fold = Scalar(-2) * side[1].dot(cross(u, side[0])) / apart.squaredNorm();
  if (!is_finite(fold)) return fold;  // -ffast-math lets comparisons with NaN be true
  const Scalar rounding = Scalar(64) * scalar_traits<Scalar>::epsilon();
  return fold < rounding && -rounding < fold ? Scalar(0) : fold;
}

}  // namespace detail

/// Lets the hinges of a network rest at the angles that they have at `positions` (3×n, m), e.g.
/// `network.rest_positions` of a sheet made by `sheet_network(positions, triangles, material)`, or
/// the state of a sheet that shall keep its folds. At flat positions it makes all hinges flat
/// again. Returns an empty string on success. Allocates. Complexity: O(hinges). Fails when:
/// `positions` is of another size or not finite, a stencil has fewer than four vertices (rows of a
/// grid, ropes: three vertices in a row do not tell one side of the sheet from the other), or the
/// triangles of a hinge have no area or are folded onto each other. The network is then unchanged,
/// and the returned line says why.
template <RealScalar Scalar>
[[nodiscard]] std::string set_rest_folds(
    SpringNetwork<Scalar>& network, const std::type_identity_t<PointsView<Scalar>>& positions) {
  if (positions.cols() != network.vertex_count())
    return "set_rest_folds: " + std::to_string(positions.cols()) + " positions for " +
           std::to_string(network.vertex_count()) + " vertices";
  const Points<Scalar> x = positions;
  for (Index v = 0; v < x.cols(); ++v) {
    if (!all_finite(x.col(v)))
      return "set_rest_folds: position of vertex " + std::to_string(v) + " is not finite";
  }
  std::vector<Scalar> folds;
  folds.reserve(network.bends.size());
  for (std::size_t e = 0; e < network.bends.size(); ++e) {
    BendStencil<Scalar> stencil = network.bends[e];
    const std::string name = "set_rest_folds: bending stencil " + std::to_string(e);
    if (stencil.count != 4)
      return name + " has " + std::to_string(stencil.count) + " vertices, not those of a hinge";
    for (const int v : stencil.vertex) {
      if (v < 0 || v >= network.vertex_count())
        return name + " holds vertex " + std::to_string(v) + " off the mesh";
    }
    stencil.rest_fold = detail::measure_fold<Scalar>(stencil.vertex, x);
    if (!stencil.validate_fold().empty())
      return name +
             " has a triangle without area, two that are folded onto each other, or "
             "weights that are not those of a hinge";
    folds.push_back(stencil.rest_fold);
  }
  for (std::size_t e = 0; e < folds.size(); ++e) network.bends[e].rest_fold = folds[e];
  return {};
}

}  // namespace clothctl::inline CLOTHCTL_ABI
