#pragma once

// The laws that every QP solver must obey, and random problems with known solutions to check them
// on.
//
//   solved       if the status is Solved, the independent check of the unscaled optimality
//                conditions passes, and the objective is the known one
//   repeats      solving the same problem again takes 0 iterations
//   history      two solvers with the same history give the same bits
//   refusals     NaN, crossed bounds, an asymmetric or concave Hessian, bad rows and a bad warm
//                start are refused, and the next solve is not affected (0 iterations)
//   recovery     the solve after an infeasible or unbounded problem is as good as a cold one
//   memory       repeated solves of one size do not allocate
//
// Each law returns an empty string, or a text that names what failed.

#include <cmath>
#include <limits>
#include <random>
#include <string>

#include "clothctl/concepts/qp_solver.hpp"
#include "clothctl/qp/certificate.hpp"
#include "clothctl/qp/kkt.hpp"
#include "support/allocations.hpp"

namespace clothctl_test {

/// A solver with the optional hooks of warm starts. Axiom: solving the same problem again takes 0
/// iterations.
template <class Solver, class Scalar = double>
concept WarmStartable =
    (clothctl::BoxQpSolver<Solver, Scalar> ||
     clothctl::QpSolver<Solver, Scalar>)&&requires(Solver& solver,
                                                   const clothctl::VectorX<Scalar>& x) {
  { clothctl::qp_solver_traits<Solver>::warm_start(solver, x) } -> std::same_as<bool>;
  clothctl::qp_solver_traits<Solver>::reset(solver);
}
&&(
    requires(Solver& solver, clothctl::Index n) {
      clothctl::qp_solver_traits<Solver>::shift(solver, n);
    } ||
    requires(Solver & solver, clothctl::Index n) {
      clothctl::qp_solver_traits<Solver>::shift(solver, n, n);
    });

using clothctl::Index;
using clothctl::MatrixX;
using clothctl::QpStatus;
using clothctl::VectorX;

/// A problem together with its known optimal x, y and z.
template <class Scalar>
struct KnownQp {
  MatrixX<Scalar> H, A;
  VectorX<Scalar> g, lb, ub, rl, ru;
  VectorX<Scalar> x, y, z;

  /// Objective of the known solution.
  Scalar objective() const { return x.dot(Scalar(0.5) * (H * x) + g); }
};

/// The properties of a random problem.
struct QpFamily {
  /// Unknowns and rows.
  Index n = 10, m = 0;
  /// Rank of H divided by n: 1 is strictly convex, 0 a linear program.
  double rank = 1.0;
  /// Share of the unknowns that lie at a bound, and share of the rows that are active.
  double active = 0.5;
  /// Share of the active bounds and rows whose multiplier is zero.
  double degenerate = 0.0;
  /// Share of the rows that are equalities.
  double equalities = 0.2;
  /// Share of the rows that are multiples of an earlier row.
  double copies = 0.0;
  /// Columns are scaled by 2^±spread at random.
  int spread = 0;
};

/// Draws a problem. A linear program gets so many active bounds that its known solution is optimal.
template <class Scalar>
KnownQp<Scalar> draw_qp(const QpFamily& family, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const Index n = family.n;
  const Index m = family.m;
  const double inf = std::numeric_limits<double>::infinity();
  const auto matrix = [&](Index rows, Index cols) {
    Eigen::MatrixXd M(rows, cols);
    for (Index k = 0; k < M.size(); ++k) M.data()[k] = normal(random);
    return M;
  };
  const Index rank = static_cast<Index>(std::lround(family.rank * static_cast<double>(n)));
  const Eigen::MatrixXd J = matrix(rank, n);
  Eigen::MatrixXd H = J.transpose() * J / static_cast<double>(n);
  if (rank == n) H.diagonal().array() += 0.05;
  Eigen::MatrixXd A = matrix(m, n);
  for (Index i = 1; i < m; ++i) {
    if (uniform(random) < family.copies)
      A.row(i) = (1.0 + std::floor(3.0 * uniform(random))) * A.row(i / 2);
  }
  Eigen::VectorXd scale = Eigen::VectorXd::Ones(n);
  for (Index j = 0; j < n; ++j)
    scale[j] = std::ldexp(1.0, static_cast<int>((2.0 * uniform(random) - 1.0) * family.spread));
  H = scale.asDiagonal() * H * scale.asDiagonal();
  A = A * scale.asDiagonal();

  Eigen::VectorXd x(n), z = Eigen::VectorXd::Zero(n), lb(n), ub(n), y = Eigen::VectorXd::Zero(m),
                        rl(m), ru(m);
  const auto place = [&](double value, double unit, double& lower, double& upper,
                         double& multiplier, bool can_be_open) {
    const bool open = can_be_open && uniform(random) < 0.2;
    lower = open ? -inf : value - unit * (0.1 + uniform(random));
    upper = open && uniform(random) < 0.5 ? inf : value + unit * (0.1 + uniform(random));
    if (uniform(random) >= family.active) return;
    const double size = uniform(random) < family.degenerate ? 0.0 : 0.1 + uniform(random);
    if (uniform(random) < 0.5) {
      lower = value;
      multiplier = size;
    } else {
      upper = value;
      multiplier = -size;
    }
  };
  for (Index j = 0; j < n; ++j) {
    x[j] = normal(random) / scale[j];
    place(x[j], 1.0 / scale[j], lb[j], ub[j], z[j], true);
    z[j] *= scale[j];
  }
  // Values are rounded to Scalar before rows and gradient are formed, so that the known solution
  // stays exact.
  const Eigen::VectorXd Ax = A * x;
  for (Index i = 0; i < m; ++i) {
    place(Ax[i], 1.0, rl[i], ru[i], y[i], true);
    if (uniform(random) < family.equalities) {
      rl[i] = ru[i] = Ax[i];
      y[i] = normal(random);
    }
  }
  const Eigen::VectorXd g = A.transpose() * y + z - H * x;
  KnownQp<Scalar> q;
  q.H = H.template cast<Scalar>();
  q.A = A.template cast<Scalar>();
  q.g = g.template cast<Scalar>();
  q.lb = lb.template cast<Scalar>();
  q.ub = ub.template cast<Scalar>();
  q.rl = rl.template cast<Scalar>();
  q.ru = ru.template cast<Scalar>();
  q.x = x.template cast<Scalar>();
  q.y = y.template cast<Scalar>();
  q.z = z.template cast<Scalar>();
  return q;
}

/// Calls a solver through its trait; passes rows if the solver takes them.
template <class Scalar, class Solver>
class QpSession {
 public:
  using Traits = clothctl::qp_solver_traits<Solver>;
  using SolverResult = typename Traits::result_type;
  static constexpr bool kRows = clothctl::QpSolver<Solver, Scalar>;

  /// Reserves memory and sets the matrices.
  QpStatus set(const KnownQp<Scalar>& q) {
    if constexpr (kRows) {
      Traits::reserve(solver, q.H.rows(), q.A.rows());
      const QpStatus status = Traits::set_hessian(solver, q.H);
      if (status != QpStatus::Solved) return status;
      return Traits::set_rows(solver, q.A);
    } else {
      Traits::reserve(solver, q.H.rows());
      return Traits::set_hessian(solver, q.H);
    }
  }
  /// Solves q.
  QpStatus solve(const KnownQp<Scalar>& q) {
    if constexpr (kRows) {
      return Traits::solve(solver, q.g, q.lb, q.ub, q.rl, q.ru, result);
    } else {
      return Traits::solve(solver, q.g, q.lb, q.ub, result);
    }
  }
  /// Returns the residuals of the last result for q.
  clothctl::KktResiduals<Scalar> residuals(const KnownQp<Scalar>& q) const {
    VectorX<Scalar> y(q.A.rows());
    if constexpr (kRows) y = Traits::row_multipliers(result);
    const VectorX<Scalar> x = Traits::solution(result);
    const VectorX<Scalar> z = Traits::bound_multipliers(result);
    return clothctl::kkt_residuals(q.H, q.g, q.A, q.rl, q.ru, q.lb, q.ub, x, y, z);
  }

  Solver solver;
  SolverResult result;
};

/// Law "solved", for one problem.
template <class Scalar, class Session>
std::string qp_law_solved(Session& session, const KnownQp<Scalar>& q, double tolerance) {
  using std::abs;
  const QpStatus status = session.solve(q);
  if (status != QpStatus::Solved)
    return "solved: status is " + std::string(clothctl::to_string(status));
  const auto r = session.residuals(q);
  if (!(static_cast<double>(r.worst()) <= tolerance))
    return "solved: residual " + std::to_string(static_cast<double>(r.worst()));
  const double known = static_cast<double>(q.objective());
  const double error = abs(static_cast<double>(r.objective) - known) / std::max(1.0, abs(known));
  if (!(error <= tolerance)) return "solved: objective is off by " + std::to_string(error);
  return {};
}

/// Laws "repeats", "history", "refusals" and "memory", for one problem that is new to the session.
template <class Scalar, class Solver>
std::string qp_law_history(const KnownQp<Scalar>& q, double tolerance) {
  QpSession<Scalar, Solver> first, second;
  if (first.set(q) != QpStatus::Solved || second.set(q) != QpStatus::Solved)
    return "history: matrices were refused";
  std::string broken = qp_law_solved(first, q, tolerance);
  if (!broken.empty()) return broken;
  second.solve(q);
  using Traits = clothctl::qp_solver_traits<Solver>;
  const VectorX<Scalar> x = Traits::solution(first.result);
  for (Index i = 0; i < x.size(); ++i) {
    if (!(x[i] <= Traits::solution(second.result)[i] && x[i] >= Traits::solution(second.result)[i]))
      return "repeats: bits differ";
  }
  broken = qp_law_solved(first, q, tolerance);
  if (!broken.empty()) return "repeats: " + broken;
  if constexpr (requires { first.result.iterations; }) {
    if (first.result.iterations != 0) return "repeats: second solve took iterations";
  }
  KnownQp<Scalar> bad = q;
  bad.g[0] = std::numeric_limits<Scalar>::quiet_NaN();
  if (first.solve(bad) != QpStatus::InvalidData) return "refusals: NaN in g";
  bad = q;
  bad.ub[0] = std::numeric_limits<Scalar>::quiet_NaN();
  if (first.solve(bad) != QpStatus::InvalidData) return "refusals: NaN in a bound";
  bad = q;
  bad.lb[0] = Scalar(2);
  bad.ub[0] = Scalar(1);
  if (first.solve(bad) != QpStatus::InvalidData) return "refusals: crossed bounds";
  broken = qp_law_solved(first, q, tolerance);
  if (!broken.empty()) return "refusals: afterwards " + broken;
  if constexpr (requires { first.result.iterations; }) {
    if (first.result.iterations != 0) return "refusals: the active set was lost";
  }
  if (allocation_counting_works()) {
    KnownQp<Scalar> next = q;
    const long before = allocations();
    first.solve(q);
    next.g *= Scalar(-0.5);
    first.solve(next);
    first.solve(q);
    if (allocations() != before) return "memory: a solve allocated";
  }
  bad = q;
  bad.H(0, 0) = std::numeric_limits<Scalar>::infinity();
  if (Traits::set_hessian(second.solver, bad.H) != QpStatus::InvalidData)
    return "refusals: infinity in H";
  if (q.H.rows() > 1) {
    bad = q;
    bad.H(0, 1) += Scalar(1);
    if (Traits::set_hessian(second.solver, bad.H) != QpStatus::InvalidData)
      return "refusals: asymmetric H";
    bad = q;
    bad.H(0, 1) = bad.H(1, 0) = Scalar(2) * (q.H(0, 0) + q.H(1, 1) + Scalar(1));
    if (Traits::set_hessian(second.solver, bad.H) != QpStatus::NonConvex)
      return "refusals: a negative minor of H";
  }
  bad = q;
  bad.H(0, 0) = Scalar(-1);
  if (Traits::set_hessian(second.solver, bad.H) != QpStatus::NonConvex)
    return "refusals: a negative diagonal entry";
  const MatrixX<Scalar> odd = MatrixX<Scalar>::Zero(q.H.rows(), q.H.rows() + 1);
  if (Traits::set_hessian(second.solver, odd) != QpStatus::InvalidData)
    return "refusals: H is not square";
  if constexpr (clothctl::QpSolver<Solver, Scalar>) {
    bad.A.setOnes(q.A.rows() + 1, q.A.cols());
    bad.A(0, 0) = std::numeric_limits<Scalar>::quiet_NaN();
    if (Traits::set_rows(second.solver, bad.A) != QpStatus::InvalidData)
      return "refusals: NaN in A";
    if (Traits::set_rows(second.solver, odd) != QpStatus::InvalidData)
      return "refusals: rows of another length";
  }
  if constexpr (WarmStartable<Solver, Scalar>) {
    const VectorX<Scalar> wrong = VectorX<Scalar>::Constant(q.x.size() + 1, Scalar(0));
    VectorX<Scalar> nan = q.x;
    nan[0] = std::numeric_limits<Scalar>::quiet_NaN();
    if (Traits::warm_start(second.solver, wrong)) return "refusals: a warm start of another size";
    if (Traits::warm_start(second.solver, nan)) return "refusals: NaN in a warm start";
  }
  broken = qp_law_solved(second, q, tolerance);
  if (!broken.empty()) return "refusals: after refused matrices " + broken;
  if constexpr (requires { second.result.iterations; }) {
    if (second.result.iterations != 0) return "refusals: refused matrices lost the active set";
  }
  if constexpr (WarmStartable<Solver, Scalar>) {
    if (!Traits::warm_start(second.solver, x)) return "warm start: refused";
    broken = qp_law_solved(second, q, tolerance);
    if (!broken.empty()) return "warm start: " + broken;
    Traits::reset(second.solver);
    broken = qp_law_solved(second, q, tolerance);
    if (!broken.empty()) return "reset: " + broken;
  }
  return {};
}

/// Law "recovery": a row solver solves q, then q with contradicting rows, then q without bounds or
/// curvature.
template <class Scalar, class Solver>
std::string qp_law_recovery(const KnownQp<Scalar>& q, double tolerance) {
  QpSession<Scalar, Solver> session;
  if (session.set(q) != QpStatus::Solved) return "recovery: matrices were refused";
  std::string broken = qp_law_solved(session, q, tolerance);
  if (!broken.empty()) return broken;
  KnownQp<Scalar> bad = q;  // the row demands more than the bounds allow
  bad.lb = bad.x.array() - Scalar(1);
  bad.ub = bad.x.array() + Scalar(1);
  const Scalar reach = q.A.row(0).cwiseAbs().sum();
  bad.rl[0] = bad.ru[0] = q.A.row(0).dot(q.x) + Scalar(2) * reach;
  if (session.solve(bad) != QpStatus::PrimalInfeasible)
    return "recovery: infeasibility was not seen";
  using Traits = clothctl::qp_solver_traits<Solver>;
  const VectorX<Scalar> y = Traits::row_multipliers(session.result);
  const VectorX<Scalar> z = Traits::bound_multipliers(session.result);
  if (!clothctl::farkas_residuals(bad.A, bad.rl, bad.ru, bad.lb, bad.ub, y, z).holds())
    return "recovery: infeasibility without a certificate";
  broken = qp_law_solved(session, q, tolerance);
  if (!broken.empty()) return "recovery: after an infeasible problem " + broken;
  bad = q;
  bad.H.setConstant(Scalar(0));
  bad.g.setConstant(Scalar(1));
  bad.ub.setConstant(std::numeric_limits<Scalar>::infinity());
  bad.ru.setConstant(std::numeric_limits<Scalar>::infinity());
  bad.lb = -bad.ub;
  bad.rl = -bad.ru;
  if (Traits::set_hessian(session.solver, bad.H) != QpStatus::Solved)
    return "recovery: H = 0 was refused";
  if (session.solve(bad) != QpStatus::DualInfeasible) return "recovery: unboundedness was not seen";
  if constexpr (requires { session.result.ray; }) {
    const VectorX<Scalar> d = session.result.ray;
    if (!clothctl::ray_residuals(bad.H, bad.g, bad.A, bad.rl, bad.ru, bad.lb, bad.ub, d).holds())
      return "recovery: unboundedness without a certificate";
  }
  if (Traits::set_hessian(session.solver, q.H) != QpStatus::Solved)
    return "recovery: H was refused";
  broken = qp_law_solved(session, q, tolerance);
  return broken.empty() ? broken : "recovery: after an unbounded problem " + broken;
}

}  // namespace clothctl_test
