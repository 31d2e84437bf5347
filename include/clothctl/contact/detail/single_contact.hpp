#pragma once

// The exact solution of one contact, u = D λ + b with a 3×3 block D in the frame (n, t1, t2):
//
//   open    b_n >= 0:  λ = 0
//   stick   λ = -D⁻¹ b, if it lies in the cone
//   slip    u_n = 0 and u_t = -α λ_t with α > 0:  (D + α diag(0, 1, 1)) λ = -b  and  |λ_t| = μ λ_n
//
// The normal is eliminated. With S = D_tt - D_tn D_nt / D_nn and s = b_t - D_tn b_n / D_nn
//
//   λ_t(α) = -(S + α I)⁻¹ s,     λ_n = -(b_n + D_nt λ_t) / D_nn
//
// In the axes of S this is a formula, and α is the root of |λ_t| - μ λ_n. That is negative for
// large α, where λ_t vanishes and λ_n is -b_n / D_nn > 0, and positive at α = 0 outside the cone.
//
// Reference: Bonnefon, Daviet, Quartic formulation of Coulomb 3D frictional contact (2011), which
// gives the same root as that of a quartic.

#include <cmath>

#include "clothctl/contact/detail/friction_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// One contact with the normal eliminated, in the axes in which S is diagonal.
template <RealScalar Scalar>
class SlipCurve {
 public:
  SlipCurve(const Matrix3<Scalar>& D, const Vector3<Scalar>& b, const Scalar& mu)
      : b_n_(b[0]), d_nn_(D(0, 0)), mu_(mu) {
    using std::abs;
    using std::sqrt;
    const Scalar k1 = D(1, 0) / d_nn_, k2 = D(2, 0) / d_nn_;
    const Scalar s11 = D(1, 1) - k1 * D(1, 0), s12 = D(2, 1) - k1 * D(2, 0),
                 s22 = D(2, 2) - k2 * D(2, 0);
    // The rotation by θ with tan 2θ = 2 s12 / (s11 - s22), from half-angle formulas.
    const Scalar half = Scalar(0.5) * (s11 - s22), middle = Scalar(0.5) * (s11 + s22);
    const Scalar reach = sqrt(half * half + s12 * s12);
    cos_ = Scalar(1);
    sin_ = Scalar(0);
    if (Scalar(0) < reach) {
      const Scalar twice = abs(half) / reach;
      const Scalar c = sqrt(Scalar(0.5) * (Scalar(1) + twice)), s = s12 / (Scalar(2) * reach * c);
      cos_ = half < Scalar(0) ? Scalar(abs(s)) : c;
      sin_ = half < Scalar(0) ? (s < Scalar(0) ? Scalar(-c) : c) : s;
    }
    first_ = middle + reach;
    second_ = middle - reach;
    if (second_ < Scalar(0)) second_ = Scalar(0);
    const Scalar p1 = b[1] - k1 * b[0], p2 = b[2] - k2 * b[0];
    r1_ = cos_ * p1 + sin_ * p2;
    r2_ = cos_ * p2 - sin_ * p1;
    n1_ = D(1, 0);
    n2_ = D(2, 0);
  }

  /// Returns λ(α).
  Vector3<Scalar> at(const Scalar& alpha) const {
    const Scalar y1 = -r1_ / (first_ + alpha), y2 = -r2_ / (second_ + alpha);
    const Scalar t1 = cos_ * y1 - sin_ * y2, t2 = sin_ * y1 + cos_ * y2;
    return {-(b_n_ + n1_ * t1 + n2_ * t2) / d_nn_, t1, t2};
  }
  /// Returns |λ_t| - μ λ_n.
  Scalar excess(const Vector3<Scalar>& lambda) const {
    return tangential_length<Scalar>(lambda) - mu_ * lambda[0];
  }
  /// Returns true when sticking is well defined.
  bool regular() const { return scalar_traits<Scalar>::epsilon() * first_ < second_; }
  /// The larger eigenvalue of S.
  const Scalar& scale() const { return first_; }

 private:
  Scalar b_n_, d_nn_, mu_;
  Scalar cos_, sin_, first_, second_, r1_, r2_, n1_, n2_;
};

/// Returns the impulse of one contact. Needs D_nn > 0, and S ≠ 0 where μ > 0. Never allocates.
template <RealScalar Scalar>
Vector3<Scalar> solve_single_contact(const Matrix3<Scalar>& D, const Vector3<Scalar>& b,
                                     const Scalar& mu) {
  const Scalar zero(0);
  if (!(b[0] < zero)) return Vector3<Scalar>::Constant(zero);
  if (!(zero < mu)) return {-b[0] / D(0, 0), zero, zero};
  const SlipCurve<Scalar> curve(D, b, mu);
  Scalar low = curve.regular() ? zero : Scalar(scalar_traits<Scalar>::epsilon() * curve.scale());
  Vector3<Scalar> lambda = curve.at(low);
  Scalar at_low = curve.excess(lambda);
  if (!(zero < at_low)) return lambda;
  Scalar high = curve.scale();
  Scalar at_high = curve.excess(curve.at(high));
  for (int k = 0; k < 200 && zero < at_high; ++k) {
    low = high;
    at_low = at_high;
    high *= Scalar(4);
    at_high = curve.excess(curve.at(high));
  }
  // The method of Illinois: secants whose older end loses half its value when it stays.
  for (int k = 0, side = 0; k < 40; ++k) {
    const Scalar drop = at_low - at_high;
    if (!(zero < drop)) break;
    const Scalar alpha = (low * -at_high + high * at_low) / drop;
    lambda = curve.at(alpha);
    const Scalar value = curve.excess(lambda);
    const Scalar near_zero = Scalar(4) * scalar_traits<Scalar>::epsilon() * mu * lambda[0];
    if (value < near_zero && -near_zero < value) break;
    if (zero < value) {
      low = alpha;
      at_low = value;
      if (side == 1) at_high *= Scalar(0.5);
      side = 1;
    } else {
      high = alpha;
      at_high = value;
      if (side == -1) at_low *= Scalar(0.5);
      side = -1;
    }
  }
  const Scalar t = tangential_length<Scalar>(lambda);
  if (lambda[0] < zero) return Vector3<Scalar>::Constant(zero);
  const Scalar share = zero < t ? Scalar(mu * lambda[0] / t) : zero;
  return {lambda[0], share * lambda[1], share * lambda[2]};
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
