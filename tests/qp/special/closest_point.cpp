#include "clothctl/qp/detail/special/closest_point.hpp"

#include <random>

#include "clothctl/qp/active_set.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class S>
struct Contradiction {
  MatrixX<S> H, A;
  VectorX<S> g, lb, ub, rl, ru;

  Contradiction(Index n, Index m, std::mt19937& random) {
    std::normal_distribution<double> normal;
    const auto draw = [&](Index rows, Index columns) {
      MatrixX<S> M(rows, columns);
      for (Index k = 0; k < M.size(); ++k) M.data()[k] = static_cast<S>(normal(random));
      return M;
    };
    const MatrixX<S> J = draw(n / 2 + 1, n);
    H = J.transpose() * J;
    A = draw(m, n);
    if (m > 2) A.row(1) = S(3) * A.row(0);
    g = draw(n, 1);
    lb = -draw(n, 1).cwiseAbs() - VectorX<S>::Ones(n);
    ub = draw(n, 1).cwiseAbs();
    rl = S(3) * draw(m, 1);
    ru = rl + draw(m, 1).cwiseAbs();
    for (Index i = 0; i < m; ++i) {
      if (i % 4 == 1) ru[i] = rl[i];
      if (i % 4 == 2) rl[i] = -scalar_traits<S>::infinity();
    }
  }

  // Violation of rl ≤ Ax + s ≤ ru and of the bounds, and the slope of ½|s|² along unknowns that no
  // bound stops.
  double error(const VectorX<S>& x, const VectorX<S>& s) const {
    const VectorX<S> ax = A * x, slope = -(A.transpose() * s);
    double worst = 0;
    for (Index i = 0; i < A.rows(); ++i) {
      if (!is_unbounded(rl[i])) worst = std::max(worst, double(rl[i] - ax[i] - s[i]));
      if (!is_unbounded(ru[i])) worst = std::max(worst, double(ax[i] + s[i] - ru[i]));
    }
    for (Index j = 0; j < x.size(); ++j) {
      worst = std::max(worst, std::max(double(lb[j] - x[j]), double(x[j] - ub[j])));
      double way = -double(slope[j]);  // downhill
      const double edge = sizeof(S) == 8 ? 1e-7 : 1e-3;
      if (double(x[j] - lb[j]) < edge) way = std::max(0.0, way);
      if (double(ub[j] - x[j]) < edge) way = std::min(0.0, way);
      worst = std::max(worst, std::abs(way));
    }
    return worst;
  }
};

}  // namespace

TEMPLATE_TEST_CASE("on request, infeasible problems end at the closest point", "[qp]", float,
                   double) {
  using S = TestType;
  const double tolerance = sizeof(S) == 8 ? 1e-6 : 2e-2;
  std::mt19937 random(77);
  int infeasible = 0, unfinished = 0;
  for (int trial = 0; trial < (sizeof(S) == 8 ? 200 : 2000); ++trial) {
    const Contradiction<S> q(2 + static_cast<Index>(random() % 15),
                             3 + static_cast<Index>(random() % 20), random);
    QpSettings<S> settings;
    settings.closest_point = true;
    ActiveSet<S> solver(settings), plain;
    QpResult<S> result, proof;
    for (ActiveSet<S>* s : {&solver, &plain}) {
      REQUIRE(s->set_hessian(q.H) == QpStatus::Solved);
      REQUIRE(s->set_rows(q.A) == QpStatus::Solved);
    }
    const QpStatus status = solver.solve(q.g, q.lb, q.ub, q.rl, q.ru, result);
    REQUIRE(plain.solve(q.g, q.lb, q.ub, q.rl, q.ru, proof) == status);
    if (status != QpStatus::PrimalInfeasible) {
      CHECK(result.row_shifts.cwiseAbs().maxCoeff() == S(0));
      continue;
    }
    ++infeasible;
    if (!std::string(result.message).empty()) ++unfinished;
    CHECK(result.row_multipliers == proof.row_multipliers);
    CHECK(result.bound_multipliers == proof.bound_multipliers);
    CHECK(proof.row_shifts.cwiseAbs().maxCoeff() == S(0));
    CHECK(q.error(result.x, result.row_shifts) <
          tolerance * (1.0 + double(q.A.cwiseAbs().maxCoeff())));
    if (sizeof(S) == 4) continue;
    // Among the closest points the objective is least: no move within them lowers it.
    const VectorX<S> width = VectorX<S>::Constant(q.A.rows(), S(1e-8));
    QpResult<S> best;
    const QpStatus found = plain.solve(q.g, q.lb, q.ub, q.rl - result.row_shifts - width,
                                       q.ru - result.row_shifts + width, best);
    REQUIRE((found == QpStatus::Solved || found == QpStatus::SolvedInaccurate));
    const S objective = result.x.dot(S(0.5) * (q.H * result.x) + q.g);
    CHECK(objective <= best.objective + S(1e-4) * (S(1) + std::abs(best.objective)));
  }
  CHECK(infeasible > 100);
  // In float, rounding can prevent the least objective if nearly dependent rows meet (one in a
  // thousand).
  CHECK(unfinished <= (sizeof(S) == 8 ? 0 : infeasible / 100));
}

TEST_CASE("contradicting rows meet in the middle, weighted by their scale", "[qp]") {
  for (const double scale : {1.0, 2.0}) {
    QpSettings<double> settings;
    settings.closest_point = true;
    ActiveSet<double> solver(settings);
    MatrixX<double> A(2, 2);
    A << 1.0, 0.0, scale, 0.0;
    const double inf = scalar_traits<double>::infinity();
    VectorX<double> g(2), lb(2), ub(2), rl(2), ru(2);
    g << 0.0, -3.0;
    lb.setConstant(-10.0);
    ub.setConstant(inf);
    rl << 3.0, -inf;
    ru << inf, scale;
    REQUIRE(solver.set_hessian(MatrixX<double>::Identity(2, 2)) == QpStatus::Solved);
    REQUIRE(solver.set_rows(A) == QpStatus::Solved);
    QpResult<double> result;
    REQUIRE(solver.solve(g, lb, ub, rl, ru, result) == QpStatus::PrimalInfeasible);
    const double x =
        (3.0 + scale * scale) / (1.0 + scale * scale);  // least (3 - x)² + scale² (x - 1)²
    CHECK(result.x[0] == Approx(x));
    CHECK(result.x[1] == Approx(3.0));
    CHECK(result.row_shifts[0] == Approx(3.0 - x));
    CHECK(result.row_shifts[1] == Approx(scale * (1.0 - x)));
    // The next feasible solve is as good as a cold one.
    rl[0] = 0.5;
    REQUIRE(solver.solve(g, lb, ub, rl, ru, result) == QpStatus::Solved);
    CHECK(result.x[0] == Approx(0.5));
    CHECK(result.row_shifts.norm() == 0.0);
  }
}

TEST_CASE("constraints active at the closest point become equalities, the others stay open",
          "[qp]") {
  // x0 = 4 contradicts x0 <= 1. x1 <= 2 and a slack row of x1 are not involved.
  detail::ProximalProblem<double> problem;
  detail::ClosestPoint<double> closest;
  problem.reserve(2, 3);
  problem.resize(2, 3);
  closest.reserve(2, 3);
  problem.A() << 1.0, 0.0, 0.0, 1.0, 3.0, 0.0;
  problem.At() = problem.A().transpose();
  const double none = detail::no_bound<double>();
  problem.lo << -5.0, -5.0;
  problem.hi << 1.0, 2.0;
  problem.rl << 4.0, -none, -none;
  problem.ru << 4.0, 7.0, 5.0;  // 3 x0 <= 5 holds
  problem.x << 0.0, 0.0;
  for (auto& state : problem.state) state = detail::ProximalProblem<double>::State::Free;
  int iterations = 0;
  REQUIRE(closest.find(problem, detail::Budget(QpSettings<double>{}, 5), iterations));
  CHECK(closest.shifts()[0] == Approx(3.0));
  VectorX<double> E(3);
  E << 2.0, 1.0, 1.0;
  problem.rl[0] = problem.ru[0] = 8.0;  // row 0 scaled by two
  problem.x[0] = problem.hi[0];
  closest.tighten_bounds(problem, E);
  CHECK(problem.rl[0] == Approx(2.0));
  CHECK(problem.ru[0] == problem.rl[0]);
  CHECK(problem.lo[0] == 1.0);
  CHECK(problem.hi[0] == 1.0);
  CHECK(problem.ru[1] == 7.0);
  CHECK(problem.ru[2] == 5.0);
  CHECK_FALSE(detail::has_bound(problem.rl[1]));
  CHECK_FALSE(detail::has_bound(problem.rl[2]));
  CHECK(problem.lo[1] == -5.0);
  CHECK(problem.hi[1] == 2.0);
  // Two contradicting rows: both become equalities at their distance.
  problem.rl << 4.0, -none, -none;
  problem.ru << none, 7.0, 6.0;  // x0 >= 4, 3 x0 <= 6
  problem.lo[0] = -5.0;
  problem.hi[0] = 9.0;
  problem.x[0] = 0.0;
  problem.state[0] = detail::ProximalProblem<double>::State::Free;
  REQUIRE(closest.find(problem, detail::Budget(QpSettings<double>{}, 5), iterations));
  closest.tighten_bounds(problem, VectorX<double>::Ones(3));
  CHECK(problem.rl[0] == problem.ru[0]);
  CHECK(problem.rl[2] == problem.ru[2]);
  CHECK(problem.rl[0] == Approx(2.2));  // least (4 - x)² + (6 - 3x)²
  CHECK(problem.rl[2] == Approx(6.6));
  CHECK(problem.lo[0] == -5.0);
  CHECK(problem.hi[0] == 9.0);
}

TEST_CASE("the search for the closest point obeys iteration limits and does not allocate", "[qp]") {
  std::mt19937 random(5);
  const Contradiction<double> q(40, 60, random);
  QpSettings<double> settings;
  settings.closest_point = true;
  ActiveSet<double> solver(settings);
  REQUIRE(solver.set_hessian(q.H) == QpStatus::Solved);
  REQUIRE(solver.set_rows(q.A) == QpStatus::Solved);
  QpResult<double> result;
  REQUIRE(solver.solve(q.g, q.lb, q.ub, q.rl, q.ru, result) == QpStatus::PrimalInfeasible);
  const int rounds = result.iterations;
  const long before = clothctl_test::allocations();
  const QpStatus again = solver.solve(q.g, q.lb, q.ub, q.rl, q.ru, result);
  const long taken = clothctl_test::allocations() - before;
  CHECK(again == QpStatus::PrimalInfeasible);
  if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);

  ActiveSet<double> plain;
  QpResult<double> proof;
  REQUIRE(plain.set_hessian(q.H) == QpStatus::Solved);
  REQUIRE(plain.set_rows(q.A) == QpStatus::Solved);
  REQUIRE(plain.solve(q.g, q.lb, q.ub, q.rl, q.ru, proof) == QpStatus::PrimalInfeasible);
  REQUIRE(proof.iterations < rounds);
  settings.max_iterations = proof.iterations + 1;
  ActiveSet<double> short_of_time(settings);
  REQUIRE(short_of_time.set_hessian(q.H) == QpStatus::Solved);
  REQUIRE(short_of_time.set_rows(q.A) == QpStatus::Solved);
  REQUIRE(short_of_time.solve(q.g, q.lb, q.ub, q.rl, q.ru, result) == QpStatus::PrimalInfeasible);
  CHECK(std::string(result.message).find("closest point was not found") != std::string::npos);
  CHECK(result.iterations <= settings.max_iterations);
  const VectorX<double> reached = q.A * result.x + result.row_shifts;
  for (Index i = 0; i < q.A.rows(); ++i) {
    CHECK(reached[i] <= q.ru[i] + 1e-9);
    if (!is_unbounded(q.rl[i])) CHECK(reached[i] >= q.rl[i] - 1e-9);
  }
}

TEST_CASE("a closest point without a least objective is reported", "[qp]") {
  QpSettings<double> settings;
  settings.closest_point = true;
  ActiveSet<double> solver(settings);
  MatrixX<double> A(2, 2);
  A << 1.0, 0.0, 1.0, 0.0;
  const double inf = scalar_traits<double>::infinity();
  VectorX<double> g(2), lb(2), ub(2), rl(2), ru(2);
  g << 0.0, -1.0;  // falls along x1 without limit
  lb.setConstant(-inf);
  ub.setConstant(inf);
  rl << 3.0, -inf;
  ru << inf, 1.0;
  REQUIRE(solver.set_hessian(MatrixX<double>::Zero(2, 2)) == QpStatus::Solved);
  REQUIRE(solver.set_rows(A) == QpStatus::Solved);
  QpResult<double> result;
  REQUIRE(solver.solve(g, lb, ub, rl, ru, result) == QpStatus::PrimalInfeasible);
  CHECK(result.x[0] == Approx(2.0));
  CHECK(std::string(result.message).find("unbounded") != std::string::npos);
}
