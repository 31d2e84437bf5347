#pragma once

// The triangle elements of a position-based sheet (network/spring_network.hpp states their energy).
//
// With the corners p_0, p_1, p_2 and the inverse B of the edges at rest in the plane (u, v) of warp
// and weft, F = [p_1 - p_0, p_2 - p_0] B maps that plane to space. Its columns are
//
//   f_u = Σ a_i p_i,   a = (-B_00 - B_10, B_00, B_10)
//   f_v = Σ b_i p_i,   b = (-B_01 - B_11, B_01, B_11)
//
// and the constraints with their gradients, at p_i:
//
//   warp    C = |f_u| - 1          a_i f_u / |f_u|
//   weft    C = |f_v| - 1          b_i f_v / |f_v|
//   shear   C = f_u·f_v            a_i f_v + b_i f_u
//   area    C = A/A_0 - 1          with n the unit normal: n × (p_(i+2) - p_(i+1)) / (2 A_0)
//
// A = |(p_1 - p_0) × (p_2 - p_0)| / 2 is the area, A_0 = 1/(2 det B) the area at rest. Each
// gradient sums to zero, and so do its moments p_i × ∇_i C: momentum is kept. Green's strain has
// the entries E_uu = C (C + 2)/2 of the warp and E_uv = C/2 of the shear: to first order the same,
// but E_uu loses its gradient where a triangle collapses. A constraint of modulus k (N/m) has the
// compliance 1/(k A_0):
//
//   Δλ = -( h² k A_0 C + λ ) / ( h² k A_0 Σ w_i |∇_i C|² + 1 ),   p_i += w_i Δλ ∇_i C,   λ += Δλ
//
// w inverse masses, h substep. Elements are corrected one after the other in the order of the
// network, or in a sweep back in the opposite order. Where |f_u| or A vanishes, the gradient has no
// direction; there, and where all corners are held, the constraint is left out and λ stays.
// References:
// Müller, Chentanez, Kim, Macklin, "Strain Based Dynamics", 2014; Macklin, Müller, Chentanez,
// "XPBD", 2016.

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/detail/sweep_order.hpp"
#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The value and the gradients of a constraint.
template <RealScalar Scalar>
struct TriangleConstraint {
  Scalar value;
  std::array<Triple<Scalar>, 3> gradient;
};

/// The kinds of constraints, in the order in which they are corrected.
enum TriangleConstraintKind : std::size_t { kWarp, kWeft, kShear, kArea, kTriangleConstraints };

/// An element that is ready to be swept.
template <RealScalar Scalar>
struct TriangleItem {
  /// Corners.
  std::array<int, 3> vertex;
  /// Weights a and b, 1/m.
  std::array<Scalar, 3> warp, weft;
  /// A_0, m².
  Scalar area;
  /// k A_0 of each kind, N m.
  std::array<Scalar, kTriangleConstraints> stiffness;
};

/// Multipliers of an element, N m s².
template <RealScalar Scalar>
using TriangleMultipliers = std::array<Scalar, kTriangleConstraints>;

/// Returns the constraint |Σ c_i p_i| - 1.
template <RealScalar Scalar>
TriangleConstraint<Scalar> elongation(const std::array<Scalar, 3>& c,
                                      const std::array<Triple<Scalar>, 3>& p) {
  using std::sqrt;
  const Triple<Scalar> f = p[0] * c[0] + p[1] * c[1] + p[2] * c[2];
  const Scalar length = sqrt(squared_norm(f));
  const Triple<Scalar> n = f * (Scalar(0) < length ? Scalar(1) / length : Scalar(0));
  return {length - Scalar(1), {n * c[0], n * c[1], n * c[2]}};
}

/// Returns the constraint f_u·f_v.
template <RealScalar Scalar>
TriangleConstraint<Scalar> shear(const TriangleItem<Scalar>& t,
                                 const std::array<Triple<Scalar>, 3>& p) {
  const Triple<Scalar> fu = p[0] * t.warp[0] + p[1] * t.warp[1] + p[2] * t.warp[2];
  const Triple<Scalar> fv = p[0] * t.weft[0] + p[1] * t.weft[1] + p[2] * t.weft[2];
  TriangleConstraint<Scalar> out{dot(fu, fv), {}};
  for (std::size_t i = 0; i < 3; ++i) out.gradient[i] = fv * t.warp[i] + fu * t.weft[i];
  return out;
}

/// Returns the constraint A/A_0 - 1.
template <RealScalar Scalar>
TriangleConstraint<Scalar> area_change(const TriangleItem<Scalar>& t,
                                       const std::array<Triple<Scalar>, 3>& p) {
  using std::sqrt;
  const Triple<Scalar> normal = cross(p[1] - p[0], p[2] - p[0]);
  const Scalar twice = sqrt(squared_norm(normal)), rest = Scalar(2) * t.area;
  const Scalar scale = Scalar(0) < twice ? Scalar(1) / (rest * twice) : Scalar(0);
  const Triple<Scalar> n = normal * scale;
  TriangleConstraint<Scalar> out{twice / rest - Scalar(1), {}};
  for (std::size_t i = 0; i < 3; ++i) out.gradient[i] = cross(n, p[(i + 2) % 3] - p[(i + 1) % 3]);
  return out;
}

/// Returns a constraint of an element with its corners at `p`.
template <RealScalar Scalar>
TriangleConstraint<Scalar> triangle_constraint(const TriangleItem<Scalar>& t, std::size_t kind,
                                               const std::array<Triple<Scalar>, 3>& p) {
  if (kind == kWarp) return elongation(t.warp, p);
  if (kind == kWeft) return elongation(t.weft, p);
  return kind == kShear ? shear(t, p) : area_change(t, p);
}

/// Prepares the elements of a valid network that resist anything. Allocates.
template <RealScalar Scalar>
std::vector<TriangleItem<Scalar>> list_triangles(
    const std::vector<TriangleElement<Scalar>>& elements) {
  std::vector<TriangleItem<Scalar>> out;
  for (const TriangleElement<Scalar>& e : elements) {
    const auto& b = e.rest_inverse;
    TriangleItem<Scalar> t{e.vertex,
                           {-b(0, 0) - b(1, 0), b(0, 0), b(1, 0)},
                           {-b(0, 1) - b(1, 1), b(0, 1), b(1, 1)},
                           e.rest_area(),
                           {e.warp, e.weft, e.shear, e.area}};
    bool any = false;
    for (Scalar& k : t.stiffness) {
      any = any || Scalar(0) < k;
      k = k * t.area;
    }
    if (any) out.push_back(t);
  }
  return out;
}

/// Corrects the elements at some places once. `points` has x, y, z and w of a vertex side by side.
template <RealScalar Scalar>
void sweep_triangles(const std::vector<TriangleItem<Scalar>>& triangles, const Scalar& h,
                     std::vector<TriangleMultipliers<Scalar>>& multipliers, Scalar* points,
                     const SweepPlaces& places) {
  for (std::size_t i = 0; i < places.count(); ++i) {
    const std::size_t e = places[i];
    const TriangleItem<Scalar>& t = triangles[e];
    std::array<Triple<Scalar>, 3> p;
    std::array<Scalar*, 3> at;
    for (std::size_t k = 0; k < 3; ++k) {
      at[k] = points + 4 * static_cast<std::size_t>(t.vertex[k]);
      p[k] = {at[k][0], at[k][1], at[k][2]};
    }
    for (std::size_t kind = 0; kind < kTriangleConstraints; ++kind) {
      const Scalar stiffness = h * h * t.stiffness[kind];
      if (!(Scalar(0) < stiffness)) continue;
      const TriangleConstraint<Scalar> c = triangle_constraint(t, kind, p);
      Scalar mobility = Scalar(0);
      for (std::size_t k = 0; k < 3; ++k)
        mobility = mobility + at[k][3] * squared_norm(c.gradient[k]);
      if (!(Scalar(0) < mobility)) continue;  // nothing can move: λ would only add up
      Scalar& multiplier = multipliers[e][kind];
      const Scalar change =
          (Scalar(0) - stiffness * c.value - multiplier) / (stiffness * mobility + Scalar(1));
      multiplier = multiplier + change;
      for (std::size_t k = 0; k < 3; ++k) p[k] = p[k] + c.gradient[k] * Scalar(at[k][3] * change);
    }
    for (std::size_t k = 0; k < 3; ++k) {
      at[k][0] = p[k].x;
      at[k][1] = p[k].y;
      at[k][2] = p[k].z;
    }
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
