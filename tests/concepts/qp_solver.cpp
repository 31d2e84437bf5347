// A foreign solver satisfies the concepts by a trait alone and passes the law suite. For other
// types the concepts are false instead of a compile error.

#include "clothctl/concepts/qp_solver.hpp"

#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"
#include "laws/qp_solver_laws.hpp"
#include "support/catch.hpp"

namespace other_engine {

// Projected Gauss-Seidel with its own names.
struct Answer {
  Eigen::VectorXd point, slope;
};
struct Sweeper {
  Eigen::MatrixXd Q;

  bool minimise(const Eigen::VectorXd& c, const Eigen::VectorXd& low, const Eigen::VectorXd& high,
                Answer& answer) const {
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
  static QpStatus solve(other_engine::Sweeper& s, const Eigen::VectorXd& g,
                        const Eigen::VectorXd& lb, const Eigen::VectorXd& ub,
                        other_engine::Answer& answer) {
    return s.minimise(g, lb, ub, answer) ? QpStatus::Solved : QpStatus::IterationLimit;
  }
  static const Eigen::VectorXd& solution(const other_engine::Answer& answer) {
    return answer.point;
  }
  static const Eigen::VectorXd& bound_multipliers(const other_engine::Answer& answer) {
    return answer.slope;
  }
};

}  // namespace clothctl

using namespace clothctl;
using namespace clothctl_test;

static_assert(BoxQpSolver<other_engine::Sweeper> && !QpSolver<other_engine::Sweeper> &&
              !clothctl_test::WarmStartable<other_engine::Sweeper>);

namespace {

// Bound solvers that each lack one thing.
struct Base {
  using result_type = QpResult<double>;
  void reserve(Index) {}
  QpStatus set_hessian(const MatrixX<double>&) { return QpStatus::Solved; }
  QpStatus solve(const VectorX<double>&, const VectorX<double>&, const VectorX<double>&,
                 result_type&) {
    return QpStatus::Solved;
  }
};
struct NoResultType : Base {
 private:
  using result_type = void;
};
struct SilentSolve : Base {
  void solve(const VectorX<double>&, const VectorX<double>&, const VectorX<double>&, result_type&) {
  }
};
struct BoolHessian : Base {
  bool set_hessian(const MatrixX<double>&) { return true; }
};
struct NoReserve {
  using result_type = QpResult<double>;
  QpStatus set_hessian(const MatrixX<double>&) { return QpStatus::Solved; }
  QpStatus solve(const VectorX<double>&, const VectorX<double>&, const VectorX<double>&,
                 result_type&) {
    return QpStatus::Solved;
  }
};

}  // namespace

static_assert(BoxQpSolver<Base> && !QpSolver<Base> && !clothctl_test::WarmStartable<Base>);
static_assert(!BoxQpSolver<NoResultType> && !BoxQpSolver<SilentSolve> &&
              !BoxQpSolver<BoolHessian> && !BoxQpSolver<NoReserve>);
static_assert(BoxQpSolver<BoxActiveSet<float>, float> &&
              clothctl_test::WarmStartable<BoxActiveSet<double>> &&
              !QpSolver<BoxActiveSet<double>>);
static_assert(QpSolver<ActiveSet<float>, float> &&
              clothctl_test::WarmStartable<ActiveSet<double>> &&
              !QpSolver<ActiveSet<float>, double>);
static_assert(!BoxQpSolver<int> && !QpSolver<int> && !clothctl_test::WarmStartable<int> &&
              !QpSolver<void*> && !BoxQpSolver<double>);

TEST_CASE("the law of solved problems holds for a foreign solver and detects a wrong solution",
          "[qp_solver]") {
  std::mt19937 random(31);
  const KnownQp<double> q = draw_qp<double>({.n = 8}, random);
  QpSession<double, other_engine::Sweeper> session;
  REQUIRE(session.set(q) == QpStatus::Solved);
  CHECK(qp_law_solved(session, q, 1e-7) == "");
  KnownQp<double> other = q;
  other.g[0] += 1.0;
  other.x[0] += 1.0;  // no longer the solution: the law must fail
  CHECK(qp_law_solved(session, other, 1e-7) != "");
}
