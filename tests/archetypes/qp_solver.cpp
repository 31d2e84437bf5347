// The archetypes of QP solvers satisfy their concepts and have nothing else.

#include <type_traits>

#include "archetypes/qp_solver.hpp"
#include "laws/qp_solver_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

static_assert(BoxQpSolver<BoxQpSolverArchetype<float>, float> &&
              BoxQpSolver<BoxQpSolverArchetype<double>, double>);
static_assert(QpSolver<QpSolverArchetype<float>, float> &&
              QpSolver<QpSolverArchetype<double>, double>);
static_assert(!clothctl_test::WarmStartable<BoxQpSolverArchetype<double>> &&
              !clothctl_test::WarmStartable<QpSolverArchetype<double>>);
static_assert(!QpSolver<BoxQpSolverArchetype<double>> && !BoxQpSolver<QpSolverArchetype<double>>);
static_assert(!std::is_copy_constructible_v<QpSolverArchetype<double>>);

TEST_CASE("the archetypes of solvers run in the session of the law suite", "[archetypes]") {
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
