#pragma once

// A QP whose equality rows cannot all be met, relaxed: A u + s⁺ - s⁻ = b with s⁺, s⁻ >= 0 and the
// penalty ρ Σ (s⁺ + s⁻), ρ = 1e3 max(1, H_ii). As long as no multiplier of a row exceeds ρ, rows
// that can be met are met (exact L1 penalty).

#include "clothctl/concepts/qp_solver.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Makes room in a result of a solver, where its type can be sized beforehand (the optional hook
/// `resize` of the concept QpSolver).
template <class Result>
void resize_result(Result& result, Index unknowns, Index rows) {
  if constexpr (requires { result.resize(unknowns, rows); }) result.resize(unknowns, rows);
}

/// Returns the iterations that a result reports (the optional member `iterations`), or 0.
template <class Result>
int iterations_of(const Result& result) {
  if constexpr (requires { result.iterations; }) return static_cast<int>(result.iterations);
  return 0;
}

/// Makes the next solve start from `x`, where the solver has that hook. A solver that refuses `x`
/// starts as it would without.
template <class Solver, RealScalar Scalar>
void start_from(Solver& solver, const VectorX<Scalar>& x) {
  if constexpr (requires { qp_solver_traits<Solver>::warm_start(solver, x); })
    (void)qp_solver_traits<Solver>::warm_start(solver, x);
}

/// Loads a problem with rows into a solver and solves it, from `start` unless that is empty.
template <class Solver, RealScalar Scalar>
QpStatus solve_with_rows(Solver& solver, const MatrixX<Scalar>& hessian,
                         const MatrixX<Scalar>& rows, const VectorX<Scalar>& gradient,
                         const VectorX<Scalar>& lower, const VectorX<Scalar>& upper,
                         const VectorX<Scalar>& row_lower, const VectorX<Scalar>& row_upper,
                         typename qp_solver_traits<Solver>::result_type& result,
                         const VectorX<Scalar>& start = {}) {
  using Traits = qp_solver_traits<Solver>;
  using View = Eigen::Ref<const VectorX<Scalar>>;
  QpStatus status = Traits::set_hessian(solver, hessian);
  if (status == QpStatus::Solved) status = Traits::set_rows(solver, rows);
  if (status != QpStatus::Solved) return status;
  if (start.size() > 0) start_from(solver, start);
  return Traits::solve(solver, View(gradient), View(lower), View(upper), View(row_lower),
                       View(row_upper), result);
}

/// The QP with slack on the patch rows, A u + s⁺ - s⁻, and the penalty ρ on s⁺ and s⁻.
template <RealScalar Scalar, QpSolver<Scalar> RowSolver>
struct RelaxedQp {
  /// Solves the relaxed problem; it has a warm start of its own.
  RowSolver solver;
  /// The last result.
  typename qp_solver_traits<RowSolver>::result_type result;
  /// The relaxed problem in (u, s⁺, s⁻).
  MatrixX<Scalar> hessian, rows;
  VectorX<Scalar> gradient, lower, upper;

  /// Makes room for a problem with `slack` rows that may be relaxed. Allocates.
  void reserve(Index unknowns, Index row_count, Index slack) {
    const Index n = unknowns + 2 * slack;
    hessian.setZero(n, n);
    rows.setZero(row_count, n);
    for (VectorX<Scalar>* v : {&gradient, &lower, &upper}) v->setZero(n);
    qp_solver_traits<RowSolver>::reserve(solver, n, row_count);
    resize_result(result, n, row_count);
  }

  /// Fills the relaxed problem. In each frame of `limits + patch_rows` rows only the patch rows get
  /// slack. Never allocates.
  void fill(const MatrixX<Scalar>& h, const MatrixX<Scalar>& a, const VectorX<Scalar>& g,
            const VectorX<Scalar>& lb, const VectorX<Scalar>& ub, const VectorX<Scalar>& rl,
            const VectorX<Scalar>& ru, Index limits, Index patch_rows) {
    const Index n = h.rows(), slack = (gradient.size() - n) / 2;
    Scalar size = Scalar(1);
    for (Index i = 0; i < n; ++i) {
      if (size < h(i, i)) size = h(i, i);
    }
    hessian.topLeftCorner(n, n) = h;
    rows.leftCols(n) = a;
    gradient.head(n) = g;
    gradient.tail(2 * slack).setConstant(Scalar(1e3) * size);
    lower.head(n) = lb;
    upper.head(n) = ub;
    for (Index row = 0, i = 0; row < a.rows(); ++row) {
      if (row % (limits + patch_rows) < limits) continue;
      rows(row, n + i) = Scalar(1);
      rows(row, n + slack + i) = Scalar(-1);
      const bool used = !is_unbounded(rl[row]) || !is_unbounded(ru[row]);
      upper[n + i] = upper[n + slack + i] = used ? scalar_traits<Scalar>::infinity() : Scalar(0);
      ++i;
    }
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
