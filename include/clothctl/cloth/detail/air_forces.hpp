#pragma once

// Air drag on triangles, from the velocity of the triangle relative to the air.
//
// A triangle with corners a, b, c has the area A, the unit normal n and the mean velocity v_t =
// (v_a + v_b + v_c)/3. The air moves at w. Relative to the triangle it moves at r = w - v_t, with
// the parts r_n = (r·n) n and r_t = r - r_n. With the density ρ and the drag coefficients Cn and Ct
// (AirSettings), the air pushes the triangle with
//
//     F = ½ ρ A ( Cn |r_n| r_n + Ct |r_t| r_t ),        a third of it on each corner.
//
// With  C_t = ½ ρ A ( Cn |r_n| n nᵀ + Ct |r_t| (I - n nᵀ) )  this is F = C_t (w - v_t). The matrix
// C_t of triangle t is symmetric positive semidefinite. An implicit model keeps its value from the
// start of a step, so that F is linear in the velocity, and adds h C_t / 9 to each of the nine
// blocks that couple the corners in its step matrix. Drag never adds energy to the relative motion:
// F · (v_t - w) <= 0.

#include <array>
#include <cmath>
#include <type_traits>
#include <vector>

#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Unit normal and area of a triangle. Both are zero when the corners lie on a line up to rounding.
template <RealScalar Scalar>
struct AirFacet {
  Triple<Scalar> normal{Scalar(0), Scalar(0), Scalar(0)};
  Scalar area = Scalar(0);

  AirFacet(const Triple<Scalar>& x_a, const Triple<Scalar>& x_b, const Triple<Scalar>& x_c) {
    using std::sqrt;
    const Triple<Scalar> ab = x_b - x_a, ac = x_c - x_a;
    const Triple<Scalar> twice_area = cross(ab, ac);
    const Scalar length = sqrt(squared_norm(twice_area));
    if (length > scalar_traits<Scalar>::epsilon() * (squared_norm(ab) + squared_norm(ac))) {
      normal = twice_area / length;
      area = Scalar(0.5) * length;
    }
  }
};

/// The two eigenvalues of C_t for the relative velocity r: along the normal and along the surface,
/// N s/m.
template <RealScalar Scalar>
struct AirDrag {
  Scalar along_normal;
  Scalar along_surface;

  AirDrag(const AirFacet<Scalar>& facet, const Triple<Scalar>& r,
          const AirSettings<Scalar>& settings) {
    using std::abs;
    using std::sqrt;
    const Scalar r_n = dot(r, facet.normal);
    const Triple<Scalar> r_t = r - facet.normal * r_n;
    const Scalar half_rho_area = Scalar(0.5) * settings.density * facet.area;
    along_normal = half_rho_area * settings.normal_coefficient * abs(r_n);
    along_surface = half_rho_area * settings.tangent_coefficient * sqrt(squared_norm(r_t));
  }
};

/// Returns C_t (N s/m, symmetric positive semidefinite) from its eigenvalues and the normal. It is
/// zero when the corners lie on a line.
template <RealScalar Scalar>
Matrix3<Scalar> air_drag_matrix(const AirFacet<Scalar>& facet, const AirDrag<Scalar>& drag) {
  const Scalar difference = drag.along_normal - drag.along_surface;
  const std::array<Scalar, 3> n{facet.normal.x, facet.normal.y, facet.normal.z};
  Matrix3<Scalar> C;
  for (Index j = 0; j < 3; ++j) {
    for (Index i = 0; i < 3; ++i)
      C(i, j) = difference * n[static_cast<std::size_t>(i)] * n[static_cast<std::size_t>(j)];
    C(j, j) = C(j, j) + drag.along_surface;
  }
  return C;
}

/// Returns C_t of the triangle x_a, x_b, x_c (m) that moves at `v_mean` in air that moves at `wind`
/// (m/s).
template <RealScalar Scalar>
Matrix3<Scalar> air_drag_matrix(const std::type_identity_t<Vector3<Scalar>>& x_a,
                                const std::type_identity_t<Vector3<Scalar>>& x_b,
                                const std::type_identity_t<Vector3<Scalar>>& x_c,
                                const std::type_identity_t<Vector3<Scalar>>& v_mean,
                                const std::type_identity_t<Vector3<Scalar>>& wind,
                                const AirSettings<Scalar>& settings) {
  const AirFacet<Scalar> facet(triple(x_a), triple(x_b), triple(x_c));
  return air_drag_matrix(facet, AirDrag<Scalar>(facet, triple(wind) - triple(v_mean), settings));
}

/// Adds the air's forces (N) at positions `x` (3×n, m) and velocities `v` (3×n, m/s) to `forces`
/// (3×n). Complexity: O(triangles).
template <RealScalar Scalar>
void add_air_forces(const std::vector<std::array<int, 3>>& triangles,
                    std::type_identity_t<PointsView<Scalar>> x,
                    std::type_identity_t<PointsView<Scalar>> v,
                    const std::type_identity_t<Vector3<Scalar>>& wind,
                    const AirSettings<Scalar>& settings, Points<Scalar>& forces) {
  if (!settings.enabled()) return;
  for (const std::array<int, 3>& t : triangles) {
    const AirFacet<Scalar> facet(column(x, t[0]), column(x, t[1]), column(x, t[2]));
    const Triple<Scalar> r =
        triple(wind) - (column(v, t[0]) + column(v, t[1]) + column(v, t[2])) / Scalar(3);
    const AirDrag<Scalar> drag(facet, r, settings);
    const Scalar r_n = dot(r, facet.normal);
    const Triple<Scalar> third =
        (facet.normal * ((drag.along_normal - drag.along_surface) * r_n) + r * drag.along_surface) /
        Scalar(3);
    for (int vertex : t) add_to_column(forces, vertex, third);
  }
}

/// Adds the effect of the air over `h` seconds to the velocities `v` (3×n, m/s), one triangle after
/// the other. C_t of a triangle is frozen, and its velocity change is implicit. Every triangle
/// lowers Σ ½ m |v - w|², so this is stable for any h, wind and mass. Vertices with inverse mass 0
/// keep their velocity. Complexity: O(triangles).
template <RealScalar Scalar>
void apply_air_impulses(const std::vector<std::array<int, 3>>& triangles,
                        std::type_identity_t<PointsView<Scalar>> x,
                        const VectorX<Scalar>& inverse_mass,
                        const std::type_identity_t<Vector3<Scalar>>& wind,
                        const std::type_identity_t<Scalar>& h, const AirSettings<Scalar>& settings,
                        Points<Scalar>& v) {
  if (!settings.enabled()) return;
  for (const std::array<int, 3>& t : triangles) {
    const AirFacet<Scalar> facet(column(x, t[0]), column(x, t[1]), column(x, t[2]));
    const Triple<Scalar> r =
        triple(wind) - (column(v, t[0]) + column(v, t[1]) + column(v, t[2])) / Scalar(3);
    const AirDrag<Scalar> drag(facet, r, settings);
    // An impulse J, a third of it on each corner, changes v_t by w J, with w = Σ 1/(9 m) over the
    // corners. So J = h c (r - w J), with c the drag along the normal or along the surface.
    const Scalar w = (inverse_mass[t[0]] + inverse_mass[t[1]] + inverse_mass[t[2]]) / Scalar(9);
    const Scalar j_n = h * drag.along_normal / (Scalar(1) + h * drag.along_normal * w);
    const Scalar j_t = h * drag.along_surface / (Scalar(1) + h * drag.along_surface * w);
    const Triple<Scalar> third =
        (facet.normal * ((j_n - j_t) * dot(r, facet.normal)) + r * j_t) / Scalar(3);
    for (int vertex : t) add_to_column(v, vertex, third * inverse_mass[vertex]);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
