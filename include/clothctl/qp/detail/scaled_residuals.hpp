#pragma once

// Residuals of an iterate of the proximal problem, in the caller's units and in scaled space. The
// residuals in the caller's units are relative to the largest terms, as in kkt.hpp, and decide
// whether the problem is solved. When unknowns differ by many orders of magnitude, these residuals
// can hide errors of the small unknowns. The scaled ones show such errors.

#include <algorithm>

#include "clothctl/qp/detail/proximal_problem.hpp"
#include "clothctl/qp/kkt.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The residuals of an iterate in both spaces.
template <RealScalar Scalar>
struct ScaledResiduals {
  /// Unscaled residuals; complementarity counts the rounding of A x as slack.
  KktResiduals<Scalar> residuals;
  /// True when stationarity and feasibility are within tolerance in scaled space, too.
  bool met_in_scaled_space = false;
};

/// Measures (x, y) of a problem with fresh products, its `gradient` Ĥx̂ + ĝ - Âᵀŷ and scales D (n),
/// E (m): x = D x̂, y = E ŷ. z is chosen from the gradient by position and sign. Points beyond 1e20
/// do not pass. Never allocates.
template <RealScalar Scalar>
ScaledResiduals<Scalar> scaled_residuals(const ProximalProblem<Scalar>& problem,
                                         const VectorX<Scalar>& D, const VectorX<Scalar>& E,
                                         const QpSettings<Scalar>& settings,
                                         const VectorX<Scalar>& gradient) {
  using std::abs;
  ScaledResiduals<Scalar> judgement;
  KktResiduals<Scalar>& r = judgement.residuals;
  Scalar dual_scale(1), farthest(1);
  Scalar wrong(0), off(0), slopes(0), places(0);  // the same errors and their sizes in scaled space
  for (Index j = 0; j < problem.unknowns(); ++j) {
    const Scalar hx = problem.hx[j], g = problem.g[j], aty = hx + g - gradient[j];
    const Scalar z = bound_multiplier(gradient[j], problem.x[j], problem.lo[j], problem.hi[j]);
    const Scalar error = abs(gradient[j] - z);
    raise_error(wrong, error);
    raise_error(r.stationarity, Scalar(error / D[j]));
    for (const Scalar& term : {hx, g, aty}) {
      raise_error(slopes, Scalar(abs(term)));
      raise_error(dual_scale, Scalar(abs(term) / D[j]));
    }
    raise_error(places, Scalar(abs(problem.x[j])));
    raise_error(farthest, Scalar(abs(problem.x[j]) * D[j]));
    r.objective += (Scalar(0.5) * hx + g) * problem.x[j];
  }
  Scalar primal_scale = farthest;
  for (Index i = 0; i < problem.rows(); ++i) {
    const Scalar ax = problem.ax[i], y = problem.y[i];
    const Scalar below = problem.rl[i] - ax, above = ax - problem.ru[i];
    raise_error(places, Scalar(abs(ax)));
    raise_error(primal_scale, Scalar(abs(ax) / E[i]));
    if (has_bound(problem.rl[i])) raise_error(off, below);
    if (has_bound(problem.ru[i])) raise_error(off, above);
    if (has_bound(problem.rl[i])) raise_error(r.feasibility, Scalar(below / E[i]));
    if (has_bound(problem.ru[i])) raise_error(r.feasibility, Scalar(above / E[i]));
    const Scalar edge = y > Scalar(0) ? below : above;
    if (!is_finite(y) || y > Scalar(0) || y < Scalar(0)) r.complementarity += abs(y * edge);
    r.complementarity +=
        scalar_traits<Scalar>::epsilon() * abs(y * ax);  // the slack is known no better
  }
  judgement.met_in_scaled_space = wrong <= settings.stationarity_tolerance * slopes &&
                                  off <= settings.feasibility_tolerance * places;
  r.relative_stationarity = relative_error(r.stationarity, dual_scale);
  r.relative_feasibility = relative_error(r.feasibility, primal_scale);
  r.relative_complementarity =
      relative_error(r.complementarity, (std::max)(Scalar(1), Scalar(abs(r.objective))));
  if (!is_finite(r.objective)) r.relative_complementarity = scalar_traits<Scalar>::infinity();
  if (farthest > largest_bound<Scalar>())
    r.relative_feasibility = scalar_traits<Scalar>::infinity();
  return judgement;
}

/// Returns true when rounding of plain products could reach half of a tolerance: terms of H x, Aᵀ y
/// or A x cancel that far. Products and `gradient` are those of the iterate. Never allocates.
/// Complexity: O(n + nnz(A)).
template <RealScalar Scalar>
bool rounding_counts(const ProximalProblem<Scalar>& problem, const VectorX<Scalar>& D,
                     const VectorX<Scalar>& E, const QpSettings<Scalar>& settings,
                     const VectorX<Scalar>& gradient) {
  using std::abs;
  using std::sqrt;
  const Scalar unit = Scalar(2) * scalar_traits<Scalar>::epsilon();
  const auto root = [&](Index j) { return sqrt((std::max)(Scalar(0), Scalar(problem.H()(j, j)))); };
  Scalar length(0), slopes(0), dual_scale(1), primal_scale(1), places(0), pressure(0), objective(0);
  for (Index j = 0; j < problem.unknowns(); ++j) length += root(j) * abs(problem.x[j]);
  for (Index j = 0; j < problem.unknowns(); ++j) {
    const Scalar hx = problem.hx[j], g = problem.g[j];
    const Scalar terms = root(j) * length + abs(g) +
                         problem.columns_of_A().size_of_dot(j, problem.y);  // |h_jk| ≤ √(h_jj h_kk)
    raise_error(slopes, Scalar(terms / D[j]));
    for (const Scalar& term : {hx, g, Scalar(hx + g - gradient[j])})
      raise_error(dual_scale, Scalar(abs(term) / D[j]));
    raise_error(primal_scale, Scalar(abs(problem.x[j]) * D[j]));
    objective += (Scalar(0.5) * hx + g) * problem.x[j];
  }
  for (Index i = 0; i < problem.rows(); ++i) {
    const Scalar terms = problem.columns_of_At().size_of_dot(i, problem.x);
    raise_error(places, Scalar(terms / E[i]));
    raise_error(primal_scale, Scalar(abs(problem.ax[i]) / E[i]));
    pressure += abs(problem.y[i]) * terms;
  }
  return !(unit * slopes <= settings.stationarity_tolerance * dual_scale) ||
         !(unit * places <= settings.feasibility_tolerance * primal_scale) ||
         !(unit * pressure <=
           settings.complementarity_tolerance * (std::max)(Scalar(1), Scalar(abs(objective))));
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
