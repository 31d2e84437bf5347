#pragma once

// Proofs that a problem has no solution, checked on the caller's own numbers before anyone is told.
//
//   infeasible:  Aᵀy + z = 0 and  Σ_i max over [rl_i, ru_i] of y_i t  +  Σ_j max over [lb_j, ub_j] of z_j t  <  0
//   unbounded:   H d = 0,  gᵀd < 0,  A d and d leave no finite bound

#include <algorithm>
#include <cmath>

#include "clothctl/qp/problem.hpp"

namespace clothctl::detail {

/// Largest relative error that a certificate may have: spacing to the power 3/4 (1.8e-12 in double).
template <RealScalar Scalar>
Scalar certificate_tolerance() {
  using std::sqrt;
  const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
  return half * sqrt(half);
}

/// Adds max over [lower, upper] of v t to `value` and its size to `size`. An infinite side counts through `reach`, a bound
/// on |t| that any useful solution keeps, so that rounding alone does not spoil a proof.
template <RealScalar Scalar>
void add_support(const Scalar& v, const Scalar& lower, const Scalar& upper, const Scalar& reach, Scalar& value, Scalar& size) {
  using std::abs;
  const Scalar edge = v > Scalar(0) ? upper : lower;
  const Scalar term = has_bound(edge) ? Scalar(v * edge) : Scalar(abs(v) * reach);
  value += term;
  size += abs(term);
}

/// Tells whether (y, z) proves that the loaded bounds cannot be met; z must equal -Aᵀy. On an infinite side only rounding
/// (relative to `z_size`, the size of the terms of z_j) is let through, and set to zero. Complexity: O(n + m).
template <RealScalar Scalar>
bool proves_infeasible(const Eigen::Ref<const VectorX<Scalar>>& y, Eigen::Ref<VectorX<Scalar>> z,
                       const Eigen::Ref<const VectorX<Scalar>>& z_size, const Eigen::Ref<const VectorX<Scalar>>& rl,
                       const Eigen::Ref<const VectorX<Scalar>>& ru, const Eigen::Ref<const VectorX<Scalar>>& lo,
                       const Eigen::Ref<const VectorX<Scalar>>& hi, const Scalar& reach) {
  using std::abs;
  const Scalar tolerance = certificate_tolerance<Scalar>();
  Scalar value(0);
  Scalar size(0);
  for (Index i = 0; i < y.size(); ++i) {
    if (!(y[i] < Scalar(0)) && !(y[i] > Scalar(0))) continue;
    if (!has_bound(y[i] > Scalar(0) ? ru[i] : rl[i])) return false;
    add_support(y[i], rl[i], ru[i], reach, value, size);
  }
  for (Index j = 0; j < z.size(); ++j) {
    const bool open = !has_bound(z[j] > Scalar(0) ? hi[j] : lo[j]);
    if (open && abs(z[j]) > tolerance * z_size[j] + tolerance * tolerance) return false;
    add_support(z[j], lo[j], hi[j], reach, value, size);
    if (open) z[j] = Scalar(0);
  }
  return size > Scalar(0) && value < -Scalar(16) * tolerance * size;
}

/// Tells whether d with products Hd and Ad proves unboundedness. The sizes are those of the terms that were summed.
/// Complexity: O(n + m).
template <RealScalar Scalar>
bool proves_unbounded(const Eigen::Ref<const VectorX<Scalar>>& d, const Eigen::Ref<const VectorX<Scalar>>& Hd,
                      const Eigen::Ref<const VectorX<Scalar>>& Ad, const Eigen::Ref<const VectorX<Scalar>>& Hd_size,
                      const Eigen::Ref<const VectorX<Scalar>>& Ad_size, const Eigen::Ref<const VectorX<Scalar>>& g,
                      const Eigen::Ref<const VectorX<Scalar>>& rl, const Eigen::Ref<const VectorX<Scalar>>& ru,
                      const Eigen::Ref<const VectorX<Scalar>>& lo, const Eigen::Ref<const VectorX<Scalar>>& hi) {
  using std::abs;
  const Scalar tolerance = Scalar(64) * certificate_tolerance<Scalar>();
  Scalar slope(0);
  Scalar size(0);
  for (Index j = 0; j < d.size(); ++j) {
    slope += g[j] * d[j];
    size += abs(g[j] * d[j]);
    if (abs(Hd[j]) > tolerance * Hd_size[j]) return false;
    if ((d[j] < Scalar(0) && has_bound(lo[j])) || (d[j] > Scalar(0) && has_bound(hi[j]))) return false;
  }
  for (Index i = 0; i < Ad.size(); ++i) {
    const Scalar slack = tolerance * Ad_size[i];
    if ((Ad[i] < -slack && has_bound(rl[i])) || (Ad[i] > slack && has_bound(ru[i]))) return false;
  }
  return slope < -Scalar(1e-3) * size;
}

}  // namespace clothctl::detail
