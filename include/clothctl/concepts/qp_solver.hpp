#pragma once

// BoxQpSolver and QpSolver: what the planner needs from a solver of quadratic programs. Both
// concepts check a trait, never the type itself. To use a solver of your own, specialise
// `qp_solver_traits` for it; the solver itself needs no change. `warm_start`, `shift` and `reset`
// are optional hooks.
//
//   min ½ xᵀHx + gᵀx   subject to   lb ≤ x ≤ ub   and, for QpSolver,   rl ≤ A x ≤ ru
//   H x + g = Aᵀ y + z,   y, z ≥ 0 at a lower bound, ≤ 0 at an upper one

#include <concepts>

#include "clothctl/core/status.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// The result type of a solver that names one; empty for every other type.
template <class Solver>
struct qp_result_of {};
template <class Solver>
requires requires { typename Solver::result_type; }
struct qp_result_of<Solver> {
  using result_type = typename Solver::result_type;
};

}  // namespace detail

/// How a type acts as a QP solver. The primary template forwards to members of the same names;
/// `result_type` is the type that `solve` fills.
template <class Solver>
struct qp_solver_traits : detail::qp_result_of<Solver> {
  /// Makes room for n unknowns. Allocates.
  static void reserve(Solver& solver, Index n) requires requires { solver.reserve(n); }
  { solver.reserve(n); }
  /// Makes room for n unknowns and m rows. Allocates.
  static void reserve(Solver& solver, Index n, Index m) requires requires { solver.reserve(n, m); }
  { solver.reserve(n, m); }
  /// Takes the Hessian, n×n. Returns Solved, InvalidData or NonConvex.
  template <class Matrix>
  requires requires(Solver& s, const Matrix& H) { s.set_hessian(H); }
  [[nodiscard]] static auto set_hessian(Solver& solver, const Matrix& H) {
    return solver.set_hessian(H);
  }
  /// Takes the rows, m×n. Returns Solved or InvalidData.
  template <class Matrix>
  requires requires(Solver& s, const Matrix& A) { s.set_rows(A); }
  [[nodiscard]] static auto set_rows(Solver& solver, const Matrix& A) { return solver.set_rows(A); }
  /// Solves with bounds only.
  template <class Vector, class SolverResult>
  requires requires(Solver& s, const Vector& v, SolverResult& r) { s.solve(v, v, v, r); }
  [[nodiscard]] static auto solve(Solver& solver, const Vector& g, const Vector& lb,
                                  const Vector& ub, SolverResult& result) {
    return solver.solve(g, lb, ub, result);
  }
  /// Solves with bounds and rows.
  template <class Vector, class SolverResult>
  requires requires(Solver& s, const Vector& v, SolverResult& r) { s.solve(v, v, v, v, v, r); }
  [[nodiscard]] static auto solve(Solver& solver, const Vector& g, const Vector& lb,
                                  const Vector& ub, const Vector& rl, const Vector& ru,
                                  SolverResult& result) {
    return solver.solve(g, lb, ub, rl, ru, result);
  }
  /// The minimiser in a result, n.
  template <class SolverResult>
  requires requires(const SolverResult& r) { r.x; }
  static const auto& solution(const SolverResult& result) { return result.x; }
  /// The bound multipliers z in a result, n.
  template <class SolverResult>
  requires requires(const SolverResult& r) { r.bound_multipliers; }
  static const auto& bound_multipliers(const SolverResult& result) {
    return result.bound_multipliers;
  }
  /// The row multipliers y in a result, m.
  template <class SolverResult>
  requires requires(const SolverResult& r) { r.row_multipliers; }
  static const auto& row_multipliers(const SolverResult& result) { return result.row_multipliers; }
  /// Makes the next solve start from x. Returns false when it refuses x (wrong size, or a value
  /// that is not finite).
  template <class Vector>
  requires requires(Solver& s, const Vector& x) { s.warm_start(x); }
  [[nodiscard]] static auto warm_start(Solver& solver, const Vector& x) {
    return solver.warm_start(x);
  }
  /// Receding horizon: unknown i takes over the active-set status of unknown i + unknowns.
  static void shift(Solver& solver, Index unknowns) requires requires { solver.shift(unknowns); }
  { solver.shift(unknowns); }
  /// Receding horizon: unknown i takes over the active-set status of unknown i + unknowns, and row
  /// i that of row i + rows.
  static void shift(Solver& solver, Index unknowns, Index rows) requires requires {
    solver.shift(unknowns, rows);
  }
  { solver.shift(unknowns, rows); }
  /// Forgets the remembered active set.
  static void reset(Solver& solver) requires requires { solver.reset(); }
  { solver.reset(); }
};

namespace detail {

/// What bound-only and general solvers share: a result that can be read, and a Hessian that can be
/// set.
template <class Solver, class Scalar>
concept QpSolverBase = RealScalar<Scalar> && requires {
  typename qp_solver_traits<Solver>::result_type;
} && std::default_initializable<typename qp_solver_traits<Solver>::result_type> &&
    requires(Solver& solver, const MatrixX<Scalar>& M,
             const typename qp_solver_traits<Solver>::result_type& result) {
  { qp_solver_traits<Solver>::set_hessian(solver, M) } -> std::same_as<QpStatus>;
  {
    qp_solver_traits<Solver>::solution(result)
    } -> std::convertible_to<Eigen::Ref<const VectorX<Scalar>>>;
  {
    qp_solver_traits<Solver>::bound_multipliers(result)
    } -> std::convertible_to<Eigen::Ref<const VectorX<Scalar>>>;
};

}  // namespace detail

/// Solves quadratic programs with bounds.
///
/// Axioms: `Solved` means that an independent check of the unscaled optimality conditions passes;
/// refused data (InvalidData from any call, NonConvex from set_hessian) leave the solver as it was,
/// matrices and active set included; after `reserve`, repeated solves of one size never allocate;
/// equal data and equal history give equal bits.
///
/// Optional hooks: `warm_start`, `shift` and `reset` of a solver that remembers its active set, the
/// members `iterations` and `resize` of its result, and construction from QpSettings.
template <class Solver, class Scalar = double>
concept BoxQpSolver = detail::QpSolverBase<Solver, Scalar> &&
    requires(Solver& solver, const VectorX<Scalar>& v, Index n,
             typename qp_solver_traits<Solver>::result_type& result) {
  qp_solver_traits<Solver>::reserve(solver, n);
  { qp_solver_traits<Solver>::solve(solver, v, v, v, result) } -> std::same_as<QpStatus>;
};

/// Solves quadratic programs with bounds and two-sided rows.
///
/// Axioms: those of BoxQpSolver; PrimalInfeasible and DualInfeasible are returned only with a
/// certificate that holds for the caller's data; after an infeasible problem the next solve is no
/// worse than a cold one.
///
/// Optional hooks: `warm_start`, `shift` and `reset` of a solver that remembers its active set, the
/// members `iterations` and `resize` of its result, and construction from QpSettings.
template <class Solver, class Scalar = double>
concept QpSolver = detail::QpSolverBase<Solver, Scalar> &&
    requires(Solver& solver, const MatrixX<Scalar>& M, const VectorX<Scalar>& v, Index n,
             typename qp_solver_traits<Solver>::result_type& result) {
  qp_solver_traits<Solver>::reserve(solver, n, n);
  { qp_solver_traits<Solver>::set_rows(solver, M) } -> std::same_as<QpStatus>;
  { qp_solver_traits<Solver>::solve(solver, v, v, v, v, v, result) } -> std::same_as<QpStatus>;
  {
    qp_solver_traits<Solver>::row_multipliers(result)
    } -> std::convertible_to<Eigen::Ref<const VectorX<Scalar>>>;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
