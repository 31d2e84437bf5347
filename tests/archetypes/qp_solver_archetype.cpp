// The archetypes satisfy their concepts and lack the rest; a solver from elsewhere joins through the trait alone; other types
// are no solvers, and asking is no error.

#include <type_traits>

#include "archetypes/qp_solver.hpp"
#include "laws/qp_solver_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

static_assert(BoxQpSolver<BoxQpSolverArchetype<float>, float> && BoxQpSolver<BoxQpSolverArchetype<double>, double>);
static_assert(QpSolver<QpSolverArchetype<float>, float> && QpSolver<QpSolverArchetype<double>, double>);
static_assert(!WarmStartable<BoxQpSolverArchetype<double>> && !WarmStartable<QpSolverArchetype<double>>);
static_assert(!QpSolver<BoxQpSolverArchetype<double>> && !BoxQpSolver<QpSolverArchetype<double>>);
static_assert(!BoxQpSolver<int> && !QpSolver<int> && !WarmStartable<int> && !QpSolver<void*> && !BoxQpSolver<double>);
static_assert(!std::is_copy_constructible_v<QpSolverArchetype<double>>);

namespace other_engine {

// Projected Gauss-Seidel with names of its own.
struct Answer {
  Eigen::VectorXd point, slope;
};
struct Sweeper {
  Eigen::MatrixXd Q;

  bool minimise(const Eigen::VectorXd& c, const Eigen::VectorXd& low, const Eigen::VectorXd& high, Answer& answer) const {
    answer.point = low.cwiseMax(Eigen::VectorXd::Zero(c.size())).cwiseMin(high);
    for (int sweep = 0; sweep < 5000; ++sweep) {
      for (Eigen::Index i = 0; i < c.size(); ++i) {
        const double slope = c[i] + Q.row(i).dot(answer.point);
        answer.point[i] = std::min(std::max(answer.point[i] - slope / Q(i, i), low[i]), high[i]);
      }
    }
    answer.slope = c + Q * answer.point;
    return true;
  }
};

}  // namespace other_engine

namespace clothctl {

template <>
struct qp_solver_traits<other_engine::Sweeper> {
  using result_type = other_engine::Answer;
  static void reserve(other_engine::Sweeper& s, Index n) { s.Q.resize(n, n); }
  static QpStatus set_hessian(other_engine::Sweeper& s, const Eigen::MatrixXd& H) {
    s.Q = H;
    return QpStatus::Solved;
  }
  static QpStatus solve(other_engine::Sweeper& s, const Eigen::VectorXd& g, const Eigen::VectorXd& lb,
                        const Eigen::VectorXd& ub, other_engine::Answer& answer) {
    return s.minimise(g, lb, ub, answer) ? QpStatus::Solved : QpStatus::IterationLimit;
  }
  static const Eigen::VectorXd& solution(const other_engine::Answer& answer) { return answer.point; }
  static const Eigen::VectorXd& bound_multipliers(const other_engine::Answer& answer) { return answer.slope; }
};

}  // namespace clothctl

static_assert(BoxQpSolver<other_engine::Sweeper> && !QpSolver<other_engine::Sweeper> && !WarmStartable<other_engine::Sweeper>);

TEST_CASE("the law of solved holds for an adapted solver and catches one that only claims it", "[archetypes]") {
  std::mt19937 random(31);
  const KnownQp<double> q = draw_qp<double>({.n = 8}, random);
  QpSession<double, other_engine::Sweeper> session;
  REQUIRE(session.set(q) == QpStatus::Solved);
  CHECK(qp_law_solved(session, q, 1e-7) == "");
  KnownQp<double> other = q;
  other.g[0] += 1.0;
  other.x[0] += 1.0;  // a known solution that is none: the law must object
  CHECK(qp_law_solved(session, other, 1e-7) != "");
}

TEST_CASE("the least solvers run through the session", "[archetypes]") {
  BoxQpSolverArchetype<double> box(0);
  QpSolverArchetype<double> rows(0);
  QpResultArchetype<double> result;
  const VectorX<double> v = VectorX<double>::Zero(3), w = VectorX<double>::Zero(2);
  using Box = qp_solver_traits<BoxQpSolverArchetype<double>>;
  using Rows = qp_solver_traits<QpSolverArchetype<double>>;
  CHECK(Box::solve(box, v, v, v, result) == QpStatus::IterationLimit);
  CHECK(Box::solution(result).size() == 3);
  CHECK(Rows::solve(rows, v, v, v, w, w, result) == QpStatus::IterationLimit);
  CHECK(Rows::row_multipliers(result).size() == 2);
}
