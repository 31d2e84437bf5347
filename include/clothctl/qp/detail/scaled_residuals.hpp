#pragma once

// Residuals of an iterate of the proximal problem in the caller's units, relative to the largest
// terms as in kkt.hpp. They decide whether the problem is solved. When unknowns differ by many
// orders of magnitude, these residuals can hide errors of the small unknowns; entrywise_errors.hpp
// shows such errors.

#include <algorithm>

#include "clothctl/qp/detail/proximal_problem.hpp"
#include "clothctl/qp/kkt.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Computes the residuals of (x, y). The products in `problem` and its `gradient` Ĥx̂ + ĝ - Âᵀŷ
/// must be up to date. Scales are D (n) and E (m): x = D x̂, y = E ŷ. Each z_j is the part of the
/// gradient that the bounds at x_j allow. Complementarity counts the rounding error of A x as
/// slack. If an |x_j| exceeds 1e20, the relative feasibility residual is infinite. Never allocates.
template <RealScalar Scalar>
KktResiduals<Scalar> scaled_residuals(const ProximalProblem<Scalar>& problem,
                                      const VectorX<Scalar>& D, const VectorX<Scalar>& E,
                                      const VectorX<Scalar>& gradient) {
  using std::abs;
  KktResiduals<Scalar> r;
  Scalar dual_scale(1), farthest(1);
  for (Index j = 0; j < problem.unknowns(); ++j) {
    const Scalar hx = problem.hx[j], g = problem.g[j];
    const Scalar z = bound_multiplier(gradient[j], problem.x[j], problem.lo[j], problem.hi[j]);
    update_max(r.stationarity, Scalar(abs(gradient[j] - z) / D[j]));
    update_max(dual_scale, Scalar(abs(hx) / D[j]));
    update_max(dual_scale, Scalar(abs(g) / D[j]));
    update_max(farthest, Scalar(abs(problem.x[j]) * D[j]));
    r.objective += (Scalar(0.5) * hx + g) * problem.x[j];
  }
  Scalar primal_scale = farthest;
  for (Index i = 0; i < problem.rows(); ++i) {
    const Scalar ax = problem.ax[i], y = problem.y[i];
    const Scalar below = problem.rl[i] - ax, above = ax - problem.ru[i];
    update_max(primal_scale, Scalar(abs(ax) / E[i]));
    if (has_bound(problem.rl[i])) update_max(r.feasibility, Scalar(below / E[i]));
    if (has_bound(problem.ru[i])) update_max(r.feasibility, Scalar(above / E[i]));
    const Scalar edge = y > Scalar(0) ? below : above;
    if (!is_finite(y) || y > Scalar(0) || y < Scalar(0)) r.complementarity += abs(y * edge);
    // The rounding error of A x limits how well the slack is known.
    r.complementarity += scalar_traits<Scalar>::epsilon() * abs(y * ax);
  }
  r.relative_stationarity = relative_error(r.stationarity, dual_scale);
  r.relative_feasibility = relative_error(r.feasibility, primal_scale);
  r.relative_complementarity =
      relative_error(r.complementarity, (std::max)(Scalar(1), Scalar(abs(r.objective))));
  if (!is_finite(r.objective)) r.relative_complementarity = scalar_traits<Scalar>::infinity();
  if (farthest > largest_bound<Scalar>())
    r.relative_feasibility = scalar_traits<Scalar>::infinity();
  return r;
}

/// Returns true when the rounding error of plain products could exceed half of a tolerance, because
/// large terms of H x, Aᵀ y or A x cancel. The products in `problem` must be up to date. Never
/// allocates. Complexity: O(n + nnz(A)).
template <RealScalar Scalar>
bool rounding_counts(const ProximalProblem<Scalar>& problem, const VectorX<Scalar>& D,
                     const VectorX<Scalar>& E, const QpSettings<Scalar>& settings) {
  using std::abs;
  using std::sqrt;
  const Scalar unit = Scalar(2) * scalar_traits<Scalar>::epsilon();
  const Scalar length = problem.length_of_x();
  Scalar dual_terms(0), dual_scale(1), primal_terms(0), primal_scale(1);
  Scalar complementarity_terms(0), objective(0);
  for (Index j = 0; j < problem.unknowns(); ++j) {
    const Scalar hx = problem.hx[j], g = problem.g[j];
    const Scalar terms = problem.root_of_diagonal(j) * length + abs(g) +
                         problem.columns_of_A().size_of_dot(j, problem.y);
    update_max(dual_terms, Scalar(terms / D[j]));
    update_max(dual_scale, Scalar(abs(hx) / D[j]));
    update_max(dual_scale, Scalar(abs(g) / D[j]));
    update_max(primal_scale, Scalar(abs(problem.x[j]) * D[j]));
    objective += (Scalar(0.5) * hx + g) * problem.x[j];
  }
  for (Index i = 0; i < problem.rows(); ++i) {
    const Scalar terms = problem.columns_of_At().size_of_dot(i, problem.x);
    update_max(primal_terms, Scalar(terms / E[i]));
    update_max(primal_scale, Scalar(abs(problem.ax[i]) / E[i]));
    complementarity_terms += abs(problem.y[i]) * terms;
  }
  return !(unit * dual_terms <= settings.stationarity_tolerance * dual_scale) ||
         !(unit * primal_terms <= settings.feasibility_tolerance * primal_scale) ||
         !(unit * complementarity_terms <=
           settings.complementarity_tolerance * (std::max)(Scalar(1), Scalar(abs(objective))));
}

/// Returns true when the rounding error of H x at the iterate counts beside g. Never allocates.
/// Complexity: O(n).
template <RealScalar Scalar>
bool slopes_are_rounding(const ProximalProblem<Scalar>& problem) {
  using std::abs;
  Scalar slope(0), steepest(0);
  for (Index j = 0; j < problem.unknowns(); ++j) {
    steepest = (std::max)(steepest, problem.root_of_diagonal(j));
    slope = (std::max)(slope, Scalar(abs(problem.g[j])));
  }
  return scalar_traits<Scalar>::epsilon() * steepest * problem.length_of_x() > Scalar(1e-3) * slope;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
