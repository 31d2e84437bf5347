#pragma once

// One step of iterative refinement on fixed active sets: the optimality equations without the terms
// in ρ and μ, solved with the factor of the regularised ones.

#include <algorithm>

#include "clothctl/qp/detail/proximal_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Moves x and y of `problem` by one refinement step on the sets of its factor. `gradient` is
/// Hx + g - Aᵀy, and ax must be up to date. x stays within its bounds, and no multiplier belongs to
/// an infinite bound afterwards. Work space: `rows` and `delta` with room for m entries, `step` for
/// n. Never allocates.
template <RealScalar Scalar>
void take_refinement_step(ProximalProblem<Scalar>& problem, const VectorX<Scalar>& gradient,
                          VectorX<Scalar>& rows, VectorX<Scalar>& step, VectorX<Scalar>& delta) {
  const KktFactor<Scalar>& factor = problem.factor;
  for (Index k = 0; k < factor.row_size(); ++k) {
    const Index i = factor.row(k);
    const Scalar y = problem.y[i];
    const bool lower = !(problem.rl[i] < problem.ru[i]) || y > Scalar(0) ||
                       (!(y < Scalar(0)) && problem.ax[i] < problem.rl[i]);
    const Scalar edge = lower ? problem.rl[i] : problem.ru[i];
    rows[i] = has_bound(edge) ? Scalar(problem.ax[i] - edge) : Scalar(0);
  }
  problem.factor.solve(gradient, rows, step, delta);
  for (Index k = 0; k < factor.free_size(); ++k) {
    const Index i = factor.unknown(k);
    problem.x[i] =
        (std::min)((std::max)(Scalar(problem.x[i] + step[i]), problem.lo[i]), problem.hi[i]);
  }
  for (Index k = 0; k < factor.row_size(); ++k) {
    const Index i = factor.row(k);
    Scalar y = problem.y[i] + delta[i];
    if (!has_bound(problem.rl[i])) y = (std::min)(y, Scalar(0));
    if (!has_bound(problem.ru[i])) y = (std::max)(y, Scalar(0));
    problem.y[i] = y;
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
