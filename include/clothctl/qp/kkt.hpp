#pragma once

// Checks a solution of a QP on the caller's own data, independently of any solver. The residuals of
// the optimality (Karush-Kuhn-Tucker) conditions are
//
//   stationarity      largest entry of |Hx + g - Aᵀy - z|, or of the multipliers that belong to an
//                     infinite bound
//   feasibility       largest violation of rl ≤ Ax ≤ ru and lb ≤ x ≤ ub
//   complementarity   Σ |y_i| slack_i + Σ |z_j| slack_j, where the slack is the distance to the
//                     lower bound for a positive multiplier, else to the upper bound
//
// The relative values are these residuals divided by max(1, |Hx|, |g|), by max(1, |Ax|, |x|) and by
// max(1, |objective|), in infinity norms. |Aᵀy| does not count: multipliers of dependent rows and
// bounds may be huge and cancel each other, and would then hide any error. A NaN or an overflow
// makes the residual infinite in which it occurs.

#include <cmath>
#include <type_traits>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How far a primal-dual triple (x, y, z) is from optimal.
template <RealScalar Scalar>
struct KktResiduals {
  /// Largest stationarity error.
  Scalar stationarity = Scalar(0);
  /// Largest violation of a bound or row.
  Scalar feasibility = Scalar(0);
  /// Sum of |multiplier| times slack.
  Scalar complementarity = Scalar(0);
  /// Stationarity divided by max(1, |Hx|, |g|).
  Scalar relative_stationarity = Scalar(0);
  /// Feasibility divided by max(1, |Ax|, |x|).
  Scalar relative_feasibility = Scalar(0);
  /// Complementarity divided by max(1, |objective|).
  Scalar relative_complementarity = Scalar(0);
  /// ½ xᵀHx + gᵀx.
  Scalar objective = Scalar(0);

  /// The largest of the three relative values.
  Scalar worst() const {
    Scalar w = relative_stationarity;
    if (w < relative_feasibility) w = relative_feasibility;
    if (w < relative_complementarity) w = relative_complementarity;
    return w;
  }
};

namespace detail {

/// worst = max(worst, error). An error that is not finite counts as infinite, under -ffast-math
/// too.
template <RealScalar Scalar>
void update_max(Scalar& worst, const Scalar& error) {
  if (!is_finite(error)) {
    worst = scalar_traits<Scalar>::infinity();
  } else if (error > worst) {
    worst = error;
  }
}

/// error / scale, infinite when either is not finite.
template <RealScalar Scalar>
Scalar relative_error(const Scalar& error, const Scalar& scale) {
  return is_finite(error) && is_finite(scale) ? Scalar(error / scale)
                                              : scalar_traits<Scalar>::infinity();
}

/// Adds the errors of one quantity `value` with bounds [lower, upper] and its multiplier to the
/// residuals.
template <RealScalar Scalar>
void add_bound_residuals(const Scalar& value, const Scalar& lower, const Scalar& upper,
                         const Scalar& multiplier, KktResiduals<Scalar>& r) {
  using std::abs;
  const Scalar zero(0);
  const bool has_lower = !is_unbounded(lower);
  const bool has_upper = !is_unbounded(upper);
  if (has_lower) update_max(r.feasibility, Scalar(lower - value));
  if (has_upper) update_max(r.feasibility, Scalar(value - upper));
  if (!is_finite(value)) update_max(r.feasibility, value);
  if (!is_finite(multiplier)) {
    update_max(r.stationarity, multiplier);
    update_max(r.complementarity, multiplier);
  } else if (multiplier > zero) {
    if (has_lower) {
      r.complementarity += multiplier * abs(value - lower);
    } else {
      update_max(r.stationarity, multiplier);
    }
  } else if (multiplier < zero) {
    if (has_upper) {
      r.complementarity += -multiplier * abs(upper - value);
    } else {
      update_max(r.stationarity, Scalar(-multiplier));
    }
  }
}

/// Residuals from the products Hx, Ax and Aᵀy. Never allocates.
template <RealScalar Scalar>
KktResiduals<Scalar> kkt_from_products(
    const Eigen::Ref<const VectorX<Scalar>>& Hx, const Eigen::Ref<const VectorX<Scalar>>& Ax,
    const Eigen::Ref<const VectorX<Scalar>>& Aty, const Eigen::Ref<const VectorX<Scalar>>& g,
    const Eigen::Ref<const VectorX<Scalar>>& rl, const Eigen::Ref<const VectorX<Scalar>>& ru,
    const Eigen::Ref<const VectorX<Scalar>>& lb, const Eigen::Ref<const VectorX<Scalar>>& ub,
    const Eigen::Ref<const VectorX<Scalar>>& x, const Eigen::Ref<const VectorX<Scalar>>& y,
    const Eigen::Ref<const VectorX<Scalar>>& z) {
  using std::abs;
  KktResiduals<Scalar> r;
  Scalar dual_scale(1);
  Scalar primal_scale(1);
  const auto raise = [](Scalar& scale, const Scalar& value) {
    update_max(scale, Scalar(abs(value)));
  };
  for (Index j = 0; j < x.size(); ++j) {
    raise(dual_scale, Hx[j]);
    raise(dual_scale, g[j]);
    raise(primal_scale, x[j]);
    update_max(r.stationarity, Scalar(abs(Hx[j] + g[j] - Aty[j] - z[j])));
    add_bound_residuals(x[j], lb[j], ub[j], z[j], r);
    r.objective += (Scalar(0.5) * Hx[j] + g[j]) * x[j];
  }
  for (Index i = 0; i < y.size(); ++i) {
    raise(primal_scale, Ax[i]);
    add_bound_residuals(Ax[i], rl[i], ru[i], y[i], r);
  }
  Scalar value_scale(1);
  raise(value_scale, r.objective);
  if (!is_finite(r.complementarity)) r.complementarity = scalar_traits<Scalar>::infinity();
  r.relative_stationarity = relative_error(r.stationarity, dual_scale);
  r.relative_feasibility = relative_error(r.feasibility, primal_scale);
  r.relative_complementarity = relative_error(r.complementarity, value_scale);
  return r;
}

}  // namespace detail

/// Measures how far the triple (x, y, z) is from optimal for the problem (H, g, A, rl, ru, lb, ub).
/// H is n×n, A m×n (0×n or 0×0 without rows); g, lb, ub, x, z have n entries, rl, ru, y have m.
/// When a size does not match, every residual and the objective are infinite. The scalar is deduced
/// from g. Allocates. Complexity: O(n² + mn).
template <class Gradient, RealScalar Scalar = typename Gradient::Scalar>
KktResiduals<Scalar> kkt_residuals(
    const std::type_identity_t<Eigen::Ref<const MatrixX<Scalar>>>& H,
    const Eigen::MatrixBase<Gradient>& g,
    const std::type_identity_t<Eigen::Ref<const MatrixX<Scalar>>>& A,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& rl,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& ru,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& lb,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& ub,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& x,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& y,
    const std::type_identity_t<Eigen::Ref<const VectorX<Scalar>>>& z) {
  const Index n = x.size(), m = y.size();
  if (H.rows() != n || H.cols() != n || g.size() != n || A.rows() != m ||
      (m > 0 && A.cols() != n) || rl.size() != m || ru.size() != m || lb.size() != n ||
      ub.size() != n || z.size() != n) {
    const Scalar none = scalar_traits<Scalar>::infinity();
    return {none, none, none, none, none, none, none};
  }
  VectorX<Scalar> Hx = VectorX<Scalar>::Constant(x.size(), Scalar(0));
  VectorX<Scalar> Ax = VectorX<Scalar>::Constant(y.size(), Scalar(0));
  VectorX<Scalar> Aty = VectorX<Scalar>::Constant(x.size(), Scalar(0));
  const VectorX<Scalar> gradient = g;
  for (Index j = 0; j < x.size(); ++j) {
    Hx += H.col(j) * x[j];
    for (Index i = 0; i < y.size(); ++i) {
      Ax[i] += A(i, j) * x[j];
      Aty[j] += A(i, j) * y[i];
    }
  }
  return detail::kkt_from_products<Scalar>(Hx, Ax, Aty, gradient, rl, ru, lb, ub, x, y, z);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
