#pragma once

// Coulomb's cone |f_t| <= μ f_n, f_n >= 0 about a contact normal n, replaced by the cone of n_g generators
//
//   s_i = (n + μ t_i) / √(1 + μ²),   t_i = cos(2πi/n_g) t_1 + sin(2πi/n_g) t_2,   f = Σ d_i s_i,  d >= 0
//
// The pyramid lies inside the cone: whatever d >= 0, the true cone holds. With n_g = 4 (paper 000, eq. 1-2) up to
// 1 - cos(π/4) = 29 % of the friction is given away between generators; n_g = 8 leaves 8 %.
// Normal part of f:  f_n = Σ d_i / √(1 + μ²).

#include <cassert>
#include <cmath>
#include <numbers>
#include <type_traits>

#include <Eigen/Geometry>

#include "clothctl/core/types.hpp"

namespace clothctl {

/// Writes two unit tangents that make a right-handed frame (t1, t2, n) with the unit normal `normal`. Continuous in the normal
/// but where |n_z| passes 0.9. Never allocates.
template <RealScalar Scalar>
void tangent_frame(const Vector3<Scalar>& normal, Vector3<Scalar>& t1, Vector3<Scalar>& t2) {
  using std::abs;
  using std::sqrt;
  const Vector3<Scalar> helper = abs(normal[2]) < Scalar(0.9) ? Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1))
                                                              : Vector3<Scalar>(Scalar(1), Scalar(0), Scalar(0));
  t1 = helper.cross(normal);
  t1 /= sqrt(t1.squaredNorm());
  t2 = normal.cross(t1);
}

/// Writes the `generators.cols()` unit generators of the cone about `normal` (unit) with friction coefficient `friction`
/// into the columns of `generators` (3×n_g, n_g >= 4). Never allocates. Reference: paper 000, eq. 1.
template <RealScalar Scalar>
void friction_generators(const Vector3<Scalar>& normal, const std::type_identity_t<Scalar>& friction,
                         std::type_identity_t<Eigen::Ref<Points<Scalar>>> generators) {
  assert(generators.cols() >= 4);
  using std::cos;
  using std::sin;
  using std::sqrt;
  Vector3<Scalar> t1, t2;
  tangent_frame(normal, t1, t2);
  const Scalar scale = Scalar(1) / sqrt(Scalar(1) + friction * friction);
  const double turn = 2.0 * std::numbers::pi / static_cast<double>(generators.cols());
  for (Index i = 0; i < generators.cols(); ++i) {
    const Scalar angle = Scalar(turn * static_cast<double>(i));
    generators.col(i) = (normal + friction * (cos(angle) * t1 + sin(angle) * t2)) * scale;
  }
}

/// Returns how far `force` leaves the true cone about `normal` (unit) with friction coefficient `friction` and the `limit` on
/// its normal part, N: the largest of |f_t| - μ f_n, -f_n and f_n - limit; 0 when inside, infinity when an argument is not
/// finite.
template <RealScalar Scalar>
Scalar cone_violation(const Vector3<Scalar>& force, const Vector3<Scalar>& normal, const std::type_identity_t<Scalar>& friction,
                      const std::type_identity_t<Scalar>& limit) {
  using std::sqrt;
  const Scalar f_n = force.dot(normal);
  const Vector3<Scalar> f_t = force - f_n * normal;
  Scalar worst = sqrt(f_t.squaredNorm()) - friction * f_n;
  if (worst < -f_n) worst = -f_n;
  if (worst < f_n - limit) worst = f_n - limit;
  if (!is_finite(worst) || !is_finite(f_n) || !is_finite(limit) || !is_finite(friction))
    return scalar_traits<Scalar>::infinity();  // fails every bound
  return Scalar(0) < worst ? worst : Scalar(0);
}

}  // namespace clothctl
