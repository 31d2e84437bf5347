#pragma once

// How the stiffness of a triangle mesh depends on direction when warp and weft differ. θ is the
// angle in the rest shape between a direction and the warp, u = cos 2θ.
//
//   g(θ) = 3/2 (cos 2θ - ⅓ cos 6θ) = 3u - 2u³      1 along the warp, -1 along the weft, |g| ≤ √2
//
//   edge along θ:                modulus            Y(θ) = Ȳ (1 + q g(θ))
//   fold that curves along θ:    bending stiffness  B(θ) = B̄ (1 + p g(θ))
//
//   q = (S_warp - S_weft)/(S_warp + S_weft)     Ȳ = 2 S_warp S_weft/((S_warp + S_weft)(1 - 9/8 q²))
//   p = (B_warp - B_weft)/(B_warp + B_weft)     B̄ = (B_warp + B_weft)/2
//
// S_warp, S_weft are Material::stretch_warp and stretch_weft, B_warp and B_weft its bending. If the
// edges point evenly in all directions, the sheet has the Young's moduli S_warp and S_weft (times
// thickness), and cylinders that curve along warp and weft have the energies ½ B_warp κ² and
// ½ B_weft κ² per area. The term cos 6θ adds nothing to these averages. On equilateral triangles,
// whose edges point in three directions only, it removes the error that depends on how the
// triangles lie: that of the cylinders wholly, that of the moduli to first order in q.
// docs/cloth_materials.md derives the formulas.

#include <array>
#include <string>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/quoted_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/mesh/topology.hpp"
#include "clothctl/network/materials.hpp"

namespace clothctl::inline CLOTHCTL_ABI {
namespace detail {

/// A stiffness as a function of direction.
template <RealScalar Scalar>
struct ThreadProfile {
  /// Mean over all directions.
  Scalar mean = Scalar(0);
  /// Factor of g: q or p above.
  Scalar contrast = Scalar(0);

  /// Returns the stiffness along the direction with u = cos 2θ.
  Scalar at(const Scalar& u) const {
    return mean * (Scalar(1) + contrast * (u * (Scalar(3) - Scalar(2) * u * u)));
  }
  /// Returns true when warp and weft are the same.
  bool uniform() const { return !(contrast < Scalar(0)) && !(Scalar(0) < contrast); }
};

/// Returns the modulus Y of edges. At equal values it is that value, bit by bit.
template <RealScalar Scalar>
ThreadProfile<Scalar> stretch_profile(const Material<Scalar>& material) {
  const Scalar &warp = material.stretch_warp, &weft = material.stretch_weft;
  if (!(warp < weft) && !(weft < warp)) return {warp, Scalar(0)};
  const Scalar sum = warp + weft, q = (warp - weft) / sum;
  return {Scalar(2) * warp * (weft / sum) / (Scalar(1) - Scalar(1.125) * q * q), q};
}

/// Returns the bending stiffness B of folds. At equal values it is that value, bit by bit.
template <RealScalar Scalar>
ThreadProfile<Scalar> bending_profile(const Material<Scalar>& material) {
  const Scalar &warp = material.bending_warp, &weft = material.bending_weft;
  if (!(warp < weft) && !(weft < warp)) return {warp, Scalar(0)};
  return {Scalar(0.5) * (warp + weft), (warp - weft) / (warp + weft)};
}

/// Returns why a triangle mesh cannot be made of a material, or "". Beyond a ratio of 5 (at 5.8) an
/// edge or fold of some direction would have a negative stiffness.
template <RealScalar Scalar>
std::string validate_contrast(const Material<Scalar>& material) {
  const auto beyond = [](const Scalar& a, const Scalar& b) { return Scalar(5) * b < a; };
  const auto line = [&](const char* quantity, const Scalar& warp, const Scalar& weft) {
    return "material " + quoted_text(material.name) + ": " + quantity + "_warp " +
           number_text(warp) + " and " + quantity + "_weft " + number_text(weft) +
           " differ by more than the factor 5 that a triangle mesh takes";
  };
  if (beyond(material.stretch_warp, material.stretch_weft) ||
      beyond(material.stretch_weft, material.stretch_warp))
    return line("stretch", material.stretch_warp, material.stretch_weft);
  if (beyond(material.bending_warp, material.bending_weft) ||
      beyond(material.bending_weft, material.bending_warp))
    return line("bending", material.bending_warp, material.bending_weft);
  return {};
}

/// cos 2θ of the angle between the warp and each edge of each triangle. Edge i lies opposite corner
/// i. Empty when the direction has no effect.
template <RealScalar Scalar>
using EdgeCosines = std::vector<std::array<Scalar, 3>>;

/// Returns cos 2θ of the angle between `along` and the unit vector `warp` of one plane.
template <RealScalar Scalar>
Scalar cosine_of_double_angle(const Vector3<Scalar>& along, const Vector3<Scalar>& warp) {
  const Scalar dot = along.dot(warp);
  const Scalar u = Scalar(2) * (dot * dot / along.squaredNorm()) - Scalar(1);
  return Scalar(1) < u ? Scalar(1) : u;
}

/// Returns cos 2θ at the edges of triangles whose warp is the direction `warp` of space, projected
/// onto their planes. Empty when `material` is the same along warp and weft. Allocates. Fails when:
/// `validate_contrast` finds a fault, `warp` is zero or not finite, or perpendicular to a triangle
/// (to 0.06 degrees) and has an effect.
template <RealScalar Scalar>
Result<EdgeCosines<Scalar>> edge_cosines(const Points<Scalar>& positions,
                                         const std::vector<std::array<int, 3>>& triangles,
                                         const Material<Scalar>& material,
                                         const Vector3<Scalar>& warp) {
  const std::string shown =
      number_text(warp[0]) + " " + number_text(warp[1]) + " " + number_text(warp[2]);
  const Scalar largest = warp.cwiseAbs().maxCoeff();
  if (!all_finite(warp) || !(Scalar(0) < largest))
    return Error{"warp direction must be finite and not zero, got " + shown};
  EdgeCosines<Scalar> out;
  if (std::string problem = validate_contrast(material); !problem.empty()) return Error{problem};
  if (stretch_profile(material).uniform() && bending_profile(material).uniform()) return out;
  Vector3<Scalar> unit = warp / largest;
  unit /= unit.norm();
  out.resize(triangles.size());
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const Vector3<Scalar> u = positions.col(triangles[t][1]) - positions.col(triangles[t][0]),
                          w = positions.col(triangles[t][2]) - positions.col(triangles[t][0]);
    Vector3<Scalar> normal(u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2],
                           u[0] * w[1] - u[1] * w[0]);
    normal /= normal.norm();
    Vector3<Scalar> flat = unit - normal * normal.dot(unit);
    const Scalar length = flat.norm();
    if (!(Scalar(1e-3) < length))
      return Error{"triangle " + std::to_string(t) + " is perpendicular to the warp direction " +
                   shown};
    flat /= length;
    out[t] = {cosine_of_double_angle<Scalar>(w - u, flat), cosine_of_double_angle<Scalar>(w, flat),
              cosine_of_double_angle<Scalar>(u, flat)};
  }
  return out;
}

/// Returns the stiffness at an edge: the mean over its triangles, by their areas, of the profile
/// along the edge (`sign` 1) or across it (-1, since cos 2(θ + 90°) = -cos 2θ).
template <RealScalar Scalar>
Scalar edge_stiffness(const ThreadProfile<Scalar>& profile, const MeshEdge& edge,
                      const std::vector<std::array<int, 3>>& triangles,
                      const std::vector<Scalar>& area, const EdgeCosines<Scalar>& cosines,
                      const Scalar& sign) {
  if (profile.uniform()) return profile.mean;
  Scalar sum(0.0), whole(0.0);
  for (std::size_t side = 0; side < (edge.is_boundary() ? 1u : 2u); ++side) {
    const std::size_t t = static_cast<std::size_t>(edge.triangle[side]);
    const int opposite = edge.opposite[side];
    const std::size_t i = triangles[t][0] == opposite ? 0 : (triangles[t][1] == opposite ? 1 : 2);
    sum += profile.at(sign * cosines[t][i]) * area[t];
    whole += area[t];
  }
  return sum / whole;
}

}  // namespace detail
}  // namespace clothctl::inline CLOTHCTL_ABI
