#pragma once

// Coulomb's friction cone |f_t| <= μ f_n, f_n >= 0 about a contact normal n, and the friction
// pyramid inscribed in it, which is spanned by n_g unit generators
//
//   s_i = (n + μ t_i) / √(1 + μ²),   t_i = cos(2πi/n_g) t_1 + sin(2πi/n_g) t_2
//   f = Σ d_i s_i,   d_i >= 0
//
// The pyramid lies inside of the cone: every d >= 0 keeps Coulomb's law. Between generators it
// loses a part of the friction: at most 1 - cos(π/n_g), 29 % for n_g = 4 ([Bai 2016], eq. 1-2) and
// 8 % for n_g = 8. The normal force is f_n = Σ d_i / √(1 + μ²).

#include <cassert>
#include <cmath>
#include <numbers>
#include <type_traits>

#include "clothctl/config.hpp"
#include "clothctl/core/types.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// Writes two unit tangents that make a right-handed frame (t1, t2, n) with the unit normal
/// `normal`. Continuous in the normal, except where |n_z| passes 0.9. Never allocates.
template <RealScalar Scalar>
void tangent_frame(const Vector3<Scalar>& normal, Vector3<Scalar>& t1, Vector3<Scalar>& t2) {
  using std::abs;
  using std::sqrt;
  const Vector3<Scalar> helper = abs(normal[2]) < Scalar(0.9)
                                     ? Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1))
                                     : Vector3<Scalar>(Scalar(1), Scalar(0), Scalar(0));
  t1 = helper.cross(normal);
  t1 /= sqrt(t1.squaredNorm());
  t2 = normal.cross(t1);
}

/// Returns √(1 + μ²), the length of n + μ t. A unit generator adds 1/√(1 + μ²) to the normal force.
template <RealScalar Scalar>
Scalar generator_slant(const Scalar& friction) {
  using std::sqrt;
  return sqrt(Scalar(1) + friction * friction);
}

/// Writes the `generators.cols()` unit generators of the pyramid about `normal` (unit) with
/// friction coefficient `friction` into the columns of `generators` (3×n_g, n_g >= 4). Never
/// allocates. Reference: [Bai 2016], eq. 1.
template <RealScalar Scalar>
void friction_generators(const Vector3<Scalar>& normal,
                         const std::type_identity_t<Scalar>& friction,
                         std::type_identity_t<Eigen::Ref<Points<Scalar>>> generators) {
  assert(generators.cols() >= 4);
  using std::cos;
  using std::sin;
  Vector3<Scalar> t1, t2;
  tangent_frame(normal, t1, t2);
  const Scalar scale = Scalar(1) / generator_slant(friction);
  const double turn = 2.0 * std::numbers::pi / static_cast<double>(generators.cols());
  for (Index i = 0; i < generators.cols(); ++i) {
    const Scalar angle = Scalar(turn * static_cast<double>(i));
    generators.col(i) = (normal + friction * (cos(angle) * t1 + sin(angle) * t2)) * scale;
  }
}

/// Returns by how much `force` (N) leaves the friction cone about `normal` (unit) with friction
/// coefficient `friction` and the limit `max_normal_force` (N): the largest of |f_t| - μ f_n, -f_n
/// and f_n - limit, or 0. Infinity when an argument is not finite.
template <RealScalar Scalar>
Scalar cone_violation(const Vector3<Scalar>& force, const Vector3<Scalar>& normal,
                      const std::type_identity_t<Scalar>& friction,
                      const std::type_identity_t<Scalar>& max_normal_force) {
  using std::sqrt;
  const Scalar f_n = force.dot(normal);
  const Vector3<Scalar> f_t = force - f_n * normal;
  Scalar worst = sqrt(f_t.squaredNorm()) - friction * f_n;
  if (worst < -f_n) worst = -f_n;
  if (worst < f_n - max_normal_force) worst = f_n - max_normal_force;
  if (!is_finite(worst) || !is_finite(f_n) || !is_finite(max_normal_force) || !is_finite(friction))
    return scalar_traits<Scalar>::infinity();  // fails every bound
  return Scalar(0) < worst ? worst : Scalar(0);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
