#pragma once

// Certificates: short proofs that a QP has no solution, checked on the caller's own data.
//
// Infeasible (Farkas' lemma). A pair (y, z) with
//
//   Aᵀy + z = 0   and   s = Σ_i max{y_i t : rl_i ≤ t ≤ ru_i} + Σ_j max{z_j t : lb_j ≤ t ≤ ub_j} < 0
//
// proves that no point x is feasible: a feasible x would give 0 = yᵀAx + zᵀx ≤ s < 0.
//
// Unbounded. A direction d with
//
//   H d = 0,   gᵀd < 0,   d_j ≥ 0 where lb_j is finite, d_j ≤ 0 where ub_j is finite,
//   (A d)_i ≥ 0 where rl_i is finite, (A d)_i ≤ 0 where ru_i is finite
//
// proves that the objective falls without limit along d from every feasible point (if there is a
// feasible point).
//
// Computed certificates hold to rounding only, so the functions below measure by how much each
// condition fails. Each error is relative to the sum of the absolute values of the terms that
// should cancel, so it does not depend on how rows or unknowns are scaled.
//
// References: Farkas (1902); Boyd and Vandenberghe, Convex Optimization (2004), §5.8.

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "clothctl/core/types.hpp"
#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// By how much a pair (y, z) fails to be a Farkas certificate of infeasibility.
template <RealScalar Scalar>
struct FarkasResiduals {
  /// Largest |Aᵀy + z|_j divided by the sum of the absolute values of its terms. Infinite when an
  /// entry is not finite or a size does not match.
  Scalar balance = scalar_traits<Scalar>::infinity();
  /// The bound s, which must be negative. Infinite when a multiplier belongs to an infinite bound.
  Scalar value = scalar_traits<Scalar>::infinity();
  /// s divided by the sum of the absolute values of its terms.
  Scalar relative_value = scalar_traits<Scalar>::infinity();
  /// What a certificate with an error still proves: no feasible x has Σ|x_j| below this radius,
  /// which is -s divided by the largest |Aᵀy + z|_j. Infinite when the balance is exact.
  Scalar excluded_radius = Scalar(0);

  /// Returns true when the pair is a certificate to the tolerance: the balance is at most
  /// `tolerance` and s is negative.
  bool holds(const Scalar& tolerance = QpSettings<Scalar>::default_tolerance()) const {
    return balance <= tolerance && relative_value < Scalar(0);
  }
};

/// By how much a direction d fails to be a certificate of unboundedness.
template <RealScalar Scalar>
struct RayResiduals {
  /// Largest |H d|_i divided by the sum of the absolute values of its terms. Infinite when an entry
  /// is not finite or a size does not match.
  Scalar curvature = scalar_traits<Scalar>::infinity();
  /// Largest amount by which d runs into a finite bound: |d_j| divided by the largest entry of |d|,
  /// or |A d|_i divided by the sum of the absolute values of its terms.
  Scalar violation = scalar_traits<Scalar>::infinity();
  /// gᵀd divided by the sum of the absolute values of its terms. It must be negative.
  Scalar relative_slope = scalar_traits<Scalar>::infinity();

  /// Returns true when d is a certificate to the tolerance: curvature and violation are at most
  /// `tolerance`, and the objective falls along d.
  bool holds(const Scalar& tolerance = QpSettings<Scalar>::default_tolerance()) const {
    return curvature <= tolerance && violation <= tolerance && relative_slope < Scalar(0);
  }
};

namespace detail {

/// A sum, together with the sum of the absolute values of its terms (`size`).
template <RealScalar Scalar>
struct SizedSum {
  Scalar value = Scalar(0);
  Scalar size = Scalar(0);

  void add(const Scalar& term) {
    using std::abs;
    value += term;
    size += abs(term);
  }
  /// |value| divided by size; 0 for an empty sum, infinite when value or size is not finite.
  Scalar relative() const {
    using std::abs;
    if (!is_finite(value) || !is_finite(size)) return scalar_traits<Scalar>::infinity();
    return size > Scalar(0) ? Scalar(abs(value) / size) : Scalar(0);
  }
};

/// Adds the maximum of v t over lower ≤ t ≤ upper. Returns false when there is no maximum.
template <RealScalar Scalar>
bool add_largest(const Scalar& v, const Scalar& lower, const Scalar& upper, SizedSum<Scalar>& sum) {
  if (!(v < Scalar(0)) && !(v > Scalar(0))) return is_finite(v);
  const Scalar edge = v > Scalar(0) ? upper : lower;
  if (is_unbounded(edge) || !is_finite(edge)) return false;
  sum.add(v * edge);
  return true;
}

/// Returns true when a move by `step` leads to a finite bound.
template <RealScalar Scalar>
bool runs_into_bound(const Scalar& step, const Scalar& lower, const Scalar& upper) {
  return (step < Scalar(0) && !is_unbounded(lower)) || (step > Scalar(0) && !is_unbounded(upper));
}

}  // namespace detail

/// Measures (y, z) as a certificate that A x within [rl, ru] and x within [lb, ub] contradict each
/// other. A is m×n (0×n or 0×0 without rows); y, rl, ru have m entries, z, lb, ub n. For a result
/// with status PrimalInfeasible, y and z are `row_multipliers` and `bound_multipliers`. The scalar
/// is deduced from z. Allocates. Complexity: O(mn).
template <class Multipliers, RealScalar Scalar = typename Multipliers::Scalar>
FarkasResiduals<Scalar> farkas_residuals(
    const std::type_identity_t<Eigen::Ref<const MatrixX<Scalar>>>& A,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& rl,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& ru,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& lb,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& ub,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& y,
    const Eigen::MatrixBase<Multipliers>& z) {
  using std::abs;
  FarkasResiduals<Scalar> r;
  const Index n = z.size(), m = y.size();
  if (lb.size() != n || ub.size() != n || rl.size() != m || ru.size() != m || A.rows() != m ||
      (m > 0 && A.cols() != n))
    return r;
  detail::SizedSum<Scalar> bound;
  Scalar balance(0), largest(0);
  bool bounded = true;
  for (Index i = 0; i < m; ++i) bounded = detail::add_largest(y[i], rl[i], ru[i], bound) && bounded;
  for (Index j = 0; j < n; ++j) {
    const Scalar own = z.derived().coeff(j);
    bounded = detail::add_largest(own, lb[j], ub[j], bound) && bounded;
    detail::SizedSum<Scalar> sum;
    sum.add(own);
    for (Index i = 0; i < m; ++i) sum.add(A(i, j) * y[i]);
    const Scalar error = sum.relative();
    if (!is_finite(error)) return r;
    balance = (std::max)(balance, error);
    largest = (std::max)(largest, Scalar(abs(sum.value)));
  }
  r.balance = balance;
  if (!bounded || !is_finite(bound.value) || !is_finite(bound.size)) return r;
  r.value = bound.value;
  r.relative_value = bound.size > Scalar(0) ? Scalar(bound.value / bound.size) : Scalar(0);
  if (r.value < Scalar(0))
    r.excluded_radius =
        largest > Scalar(0) ? Scalar(-r.value / largest) : scalar_traits<Scalar>::infinity();
  return r;
}

/// Measures d as a certificate that the objective ½ xᵀHx + gᵀx falls without limit within the row
/// bounds [rl, ru] of A x and the bounds [lb, ub] of x. H is n×n, A m×n (0×n or 0×0 without rows);
/// g, lb, ub, d have n entries, rl and ru m. For a result with status DualInfeasible, d is `ray`.
/// The scalar is deduced from d. Allocates. Complexity: O(n² + mn).
template <class Direction, RealScalar Scalar = typename Direction::Scalar>
RayResiduals<Scalar> ray_residuals(
    const std::type_identity_t<Eigen::Ref<const MatrixX<Scalar>>>& H,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& g,
    const std::type_identity_t<Eigen::Ref<const MatrixX<Scalar>>>& A,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& rl,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& ru,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& lb,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& ub,
    const Eigen::MatrixBase<Direction>& direction) {
  using std::abs;
  RayResiduals<Scalar> r;
  const VectorX<Scalar> d = direction;
  const Index n = d.size(), m = rl.size();
  if (H.rows() != n || H.cols() != n || g.size() != n || lb.size() != n || ub.size() != n ||
      ru.size() != m || A.rows() != m || (m > 0 && A.cols() != n) || !all_finite(d))
    return r;
  Scalar longest(0), curvature(0), violation(0);
  detail::SizedSum<Scalar> slope;
  for (Index j = 0; j < n; ++j) longest = (std::max)(longest, Scalar(abs(d[j])));
  if (!(longest > Scalar(0))) return r;
  for (Index j = 0; j < n; ++j) {
    detail::SizedSum<Scalar> sum;
    for (Index i = 0; i < n; ++i) sum.add(H(j, i) * d[i]);
    if (!is_finite(sum.relative())) return r;
    curvature = (std::max)(curvature, sum.relative());
    slope.add(g[j] * d[j]);
    if (detail::runs_into_bound(d[j], lb[j], ub[j]))
      violation = (std::max)(violation, Scalar(abs(d[j]) / longest));
  }
  for (Index i = 0; i < m; ++i) {
    detail::SizedSum<Scalar> sum;
    for (Index j = 0; j < n; ++j) sum.add(A(i, j) * d[j]);
    if (!is_finite(sum.relative())) return r;
    if (detail::runs_into_bound(sum.value, rl[i], ru[i]))
      violation = (std::max)(violation, sum.relative());
  }
  if (!is_finite(slope.relative())) return r;
  r.curvature = curvature;
  r.violation = violation;
  r.relative_slope = slope.size > Scalar(0) ? Scalar(slope.value / slope.size) : Scalar(0);
  return r;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
