#pragma once

// The conditions of qp/certificate.hpp in the scaled space of a solver, with error bounds: a
// candidate is a certificate when each sum that should vanish is no larger than its own rounding
// error.
//
//   infeasible:  Aᵀy + z = 0  and
//                Σ_i max{y_i t : rl_i ≤ t ≤ ru_i} + Σ_j max{z_j t : lb_j ≤ t ≤ ub_j} < 0
//   unbounded:   H d = 0,  gᵀd < 0,  neither d nor A d runs into a finite bound

#include <algorithm>
#include <cmath>

#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Spacing to the power 3/4 (1.8e-12 in double): what is small enough to be refined away.
template <RealScalar Scalar>
Scalar certificate_tolerance() {
  using std::sqrt;
  const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
  return half * sqrt(half);
}

/// Levels of the threshold below which entries of a proof count as zero.
inline constexpr int kTraceLevels = 3;

/// The first threshold, relative to the largest entry; its square and the square of that follow.
template <RealScalar Scalar>
Scalar coarsest_trace() {
  using std::sqrt;
  return sqrt(sqrt(certificate_tolerance<Scalar>()));
}

/// Adds max over [lower, upper] of v t to `value` and its size to `size`. An infinite side counts
/// through `reach`, a bound on |t| that any useful solution keeps, so that rounding alone does not
/// spoil a proof.
template <RealScalar Scalar>
void add_support(const Scalar& v, const Scalar& lower, const Scalar& upper, const Scalar& reach,
                 Scalar& value, Scalar& size) {
  using std::abs;
  const Scalar edge = v > Scalar(0) ? upper : lower;
  const Scalar term = has_bound(edge) ? Scalar(v * edge) : Scalar(abs(v) * reach);
  value += term;
  size += abs(term);
}

/// How far a candidate is from a proof.
template <RealScalar Scalar>
struct ProofCheck {
  /// Every condition holds to the rounding of its own sums.
  bool proven = false;
  /// The deciding value (support, or slope) is negative beyond rounding, and no sign is wrong.
  bool promising = false;
  /// No sign is wrong, every number finite.
  bool admissible = false;
  /// Largest error over what rounding explains; at most 1 when proven.
  Scalar error = Scalar(0);
  /// The part of it that comes from rows (rays only).
  Scalar row_error = Scalar(0);
};

/// Rounding error of a sum of `terms` products, relative to the sum of their sizes.
template <RealScalar Scalar>
Scalar summation_error(Index terms) {
  return Scalar(0.5) * static_cast<Scalar>(terms + 2) * scalar_traits<Scalar>::epsilon();
}

/// How far below zero a deciding sum of `terms` products has to be, relative to the sum of their
/// sizes.
template <RealScalar Scalar>
Scalar deciding_margin(Index terms) {
  return certificate_tolerance<Scalar>() + Scalar(8) * summation_error<Scalar>(terms);
}

/// Judges (y, z) as a proof that the loaded bounds cannot be met; z must equal -Aᵀy and `z_size`
/// hold |Aᵀ||y|. On an infinite side z must vanish except for the rounding of its own sum, and is
/// then set to zero. Complexity: O(n + m).
template <RealScalar Scalar>
ProofCheck<Scalar> check_farkas(const Eigen::Ref<const VectorX<Scalar>>& y,
                                Eigen::Ref<VectorX<Scalar>> z,
                                const Eigen::Ref<const VectorX<Scalar>>& z_size,
                                const Eigen::Ref<const VectorX<Scalar>>& rl,
                                const Eigen::Ref<const VectorX<Scalar>>& ru,
                                const Eigen::Ref<const VectorX<Scalar>>& lo,
                                const Eigen::Ref<const VectorX<Scalar>>& hi, const Scalar& reach) {
  using std::abs;
  ProofCheck<Scalar> proof;
  const Scalar rounding = summation_error<Scalar>(y.size());
  const Scalar margin =
      Scalar(15) * certificate_tolerance<Scalar>() + deciding_margin<Scalar>(y.size() + z.size());
  Scalar value(0);
  Scalar size(0);
  Scalar open_value(0);
  for (Index i = 0; i < y.size(); ++i) {
    if (!is_finite(y[i])) return proof;
    if (!(y[i] < Scalar(0)) && !(y[i] > Scalar(0))) continue;
    if (!has_bound(y[i] > Scalar(0) ? ru[i] : rl[i])) return proof;
    add_support(y[i], rl[i], ru[i], reach, value, size);
  }
  for (Index j = 0; j < z.size(); ++j) {
    if (!is_finite(z[j])) return proof;
    if (!(z[j] < Scalar(0)) && !(z[j] > Scalar(0))) continue;
    if (has_bound(z[j] > Scalar(0) ? hi[j] : lo[j])) {
      add_support(z[j], lo[j], hi[j], reach, value, size);
    } else {
      proof.error = (std::max)(proof.error, Scalar(abs(z[j]) / (rounding * z_size[j])));
      open_value += abs(z[j]) * reach;
    }
  }
  proof.admissible = is_finite(value) && is_finite(size);
  proof.promising = proof.admissible && size > Scalar(0) && value < -margin * size;
  proof.proven = proof.promising && proof.error <= Scalar(1) &&
                 value + open_value < -margin * (size + open_value);
  if (!proof.proven) return proof;
  for (Index j = 0; j < z.size(); ++j) {
    if (!has_bound(z[j] > Scalar(0) ? hi[j] : lo[j])) z[j] = Scalar(0);
  }
  return proof;
}

/// Judges d with products Hd and Ad as a proof of unboundedness. The sizes are those of the terms
/// that were summed. Components of d must not leave a bound at all; Hd, and Ad towards a bound,
/// must vanish except for the rounding of their own sums. Complexity: O(n + m).
template <RealScalar Scalar>
ProofCheck<Scalar> check_ray(
    const Eigen::Ref<const VectorX<Scalar>>& d, const Eigen::Ref<const VectorX<Scalar>>& Hd,
    const Eigen::Ref<const VectorX<Scalar>>& Ad, const Eigen::Ref<const VectorX<Scalar>>& Hd_size,
    const Eigen::Ref<const VectorX<Scalar>>& Ad_size, const Eigen::Ref<const VectorX<Scalar>>& g,
    const Eigen::Ref<const VectorX<Scalar>>& rl, const Eigen::Ref<const VectorX<Scalar>>& ru,
    const Eigen::Ref<const VectorX<Scalar>>& lo, const Eigen::Ref<const VectorX<Scalar>>& hi) {
  using std::abs;
  ProofCheck<Scalar> proof;
  const Scalar rounding = Scalar(4) * summation_error<Scalar>(d.size());
  Scalar slope(0);
  Scalar size(0);
  const auto demand = [&](const Scalar& value, const Scalar& terms, Scalar& error) {
    if (value < Scalar(0) || value > Scalar(0))
      error = (std::max)(error, Scalar(abs(value) / (rounding * terms)));
  };
  for (Index j = 0; j < d.size(); ++j) {
    if (!is_finite(d[j]) || !is_finite(Hd[j])) return proof;
    if ((d[j] < Scalar(0) && has_bound(lo[j])) || (d[j] > Scalar(0) && has_bound(hi[j])))
      return proof;
    slope += g[j] * d[j];
    size += abs(g[j] * d[j]);
    demand(Hd[j], Hd_size[j], proof.error);
  }
  for (Index i = 0; i < Ad.size(); ++i) {
    if (!is_finite(Ad[i])) return proof;
    if ((Ad[i] < Scalar(0) && has_bound(rl[i])) || (Ad[i] > Scalar(0) && has_bound(ru[i])))
      demand(Ad[i], Ad_size[i], proof.row_error);
  }
  proof.error = (std::max)(proof.error, proof.row_error);
  proof.admissible = is_finite(size);
  proof.promising = proof.admissible && slope < -deciding_margin<Scalar>(d.size()) * size;
  proof.proven = proof.promising && proof.error <= Scalar(1);
  return proof;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
