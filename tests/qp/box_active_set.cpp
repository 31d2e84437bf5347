#include "clothctl/qp/box_active_set.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <limits>
#include <vector>

#include "laws/qp_solver_laws.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/qpt.hpp"
#include "support/shared_data.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

static_assert(BoxQpSolver<BoxActiveSet<float>, float> && BoxQpSolver<BoxActiveSet<double>, double>);
static_assert(clothctl_test::WarmStartable<BoxActiveSet<float>, float> &&
              clothctl_test::WarmStartable<BoxActiveSet<double>, double>);
static_assert(!QpSolver<BoxActiveSet<double>>);

namespace {

template <class S>
double tolerance() {
  return sizeof(S) == sizeof(float) ? 2e-4 : 1e-8;
}

VectorX<double> vec(double a, double b) { return (VectorX<double>(2) << a, b).finished(); }
const double inf = std::numeric_limits<double>::infinity();

}  // namespace

TEMPLATE_TEST_CASE("random bound-constrained problems of every kind are solved", "[qp]", float,
                   double) {
  using S = TestType;
  std::mt19937 random(11);
  for (int trial = 0; trial < trials(150, 20000); ++trial) {
    QpFamily family;
    family.n = 1 + trial % 60;
    family.active = 0.1 * (trial % 11);
    family.degenerate = trial % 3 == 0 ? 0.5 : 0.0;
    family.rank = trial % 4 == 1 ? 0.6 : 1.0;
    family.spread = trial % 5 == 2 ? (sizeof(S) == sizeof(float) ? 2 : 8) : 0;
    const KnownQp<S> q = draw_qp<S>(family, random);
    QpSession<S, BoxActiveSet<S>> session;
    REQUIRE(session.set(q) == QpStatus::Solved);
    INFO("trial " << trial);
    CHECK(qp_law_solved(session, q, tolerance<S>()) == "");
    for (Index i = 0; i < q.x.size(); ++i) {
      REQUIRE(session.result.x[i] >= q.lb[i]);
      REQUIRE(session.result.x[i] <= q.ub[i]);
    }
  }
}

TEMPLATE_TEST_CASE("the box solver obeys the laws of history", "[qp]", float, double) {
  using S = TestType;
  std::mt19937 random(12);
  for (Index n : {Index(1), Index(7), Index(40), Index(130)}) {
    QpFamily family;
    family.n = n;
    CHECK(qp_law_history<S, BoxActiveSet<S>>(draw_qp<S>(family, random), tolerance<S>()) == "");
    family.rank = 0.5;
    CHECK(qp_law_history<S, BoxActiveSet<S>>(draw_qp<S>(family, random), tolerance<S>()) == "");
  }
}

TEST_CASE("without bounds the box solver is a linear solve", "[qp]") {
  std::mt19937 random(13);
  const KnownQp<double> q = draw_qp<double>({.n = 150, .active = 0.0}, random);
  BoxActiveSet<double> solver;
  solver.reserve(150);
  REQUIRE(solver.set_hessian(q.H) == QpStatus::Solved);
  QpResult<double> result;
  const VectorX<double> ub = VectorX<double>::Constant(150, inf), lb = -ub;
  REQUIRE(solver.solve(q.g, lb, ub, result) == QpStatus::Solved);
  CHECK(result.iterations == 0);
  CHECK((q.H * result.x + q.g).cwiseAbs().maxCoeff() < 1e-12 * 150);
  CHECK(solver.free_count() == 150);
}

TEST_CASE("flat directions end at a bound or prove that the problem is unbounded", "[qp]") {
  MatrixX<double> H = MatrixX<double>::Zero(2, 2);
  H(0, 0) = 1.0;
  BoxActiveSet<double> solver;
  solver.reserve(2);
  REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
  QpResult<double> r;
  CHECK(solver.solve(vec(-2.0, -1.0), vec(0.0, 0.0), vec(9.0, 3.0), r) == QpStatus::Solved);
  CHECK(r.x == vec(2.0, 3.0));
  CHECK(solver.solve(vec(-2.0, -1.0), vec(0.0, 0.0), vec(9.0, inf), r) == QpStatus::DualInfeasible);
  CHECK(r.ray[0] == Approx(0.0).margin(1e-12));
  CHECK(r.ray[1] > 0.0);
  CHECK(solver.solve(vec(-2.0, 1.0), vec(0.0, -inf), vec(9.0, inf), r) == QpStatus::DualInfeasible);
  CHECK(r.ray[1] < 0.0);
  CHECK(solver.solve(vec(-2.0, 0.0), vec(0.0, -inf), vec(9.0, inf), r) == QpStatus::Solved);
  CHECK(r.x[0] == Approx(2.0));

  // Flat along (1, 1), where the objective falls.
  H << 1.0, -1.0, -1.0, 1.0;
  REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
  CHECK(solver.solve(vec(-1.0, -1.0), vec(0.0, 0.0), vec(inf, inf), r) == QpStatus::DualInfeasible);
  CHECK(r.ray[0] == Approx(r.ray[1]));
  CHECK(solver.solve(vec(-1.0, -1.0), vec(0.0, 0.0), vec(inf, 5.0), r) == QpStatus::Solved);
  CHECK(r.x[1] == 5.0);
  CHECK(r.x[0] == Approx(6.0));
}

// Sequences from few active bounds to many and back, so that the solver changes its mode.
TEMPLATE_TEST_CASE("both modes of the box solver find the solution of a cold solve", "[qp]", float,
                   double) {
  using S = TestType;
  std::mt19937 random(17);
  std::normal_distribution<double> normal;
  for (const double condition : {1e1, sizeof(S) == 8 ? 1e7 : 1e3}) {
    for (const Index n : {Index(9), Index(60), Index(220)}) {
      MatrixX<double> J(n, n);
      for (Index k = 0; k < J.size(); ++k)
        J.data()[k] = normal(random) / std::sqrt(static_cast<double>(n));
      for (Index i = 0; i < n; ++i)
        J.row(i) *= std::pow(condition, -0.5 * static_cast<double>(i) / static_cast<double>(n));
      const MatrixX<S> H =
          (J.transpose() * J + MatrixX<double>::Identity(n, n) / condition).template cast<S>();
      BoxActiveSet<S> warm;
      warm.reserve(n);
      QpResult<S> result, cold_result;
      VectorX<S> g = VectorX<S>::Zero(n);
      REQUIRE(warm.set_hessian(H) == QpStatus::Solved);
      Index fewest = n, most = 0;
      for (int frame = 0; frame < 30; ++frame) {
        if (frame == 12)
          REQUIRE(warm.set_hessian(H) ==
                  QpStatus::Solved);  // forgets what was computed for H, keeps the active set
        for (Index i = 0; i < n; ++i) g[i] = S(0.8) * g[i] + S(0.2 * normal(random));
        // From few active bounds to most of them.
        const S farthest = H.llt().solve(g).cwiseAbs().maxCoeff();
        const VectorX<S> ub = VectorX<S>::Constant(n, S(frame % 15 < 10 ? 0.9 : 0.01) * farthest),
                         lb = S(-0.8) * ub;
        const QpStatus status = warm.solve(g, lb, ub, result);
        const long before = clothctl_test::allocations();
        const QpStatus again = warm.solve(g, lb, ub, result);
        const long taken = clothctl_test::allocations() - before;
        REQUIRE(status == QpStatus::Solved);
        REQUIRE(again == QpStatus::Solved);
        CHECK(result.iterations == 0);
        if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
        BoxActiveSet<S> cold;
        REQUIRE(cold.set_hessian(H) == QpStatus::Solved);
        REQUIRE(cold.solve(g, lb, ub, cold_result) == QpStatus::Solved);
        const S scale = S(1) + std::abs(cold_result.objective);
        CHECK(std::abs(result.objective - cold_result.objective) < S(tolerance<S>()) * scale);
        CHECK((result.x.array() >= lb.array()).all());
        CHECK((result.x.array() <= ub.array()).all());
        fewest = std::min(fewest, n - warm.free_count());
        most = std::max(most, n - warm.free_count());
      }
      if (n > 9) {
        CHECK(fewest <= n / 3);
        CHECK(most > n / 3);
      }
    }
  }
}

TEST_CASE("a solver with a large reserved size solves small problems", "[qp]") {
  BoxActiveSet<double> solver;
  solver.reserve(500);
  for (const Index n : {20, 450, 100}) {
    const MatrixX<double> H = 2.0 * MatrixX<double>::Identity(n, n);
    const VectorX<double> g = VectorX<double>::LinSpaced(n, -3.0, 1.0),
                          ub = VectorX<double>::Ones(n), lb = -ub;
    QpResult<double> r;
    REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
    for (int frame = 0; frame < 20; ++frame) {
      REQUIRE(solver.solve(g, lb, ub, r) == QpStatus::Solved);
      CHECK((r.x - (-0.5 * g).cwiseMax(lb).cwiseMin(ub)).cwiseAbs().maxCoeff() < 1e-12);
    }
  }
}

TEMPLATE_TEST_CASE("a warm start at a zero gradient ends at once", "[qp]", float, double) {
  using S = TestType;
  std::mt19937 random(14);
  std::normal_distribution<double> normal;
  for (const Index n : {1, 8, 49}) {
    MatrixX<double> J(n, n);
    for (Index k = 0; k < J.size(); ++k) J.data()[k] = normal(random);
    const MatrixX<S> H = (J.transpose() * J + MatrixX<double>::Identity(n, n)).template cast<S>();
    BoxActiveSet<S> solver;
    REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
    const VectorX<S> ub = VectorX<S>::Constant(n, S(2)), lb = -ub, none = VectorX<S>::Zero(n);
    QpResult<S> r;
    REQUIRE(solver.warm_start(VectorX<S>::Ones(n)));
    for (int frame = 0; frame < 20; ++frame) {
      REQUIRE(solver.solve(none, lb, ub, r) == QpStatus::Solved);
      CHECK(r.iterations == 0);
      CHECK(double(r.x.norm()) < 1e-5);
    }
  }
}

TEST_CASE("with small iteration limits, repeated solves make progress in every mode", "[qp]") {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 60; ++trial) {
    const Index n = 3 + trial % 30;
    MatrixX<double> J(n, n);
    for (Index k = 0; k < J.size(); ++k) J.data()[k] = normal(random);
    const MatrixX<double> H = J.transpose() * J + 0.01 * MatrixX<double>::Identity(n, n);
    VectorX<double> g(n), lb(n), ub(n);
    for (Index i = 0; i < n; ++i) {
      g[i] = 10.0 * normal(random);
      lb[i] = -std::abs(normal(random));
      ub[i] = std::abs(normal(random));
    }
    for (int budget = 1; budget <= 5; ++budget) {
      QpSettings<double> settings;
      settings.max_iterations = budget;
      BoxActiveSet<double> solver(settings);
      QpResult<double> r;
      REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
      const VectorX<double> wide = VectorX<double>::Constant(n, 1e4);
      for (int k = 0; k < 30; ++k)
        (void)solver.solve(g, -wide, wide,
                           r);  // no bound is active, so the active-set mode is prepared
      double last = std::numeric_limits<double>::infinity();
      QpStatus status = QpStatus::IterationLimit;
      for (int k = 0; k < 300 && status != QpStatus::Solved; ++k) {
        status = solver.solve(g, lb, ub, r);
        CHECK(r.iterations <= budget);
        CHECK(r.objective <= last + 1e-9 * std::abs(last));
        last = r.objective;
      }
      CHECK(status == QpStatus::Solved);
    }
  }
}

TEST_CASE("the solution of a linear program over a box is a corner", "[qp]") {
  BoxActiveSet<double> solver;
  solver.reserve(30);
  REQUIRE(solver.set_hessian(MatrixX<double>::Zero(30, 30)) == QpStatus::Solved);
  VectorX<double> g(30);
  for (Index i = 0; i < 30; ++i) g[i] = i % 3 == 0 ? 0.0 : i % 3 == 1 ? 1.0 : -1.0;
  const VectorX<double> lb = VectorX<double>::Constant(30, -2.0),
                        ub = VectorX<double>::Constant(30, 5.0);
  QpResult<double> r;
  REQUIRE(solver.solve(g, lb, ub, r) == QpStatus::Solved);
  CHECK(r.objective == Approx(-70.0));
}

TEST_CASE("the box solver refuses indefinite Hessians with a message", "[qp]") {
  BoxActiveSet<double> solver;
  solver.reserve(2);
  MatrixX<double> H = MatrixX<double>::Identity(2, 2);
  H(1, 1) = -1.0;
  CHECK(solver.set_hessian(H) == QpStatus::NonConvex);
  QpResult<double> r;
  CHECK(solver.solve(vec(0, 0), vec(-1, -1), vec(1, 1), r) == QpStatus::NonConvex);
  CHECK(r.invalid_index == 3);
  H << 1.0, 2.0, 2.0, 1.0;
  CHECK(solver.set_hessian(H) == QpStatus::NonConvex);
  H << 0.0, 1.0, 1.0, 0.0;
  CHECK(solver.set_hessian(H) == QpStatus::NonConvex);
  CHECK(solver.refusal().index == 1);
  MatrixX<double> three =
      MatrixX<double>::Constant(3, 3, -0.9);  // eigenvalue -0.8, which no 2×2 minor shows
  three.diagonal().setOnes();
  REQUIRE(solver.set_hessian(three) == QpStatus::Solved);
  const VectorX<double> g = VectorX<double>::Constant(3, -1.0),
                        ub = VectorX<double>::Constant(3, 100.0);
  CHECK(solver.solve(g, -ub, ub, r) == QpStatus::NonConvex);
  CHECK(solver.set_hessian(MatrixX<double>::Constant(2, 2, inf)) == QpStatus::InvalidData);
  CHECK(solver.solve(g, -ub, ub, r) == QpStatus::NonConvex);  // the old H is still in use
}

TEMPLATE_TEST_CASE("the box solver recognises progress beside a large constant in the objective",
                   "[qp]", float, double) {
  using S = TestType;
  constexpr Index n = 60;
  for (double far : {0.0, 1e6, 1e8, 1e10, 1e12}) {
    MatrixX<S> H = MatrixX<S>::Zero(n, n);
    VectorX<S> g = VectorX<S>::Constant(n, S(1e-6)), lb = VectorX<S>::Zero(n);
    VectorX<S> ub = VectorX<S>::Constant(n, std::numeric_limits<S>::infinity());
    for (Index i = 1; i < n; ++i) {
      H(i, i) = S(2);
      if (i > 1) H(i, i - 1) = H(i - 1, i) = S(-1);
    }
    g[0] = S(1);
    g[1] = S(-1e-2);
    lb[0] = ub[0] = S(far);
    BoxActiveSet<S> solver;
    REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
    QpResult<S> r;
    INFO("far " << far);
    CHECK(solver.solve(g, lb, ub, r) == QpStatus::Solved);
    CHECK(static_cast<double>(r.x[1]) == Approx(0.0093).epsilon(0.2));
    CHECK(r.stationarity <= QpSettings<S>::default_tolerance());
  }
}

TEMPLATE_TEST_CASE("nearly flat boxes end at their minimum, and flat ones with an exact ray",
                   "[qp]", float, double) {
  using S = TestType;
  const bool single = sizeof(S) == sizeof(float);
  const VectorX<S> ub = VectorX<S>::Constant(3, std::numeric_limits<S>::infinity());
  MatrixX<S> H = MatrixX<S>::Zero(3, 3);
  VectorX<S> g = VectorX<S>::Constant(3, S(-1));
  QpResult<S> r;
  BoxActiveSet<S> solver;
  for (double e :
       single ? std::vector<double>{1e-5, 1e-4, 1e-3} : std::vector<double>{1e-11, 1e-10, 3e-10}) {
    H << S(1), S(-1), S(0), S(-1), S(1.0 + e), S(0), S(0), S(0), S(1);
    REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
    CHECK(solver.solve(g, -ub, ub, r) == QpStatus::Solved);
    CHECK(r.ray.isZero(S(0)));
  }
  H(1, 1) = S(1);
  REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
  CHECK(solver.solve(g, -ub, ub, r) == QpStatus::DualInfeasible);
  CHECK(r.ray[0] == r.ray[1]);
  CHECK(r.ray[2] == S(0));
  g << S(1), S(-1.0001), S(-1);
  CHECK(solver.solve(g, -ub, ub, r) == QpStatus::DualInfeasible);
  CHECK(g.dot(r.ray) < S(0));
}

TEST_CASE("the box solver refuses bad settings and bad warm starts", "[qp]") {
  QpSettings<double> settings;
  settings.stationarity_tolerance = 0.0;
  BoxActiveSet<double> careless(settings);
  QpResult<double> r;
  REQUIRE(careless.set_hessian(MatrixX<double>::Identity(2, 2)) == QpStatus::Solved);
  CHECK(careless.solve(vec(0, 0), vec(0, 0), vec(1, 1), r) == QpStatus::InvalidData);
  BoxActiveSet<double> solver;
  CHECK_FALSE(solver.warm_start(vec(0, 0)));  // no size yet
  REQUIRE(solver.set_hessian(MatrixX<double>::Identity(2, 2)) == QpStatus::Solved);
  CHECK_FALSE(solver.warm_start(VectorX<double>::Zero(3)));
  CHECK_FALSE(solver.warm_start(vec(0, inf)));
  CHECK(solver.warm_start(vec(0, 0)));
}

TEST_CASE("refusals name the reason and the place", "[qp]") {
  BoxActiveSet<double> solver;
  QpResult<double> r;
  CHECK(solver.solve(vec(0, 0), vec(0, 0), vec(1, 1), r) == QpStatus::InvalidData);
  CHECK(std::string(r.message) == "no Hessian was set");
  solver.reserve(2);
  REQUIRE(solver.set_hessian(MatrixX<double>::Identity(2, 2)) == QpStatus::Solved);
  CHECK(solver.solve(vec(0, inf), vec(0, 0), vec(1, 1), r) == QpStatus::InvalidData);
  CHECK(std::string(r.message) == "gradient entry is not finite");
  CHECK(r.invalid_index == 1);
  CHECK(solver.solve(vec(0, 0), vec(2, 0), vec(1, 1), r) == QpStatus::InvalidData);
  CHECK(r.invalid_index == 0);
  CHECK(solver.solve(VectorX<double>::Zero(3), vec(0, 0), vec(1, 1), r) == QpStatus::InvalidData);
  CHECK(r.x.size() == 2);
  CHECK(solver.set_hessian(MatrixX<double>::Zero(2, 3)) == QpStatus::InvalidData);
  CHECK(solver.set_hessian(MatrixX<double>::Zero(0, 0)) == QpStatus::InvalidData);
}

TEST_CASE("a huge slope does not hide unknowns with small slopes from the box solver", "[qp]") {
  // H is diagonal, so each unknown has a minimum of its own.
  const double far_bound = GENERATE(1e3, 1e11, 1e15);
  const double huge = GENERATE(1e8, 1e10, 1e11, 1e12);
  const double unit = GENERATE(1e-3, 1.0, 1e3);  // of the unknowns with small slopes
  const Index n = GENERATE(3, 12);
  const VectorX<double> ub = VectorX<double>::Constant(n, far_bound), lb = -ub;
  MatrixX<double> H = MatrixX<double>::Identity(n, n);
  H.diagonal().tail(n - 1).setConstant(1.0 / (unit * unit));
  BoxActiveSet<double> warm;
  REQUIRE(warm.set_hessian(H) == QpStatus::Solved);
  std::mt19937 random(34);
  for (int frame = 0; frame < 12; ++frame) {
    VectorX<double> g(n);
    for (Index j = 1; j < n; ++j) g[j] = (static_cast<double>(random() % 9u) - 4.0) / unit;
    g[0] = frame < 6 ? -huge : huge;
    INFO("bound " << far_bound << " huge " << huge << " unit " << unit << " frame " << frame);
    BoxActiveSet<double> cold;
    REQUIRE(cold.set_hessian(H) == QpStatus::Solved);
    // What rounding may add to H x + g, by the bound on its terms.
    const double size = std::min(huge, far_bound);
    const double error = 256 * scalar_traits<double>::epsilon() * size * unit;
    for (BoxActiveSet<double>* solver : {&warm, &cold}) {
      QpResult<double> r;
      REQUIRE(solver->solve(g, lb, ub, r) == QpStatus::Solved);
      for (Index j = 1; j < n; ++j) {
        const double wanted = std::clamp(-g[j] * unit * unit, -far_bound, far_bound);
        CHECK(r.x[j] == Approx(wanted).epsilon(1e-8).margin(error));
      }
    }
  }
}

TEST_CASE("bounds that close and open again leave no trace", "[qp]") {
  // Planners switch unknowns off for some frames with ub = lb = 0. The active set must be computed
  // anew each time.
  std::mt19937 random(14);
  KnownQp<double> q = draw_qp<double>({.n = 60, .active = 0.3}, random);
  QpSession<double, BoxActiveSet<double>> warm;
  REQUIRE(warm.set(q) == QpStatus::Solved);
  const VectorX<double> lb = q.lb, ub = q.ub;
  for (int frame = 0; frame < 40; ++frame) {
    for (Index i = 0; i < 60; ++i) {
      const bool closed = random() % 3 == 0;
      q.lb[i] = closed ? std::max(lb[i], -1.0) : lb[i];
      q.ub[i] = closed ? q.lb[i] : ub[i];
    }
    REQUIRE(warm.solve(q) == QpStatus::Solved);
    CHECK(warm.residuals(q).worst() < 1e-9);
    QpSession<double, BoxActiveSet<double>> cold;
    REQUIRE(cold.set(q) == QpStatus::Solved);
    REQUIRE(cold.solve(q) == QpStatus::Solved);
    CHECK(warm.result.objective == Approx(cold.result.objective).epsilon(1e-10));
  }
}

TEST_CASE("the box solver starts from x, from a shifted x, and cold after reset", "[qp]") {
  std::mt19937 random(15);
  // Independent blocks of 10 unknowns, so that the shifted problem has the shifted solution.
  const KnownQp<double> block = draw_qp<double>({.n = 10}, random);
  const Index blocks = 6, n = 10 * blocks;
  KnownQp<double> q;
  q.H = MatrixX<double>::Zero(n, n);
  q.A = MatrixX<double>(0, n);
  q.g.resize(n);
  q.lb.resize(n);
  q.ub.resize(n);
  std::normal_distribution<double> normal;
  for (Index b = 0; b < blocks; ++b) {
    q.H.block(10 * b, 10 * b, 10, 10) = block.H;
    q.lb.segment(10 * b, 10).setConstant(-0.3);
    q.ub.segment(10 * b, 10).setConstant(0.4);
    for (Index i = 0; i < 10; ++i) q.g[10 * b + i] = normal(random);
  }
  QpSession<double, BoxActiveSet<double>> session;
  REQUIRE(session.set(q) == QpStatus::Solved);
  REQUIRE(session.solve(q) == QpStatus::Solved);
  CHECK(session.result.iterations > 0);
  const VectorX<double> x = session.result.x;

  // The meaning of a shift: blocks move up by one, and the last one is repeated.
  KnownQp<double> next = q;
  next.g.head(n - 10) = q.g.tail(n - 10);
  session.solver.shift(10);
  REQUIRE(session.solve(next) == QpStatus::Solved);
  CHECK(session.result.iterations == 0);
  CHECK((session.result.x.head(n - 10) - x.tail(n - 10)).cwiseAbs().maxCoeff() < 1e-12);
  CHECK((session.result.x.tail(10) - x.tail(10)).cwiseAbs().maxCoeff() < 1e-12);

  REQUIRE(session.solver.warm_start(x));
  REQUIRE(session.solve(q) == QpStatus::Solved);
  CHECK(session.result.iterations == 0);
  session.solver.reset();
  REQUIRE(session.solve(q) == QpStatus::Solved);
  CHECK(session.result.iterations > 0);
  CHECK((session.result.x - x).cwiseAbs().maxCoeff() < 1e-12);
}

TEST_CASE(
    "the reserved size is a maximum, and a solve that runs out of iterations returns a feasible "
    "point",
    "[qp]") {
  std::mt19937 random(16);
  BoxActiveSet<double> solver;
  solver.reserve(50);
  for (Index n : {Index(50), Index(20), Index(35)}) {
    const KnownQp<double> q = draw_qp<double>({.n = n}, random);
    const long before = allocations();
    const QpStatus status = solver.set_hessian(q.H);
    const long taken = allocations() - before;
    if (allocation_counting_works()) CHECK(taken == 0);
    REQUIRE(status == QpStatus::Solved);
    QpResult<double> r;
    REQUIRE(solver.solve(q.g, q.lb, q.ub, r) == QpStatus::Solved);
    CHECK(r.objective == Approx(q.objective()).epsilon(1e-9));
  }
  const KnownQp<double> big =
      draw_qp<double>({.n = 80}, random);  // larger than the reserved size: grows
  REQUIRE(solver.set_hessian(big.H) == QpStatus::Solved);
  QpResult<double> r;
  REQUIRE(solver.solve(big.g, big.lb, big.ub, r) == QpStatus::Solved);

  QpSettings<double> settings;
  settings.max_iterations = 1;
  BoxActiveSet<double> hasty(settings);
  hasty.reserve(80);
  REQUIRE(hasty.set_hessian(big.H) == QpStatus::Solved);
  CHECK(hasty.solve(big.g, big.lb, big.ub, r) == QpStatus::IterationLimit);
  CHECK(r.feasibility == 0.0);
  CHECK(r.objective >= big.objective() - 1e-9);
  int solves = 1;  // each call continues where the last one stopped
  while (hasty.solve(big.g, big.lb, big.ub, r) != QpStatus::Solved && solves < 200) ++solves;
  CHECK(solves < 200);
  CHECK(r.objective == Approx(big.objective()).epsilon(1e-9));
}

TEMPLATE_TEST_CASE("predictive-control sequences reach their reference objectives in every frame",
                   "[qp]", float, double) {
  using S = TestType;
  const bool single = sizeof(S) == sizeof(float);
  for (const char* name : {"slide_n080", "slide_n160", "slide_n320", "sched_n160", "grip_n160"}) {
    const std::string path = shared_path("data/qp/synthetic/e_" + std::string(name) + "_0.qpt");
    if (path.empty()) {
      WARN("shared data is missing; sequence " << name << " was not run");
      continue;
    }
    Qpt file;
    REQUIRE(read_qpt(path, file));
    REQUIRE(file.frames.size() == 60);
    KnownQp<S> q;
    q.H = file.H.cast<S>();
    q.A = MatrixX<S>(0, file.n);
    QpSession<S, BoxActiveSet<S>> session;
    REQUIRE(session.set(q) == QpStatus::Solved);
    int iterations = 0;
    for (std::size_t k = 0; k < file.frames.size(); ++k) {
      const QptFrame& frame = file.frames[k];
      q.g = frame.g.cast<S>();
      q.lb = frame.lb.cast<S>();
      q.ub = frame.ub.cast<S>();
      session.solver.shift(file.shift);
      INFO(name << " frame " << k);
      REQUIRE(session.solve(q) == QpStatus::Solved);
      const auto r = session.residuals(q);
      CHECK(static_cast<double>(r.stationarity) < (single ? 1e-3 : 1e-9));
      CHECK(static_cast<double>(r.feasibility) == 0.0);
      CHECK(static_cast<double>(r.relative_complementarity) < (single ? 1e-4 : 1e-9));
      CHECK(static_cast<double>(r.objective) ==
            Approx(frame.objective).epsilon(single ? 1e-4 : 1e-9));
      if (k > 0) iterations += session.result.iterations;
    }
    CHECK(iterations < 59 * 4);  // warm starts need few iterations
  }
}

TEST_CASE("a warm start of the box solver takes an active set, alone or with x", "[qp]") {
  std::mt19937 random(93);
  for (int trial = 0; trial < 40; ++trial) {
    QpFamily family;
    family.n = 3 + trial % 30;
    const KnownQp<double> q = draw_qp<double>(family, random);
    BoxActiveSet<double> first, second;
    QpResult<double> cold, warm;
    REQUIRE(first.set_hessian(q.H) == QpStatus::Solved);
    REQUIRE(second.set_hessian(q.H) == QpStatus::Solved);
    REQUIRE(first.solve(q.g, q.lb, q.ub, cold) == QpStatus::Solved);
    REQUIRE(second.warm_start(cold.bound_sides));
    REQUIRE(second.solve(q.g, q.lb, q.ub, warm) == QpStatus::Solved);
    CHECK(warm.iterations == 0);
    CHECK((warm.x - cold.x).norm() <= 1e-9 * (1.0 + cold.x.norm()));
    second.reset();
    REQUIRE(second.warm_start(cold.x, cold.bound_sides));
    REQUIRE(second.solve(q.g, q.lb, q.ub, warm) == QpStatus::Solved);
    CHECK(warm.iterations == 0);
    std::vector<QpSide> bad(static_cast<std::size_t>(family.n), QpSide::Upper);
    REQUIRE(second.warm_start(bad));  // it names open bounds too
    REQUIRE(second.solve(q.g, q.lb, q.ub, warm) == QpStatus::Solved);
    CHECK(warm.objective == Approx(cold.objective).epsilon(1e-9).margin(1e-9));
    bad[0] = static_cast<QpSide>(-2);
    CHECK_FALSE(second.warm_start(bad));
    CHECK_FALSE(second.warm_start(cold.x, bad));
    bad.pop_back();
    CHECK_FALSE(second.warm_start(bad));
  }
}

TEST_CASE("a large move of one unknown does not cause rounding errors in other gradients", "[qp]") {
  MatrixX<double> H = MatrixX<double>::Identity(4, 4);
  for (Index j = 1; j < 4; ++j) H(0, j) = H(j, 0) = 0.3;
  VectorX<double> g(4), lb(4), ub(4);
  g << -1e17, 0.5, 0.5, 0.5;
  lb << -1e19, -1.0, -1.0, -1.0;
  ub << 1e19, 10.0, 10.0, 10.0;
  BoxActiveSet<double> solver;
  QpResult<double> result;
  REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
  REQUIRE(solver.solve(g, lb, ub, result) == QpStatus::Solved);
  g[0] = lb[0] = ub[0] = 0.0;
  REQUIRE(solver.solve(g, lb, ub, result) == QpStatus::Solved);
  for (Index j = 1; j < 4; ++j) CHECK(result.x[j] == Approx(-0.5));
}

TEST_CASE("a negative number of unknowns is refused with a message and changes nothing", "[qp]") {
  BoxActiveSet<double> solver;
  REQUIRE(solver.set_hessian(MatrixX<double>::Identity(2, 2)) == QpStatus::Solved);
  CHECK(solver.reserve(-1) == QpStatus::InvalidData);
  CHECK(std::string(solver.refusal().message) == "reserved number of unknowns is negative");
  QpResult<double> result;
  const VectorX<double> g = VectorX<double>::Ones(2), high = VectorX<double>::Constant(2, 5.0);
  CHECK(solver.solve(g, -high, high, result) == QpStatus::Solved);
  CHECK(result.x[1] == Approx(-1.0));
}
