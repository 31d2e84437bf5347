#pragma once

// Checks the conditions of qp/certificate.hpp in the scaled space of a solver, with bounds on the
// rounding errors: a candidate is a certificate when each sum that should be zero is no larger than
// its own rounding error.
//
//   infeasible:  Aᵀy + z = 0  and
//                Σ_i max{y_i t : rl_i ≤ t ≤ ru_i} + Σ_j max{z_j t : lb_j ≤ t ≤ ub_j} < 0
//   unbounded:   H d = 0,  gᵀd < 0,  neither d nor A d points at a finite bound

#include <algorithm>
#include <cmath>

#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Spacing of the scalar at one, to the power 3/4 (1.8e-12 in double). Refinement can remove errors
/// below this value.
template <RealScalar Scalar>
Scalar certificate_tolerance() {
  using std::sqrt;
  const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
  return half * sqrt(half);
}

/// Number of drop tolerances that are tried. Entries of a candidate below the drop tolerance count
/// as zero.
inline constexpr int kDropLevels = 3;

/// The first drop tolerance, relative to the largest entry of the candidate. Each later tolerance
/// is the square of the previous one.
template <RealScalar Scalar>
Scalar largest_drop_tolerance() {
  using std::sqrt;
  return sqrt(sqrt(certificate_tolerance<Scalar>()));
}

/// Adds max{v t : lower ≤ t ≤ upper} to `value` and its absolute value to `size`. An infinite bound
/// is replaced by `reach`, an upper bound of |t| for all useful solutions. Otherwise a rounding
/// error in v would make the maximum infinite.
template <RealScalar Scalar>
void add_support(const Scalar& v, const Scalar& lower, const Scalar& upper, const Scalar& reach,
                 Scalar& value, Scalar& size) {
  using std::abs;
  const Scalar edge = v > Scalar(0) ? upper : lower;
  const Scalar term = has_bound(edge) ? Scalar(v * edge) : Scalar(abs(v) * reach);
  value += term;
  size += abs(term);
}

/// The result of a check: how far a candidate is from a certificate.
template <RealScalar Scalar>
struct CertificateCheck {
  /// The candidate is a certificate: every condition holds to rounding.
  bool holds = false;
  /// The candidate is admissible, and the number that must be negative (the sum of maxima of a
  /// Farkas pair, or the objective's slope along a ray) is negative by more than rounding.
  bool promising = false;
  /// Each multiplier, or entry of the ray, has a sign that its bounds allow, and all are finite.
  bool admissible = false;
  /// Largest ratio of an error to its rounding bound; at most 1 for a certificate.
  Scalar error = Scalar(0);
  /// The same ratio among the rows only; set for rays only.
  Scalar row_error = Scalar(0);
};

/// Bound on the rounding error of a sum of `terms` products, relative to the sum of their absolute
/// values (Higham, Accuracy and Stability of Numerical Algorithms, 2002, §3.1).
template <RealScalar Scalar>
Scalar summation_error(Index terms) {
  return Scalar(0.5) * static_cast<Scalar>(terms + 2) * scalar_traits<Scalar>::epsilon();
}

/// How far below zero the sum of `terms` products that must be negative has to be, relative to the
/// sum of their absolute values.
template <RealScalar Scalar>
Scalar sign_margin(Index terms) {
  return certificate_tolerance<Scalar>() + Scalar(8) * summation_error<Scalar>(terms);
}

/// Checks (y, z) as a Farkas certificate for the loaded bounds. z must be -Aᵀy and `z_size`
/// |Aᵀ||y|. A z_j that belongs to an infinite bound must be zero up to the rounding error of its
/// own sum; if the check succeeds, this z_j becomes exactly zero. Complexity: O(n + m).
template <RealScalar Scalar>
CertificateCheck<Scalar> check_farkas(
    const Eigen::Ref<const VectorX<Scalar>>& y, Eigen::Ref<VectorX<Scalar>> z,
    const Eigen::Ref<const VectorX<Scalar>>& z_size, const Eigen::Ref<const VectorX<Scalar>>& rl,
    const Eigen::Ref<const VectorX<Scalar>>& ru, const Eigen::Ref<const VectorX<Scalar>>& lo,
    const Eigen::Ref<const VectorX<Scalar>>& hi, const Scalar& reach) {
  using std::abs;
  CertificateCheck<Scalar> certificate;
  const Scalar rounding = summation_error<Scalar>(y.size());
  const Scalar margin =
      Scalar(15) * certificate_tolerance<Scalar>() + sign_margin<Scalar>(y.size() + z.size());
  Scalar value(0);
  Scalar size(0);
  Scalar infinite_side_value(0);
  for (Index i = 0; i < y.size(); ++i) {
    if (!is_finite(y[i])) return certificate;
    if (!(y[i] < Scalar(0)) && !(y[i] > Scalar(0))) continue;
    if (!has_bound(y[i] > Scalar(0) ? ru[i] : rl[i])) return certificate;
    add_support(y[i], rl[i], ru[i], reach, value, size);
  }
  for (Index j = 0; j < z.size(); ++j) {
    if (!is_finite(z[j])) return certificate;
    if (!(z[j] < Scalar(0)) && !(z[j] > Scalar(0))) continue;
    if (has_bound(z[j] > Scalar(0) ? hi[j] : lo[j])) {
      add_support(z[j], lo[j], hi[j], reach, value, size);
    } else {
      certificate.error = (std::max)(certificate.error, Scalar(abs(z[j]) / (rounding * z_size[j])));
      infinite_side_value += abs(z[j]) * reach;
    }
  }
  certificate.admissible = is_finite(value) && is_finite(size);
  certificate.promising = certificate.admissible && size > Scalar(0) && value < -margin * size;
  certificate.holds = certificate.promising && certificate.error <= Scalar(1) &&
                      value + infinite_side_value < -margin * (size + infinite_side_value);
  if (!certificate.holds) return certificate;
  for (Index j = 0; j < z.size(); ++j) {
    if (!has_bound(z[j] > Scalar(0) ? hi[j] : lo[j])) z[j] = Scalar(0);
  }
  return certificate;
}

/// Checks d, with its products Hd and Ad, as a certificate of unboundedness. Hd_size = |H||d| and
/// Ad_size = |A||d|. No entry of d may point at a finite bound. Each entry of Hd, and each entry of
/// Ad that points at a finite bound, must be zero up to the rounding error of its own sum.
/// Complexity: O(n + m).
template <RealScalar Scalar>
CertificateCheck<Scalar> check_ray(
    const Eigen::Ref<const VectorX<Scalar>>& d, const Eigen::Ref<const VectorX<Scalar>>& Hd,
    const Eigen::Ref<const VectorX<Scalar>>& Ad, const Eigen::Ref<const VectorX<Scalar>>& Hd_size,
    const Eigen::Ref<const VectorX<Scalar>>& Ad_size, const Eigen::Ref<const VectorX<Scalar>>& g,
    const Eigen::Ref<const VectorX<Scalar>>& rl, const Eigen::Ref<const VectorX<Scalar>>& ru,
    const Eigen::Ref<const VectorX<Scalar>>& lo, const Eigen::Ref<const VectorX<Scalar>>& hi) {
  using std::abs;
  CertificateCheck<Scalar> certificate;
  const Scalar rounding = Scalar(4) * summation_error<Scalar>(d.size());
  Scalar slope(0);
  Scalar size(0);
  const auto add_error = [&](const Scalar& value, const Scalar& terms, Scalar& error) {
    if (value < Scalar(0) || value > Scalar(0))
      error = (std::max)(error, Scalar(abs(value) / (rounding * terms)));
  };
  for (Index j = 0; j < d.size(); ++j) {
    if (!is_finite(d[j]) || !is_finite(Hd[j])) return certificate;
    if ((d[j] < Scalar(0) && has_bound(lo[j])) || (d[j] > Scalar(0) && has_bound(hi[j])))
      return certificate;
    slope += g[j] * d[j];
    size += abs(g[j] * d[j]);
    add_error(Hd[j], Hd_size[j], certificate.error);
  }
  for (Index i = 0; i < Ad.size(); ++i) {
    if (!is_finite(Ad[i])) return certificate;
    if ((Ad[i] < Scalar(0) && has_bound(rl[i])) || (Ad[i] > Scalar(0) && has_bound(ru[i])))
      add_error(Ad[i], Ad_size[i], certificate.row_error);
  }
  certificate.error = (std::max)(certificate.error, certificate.row_error);
  certificate.admissible = is_finite(size);
  certificate.promising = certificate.admissible && slope < -sign_margin<Scalar>(d.size()) * size;
  certificate.holds = certificate.promising && certificate.error <= Scalar(1);
  return certificate;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
