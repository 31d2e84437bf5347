#pragma once

// Air drag on triangles, from the velocity of the triangle relative to the air.
//
// Triangle t with corners a, b, c has area A, unit normal n and mean velocity v_t = (v_a + v_b + v_c)/3; the air moves at w.
// With r = w - v_t, split into r_n = (r·n) n and r_t = r - r_n, the air pushes it with
//
//     F = ½ ρ A ( Cn |r_n| r_n + Ct |r_t| r_t ),        a third of it on each corner.
//
// Written as F = C_t (w - v_t) with  C_t = ½ ρ A ( Cn |r_n| n nᵀ + Ct |r_t| (I - n nᵀ) ),  C_t frozen at the start of a
// step is symmetric positive semidefinite and F is linear in the velocity: an implicit model adds h C_t / 9 to each of the
// nine corner blocks of its step matrix. F does no work on the relative motion: F · (v_t - w) <= 0.

#include <array>
#include <string>
#include <type_traits>
#include <vector>

#include <Eigen/Geometry>

#include "clothctl/core/types.hpp"

namespace clothctl {

/// How the air acts on a sheet. Both coefficients at zero, the default: no air.
template <RealScalar Scalar>
struct AirSettings {
  /// Density ρ, kg/m³.
  Scalar density = Scalar(1.2);
  /// Drag coefficient Cn of the motion along the normal (a plate facing the flow: between 1 and 2).
  Scalar normal_coefficient = Scalar(0);
  /// Drag coefficient Ct of the motion along the surface (smooth cloth: a few hundredths).
  Scalar tangent_coefficient = Scalar(0);

  /// Tells whether the air exerts any force.
  bool enabled() const { return Scalar(0) < density && (Scalar(0) < normal_coefficient || Scalar(0) < tangent_coefficient); }

  /// Checks the values. Returns an empty string, or a line that names the first bad one.
  std::string check() const {
    const auto bad = [](const Scalar& value) { return !is_finite(value) || value < Scalar(0); };
    if (bad(density)) return "air density is negative or not finite";
    if (bad(normal_coefficient)) return "normal air coefficient is negative or not finite";
    if (bad(tangent_coefficient)) return "tangent air coefficient is negative or not finite";
    return {};
  }
};

namespace detail {

/// Unit normal and area of a triangle; the area is 0 where the corners lie on a line to rounding.
template <RealScalar Scalar>
struct AirFacet {
  Vector3<Scalar> normal = Vector3<Scalar>::Zero();
  Scalar area = Scalar(0);

  AirFacet(const Vector3<Scalar>& x_a, const Vector3<Scalar>& x_b, const Vector3<Scalar>& x_c) {
    using std::sqrt;
    const Vector3<Scalar> ab = x_b - x_a;
    const Vector3<Scalar> ac = x_c - x_a;
    const Vector3<Scalar> cross = ab.cross(ac);
    const Scalar length = sqrt(cross.squaredNorm());
    if (length > scalar_traits<Scalar>::epsilon() * (ab.squaredNorm() + ac.squaredNorm())) {
      normal = cross / length;
      area = Scalar(0.5) * length;
    }
  }
};

/// The two eigenvalues of C_t for the relative velocity r: along the normal and along the surface, N s/m.
template <RealScalar Scalar>
struct AirDrag {
  Scalar along_normal;
  Scalar along_surface;

  AirDrag(const AirFacet<Scalar>& facet, const Vector3<Scalar>& r, const AirSettings<Scalar>& settings) {
    using std::abs;
    using std::sqrt;
    const Scalar r_n = r.dot(facet.normal);
    const Vector3<Scalar> r_t = r - r_n * facet.normal;
    const Scalar half_rho_area = Scalar(0.5) * settings.density * facet.area;
    along_normal = half_rho_area * settings.normal_coefficient * abs(r_n);
    along_surface = half_rho_area * settings.tangent_coefficient * sqrt(r_t.squaredNorm());
  }
};

}  // namespace detail

/// Computes C_t (N s/m, symmetric positive semidefinite) of the triangle x_a, x_b, x_c (m) that moves at `v_mean` in air
/// that moves at `wind` (m/s); zero where the corners lie on a line.
template <RealScalar Scalar>
Matrix3<Scalar> air_drag_matrix(const std::type_identity_t<Vector3<Scalar>>& x_a,
                                const std::type_identity_t<Vector3<Scalar>>& x_b,
                                const std::type_identity_t<Vector3<Scalar>>& x_c,
                                const std::type_identity_t<Vector3<Scalar>>& v_mean,
                                const std::type_identity_t<Vector3<Scalar>>& wind, const AirSettings<Scalar>& settings) {
  const detail::AirFacet<Scalar> facet(x_a, x_b, x_c);
  const Vector3<Scalar> r = wind - v_mean;
  const detail::AirDrag<Scalar> drag(facet, r, settings);
  Matrix3<Scalar> C = (drag.along_normal - drag.along_surface) * facet.normal * facet.normal.transpose();
  C.diagonal().array() += drag.along_surface;
  return C;
}

/// Adds the air's forces (N) at positions `x` (3×n, m) and velocities `v` (3×n, m/s) to `forces` (3×n).
/// Complexity: O(triangles).
template <RealScalar Scalar>
void add_air_forces(const std::vector<std::array<int, 3>>& triangles, std::type_identity_t<PointsView<Scalar>> x,
                    std::type_identity_t<PointsView<Scalar>> v, const std::type_identity_t<Vector3<Scalar>>& wind,
                    const AirSettings<Scalar>& settings, Points<Scalar>& forces) {
  if (!settings.enabled()) return;
  for (const std::array<int, 3>& t : triangles) {
    const detail::AirFacet<Scalar> facet(x.col(t[0]), x.col(t[1]), x.col(t[2]));
    const Vector3<Scalar> r = wind - (v.col(t[0]) + v.col(t[1]) + v.col(t[2])) / Scalar(3);
    const detail::AirDrag<Scalar> drag(facet, r, settings);
    const Scalar r_n = r.dot(facet.normal);
    const Vector3<Scalar> third =
        ((drag.along_normal - drag.along_surface) * r_n * facet.normal + drag.along_surface * r) / Scalar(3);
    for (int vertex : t) forces.col(vertex) += third;
  }
}

/// Lets the air act on the velocities `v` (3×n, m/s) for `h` seconds, triangle after triangle, each with its C_t frozen and
/// its own velocity change taken implicitly. Because Σ ½ m |v - w|² falls with every triangle, this is stable for any h,
/// wind and mass. Vertices with inverse mass 0 keep their velocity. Complexity: O(triangles).
template <RealScalar Scalar>
void apply_air_impulses(const std::vector<std::array<int, 3>>& triangles, std::type_identity_t<PointsView<Scalar>> x,
                        const VectorX<Scalar>& inverse_mass, const std::type_identity_t<Vector3<Scalar>>& wind,
                        const std::type_identity_t<Scalar>& h, const AirSettings<Scalar>& settings, Points<Scalar>& v) {
  if (!settings.enabled()) return;
  for (const std::array<int, 3>& t : triangles) {
    const detail::AirFacet<Scalar> facet(x.col(t[0]), x.col(t[1]), x.col(t[2]));
    const Vector3<Scalar> r = wind - (v.col(t[0]) + v.col(t[1]) + v.col(t[2])) / Scalar(3);
    const detail::AirDrag<Scalar> drag(facet, r, settings);
    // An impulse J on the triangle changes v_t by J Σw/9, so J = h c (r - J Σw/9) along the normal and along the surface.
    const Scalar w = (inverse_mass[t[0]] + inverse_mass[t[1]] + inverse_mass[t[2]]) / Scalar(9);
    const Scalar j_n = h * drag.along_normal / (Scalar(1) + h * drag.along_normal * w);
    const Scalar j_t = h * drag.along_surface / (Scalar(1) + h * drag.along_surface * w);
    const Vector3<Scalar> third = ((j_n - j_t) * r.dot(facet.normal) * facet.normal + j_t * r) / Scalar(3);
    for (int vertex : t) v.col(vertex) += inverse_mass[vertex] * third;
  }
}

}  // namespace clothctl
