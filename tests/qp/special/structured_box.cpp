// Substitution of rows that define unknowns. The answers must be those of the whole problem while
// the structure changes.

#include "clothctl/qp/detail/special/structured_box.hpp"

#include <random>

#include "clothctl/qp/active_set.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// Steps of two forces w and five coefficients d each, interleaved: w_k - Σ_{j<=k} M_{k-j} d_j =
/// b_k with 0 <= d <= 1.
template <class S>
struct Contacts {
  Index n, m;
  MatrixX<S> H, A;
  VectorX<S> g, lb, ub, b;
  std::mt19937 random{7};

  explicit Contacts(Index steps) : n(7 * steps), m(2 * steps) {
    std::normal_distribution<double> normal;
    const auto draw = [&] { return S(normal(random)); };
    H.setZero(n, n);
    A.setZero(m, n);
    g.setZero(n);
    b.setZero(m);
    lb.setZero(n);
    ub.setConstant(n, S(1));
    MatrixX<S> root(m, m), lag(2, 5);
    for (Index i = 0; i < root.size(); ++i) root(i) = draw();
    for (Index i = 0; i < lag.size(); ++i) lag(i) = draw();
    const MatrixX<S> Q = root * root.transpose();
    for (Index k = 0; k < steps; ++k) {
      for (Index c = 0; c < 2; ++c) {
        const Index w = 7 * k + c, row = 2 * k + c;
        A(row, w) = S(2);
        lb[w] = -scalar_traits<S>::infinity();
        ub[w] = scalar_traits<S>::infinity();
        for (Index l = 0; l < steps; ++l) {
          for (Index e = 0; e < 2; ++e) H(w, 7 * l + e) = Q(row, 2 * l + e);
        }
        for (Index j = 0; j <= k; ++j) {
          for (Index i = 0; i < 5; ++i)
            A(row, 7 * j + 2 + i) = -lag(c, i) * S(std::pow(0.8, double(k - j)));
        }
      }
      for (Index i = 0; i < 5; ++i) H(7 * k + 2 + i, 7 * k + 2 + i) = S(0.5);
    }
    change();
  }
  /// Draws the data of another frame.
  void change() {
    std::normal_distribution<double> normal;
    for (Index i = 0; i < n; ++i) g[i] += S(2 * normal(random));
    for (Index i = 0; i < m; ++i) b[i] += S(0.2 * normal(random));
  }
};

template <class S>
KktResiduals<S> judged(const Contacts<S>& p, const QpResult<S>& r) {
  return kkt_residuals(p.H, p.g, p.A, p.b, p.b, p.lb, p.ub, r.x, r.row_multipliers,
                       r.bound_multipliers);
}

template <class S>
QpStatus solve(ActiveSet<S>& solver, const Contacts<S>& p, QpResult<S>& result) {
  return solver.solve(p.g, p.lb, p.ub, p.b, p.b, result);
}

/// Whether the structured method accepts the problem.
bool structured(const Contacts<double>& p) {
  detail::ProblemData<double> data;
  data.reserve(p.n, p.m);
  REQUIRE(data.validate_hessian(p.H) == QpStatus::Solved);
  data.take(p.H);
  REQUIRE(data.validate_rows(p.A) == QpStatus::Solved);
  data.take_rows(p.A);
  QpResult<double> result;
  REQUIRE(data.load("", p.g, p.lb, p.ub, p.b, p.b, result));
  detail::StructuredBox<double> box;
  box.reserve(p.n, p.m);
  return box.ready(data);
}

}  // namespace

TEMPLATE_TEST_CASE(
    "structured problems end at points that satisfy the optimality conditions of the whole problem",
    "[qp][structured_box]", float, double) {
  using S = TestType;
  for (const Index steps : {1, 4, 12}) {
    Contacts<S> p(steps);
    ActiveSet<S> solver;
    solver.reserve(p.n, p.m);
    REQUIRE(solver.set_hessian(p.H) == QpStatus::Solved);
    REQUIRE(solver.set_rows(p.A) == QpStatus::Solved);
    QpResult<S> result, again;
    result.resize(p.n, p.m);
    again.resize(p.n, p.m);
    for (int frame = 0; frame < 8; ++frame) {
      p.change();
      if (frame % 2 == 1) solver.shift(7, 2);
      const long before = clothctl_test::allocations();
      const QpStatus status = solve(solver, p, result), repeated = solve(solver, p, again);
      const long made = clothctl_test::allocations() - before;
      CHECK(status == QpStatus::Solved);
      CHECK(repeated == QpStatus::Solved);
      CHECK(again.iterations == 0);
      if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
      const KktResiduals<S> r = judged(p, result);
      const S most = QpSettings<S>::default_tolerance();
      CHECK(r.relative_stationarity <= most);
      CHECK(r.relative_feasibility <= most);
      CHECK(r.relative_complementarity <= most);
      // The reported residuals agree with an independent check.
      CHECK(result.objective == Approx(r.objective).epsilon(1e-4));
      CHECK(result.feasibility == Approx(r.relative_feasibility).margin(1e-6));
    }
  }
}

TEST_CASE("the structured answer agrees with the general method", "[qp][structured_box]") {
  Contacts<double> p(10);
  ActiveSet<double> structured_solver, general;
  REQUIRE(structured(p));
  Contacts<double> loose = p;  // far bounds on w make the same problem general
  for (Index i = 0; i < p.n; ++i) {
    loose.lb[i] = std::max(loose.lb[i], -1e6);
    loose.ub[i] = std::min(loose.ub[i], 1e6);
  }
  REQUIRE_FALSE(structured(loose));
  QpResult<double> a, c;
  for (ActiveSet<double>* s : {&structured_solver, &general}) {
    REQUIRE(s->set_hessian(p.H) == QpStatus::Solved);
    REQUIRE(s->set_rows(p.A) == QpStatus::Solved);
  }
  REQUIRE(solve(structured_solver, p, a) == QpStatus::Solved);
  REQUIRE(solve(general, loose, c) == QpStatus::Solved);
  CHECK((a.x - c.x).cwiseAbs().maxCoeff() < 1e-6);
  CHECK((a.row_multipliers - c.row_multipliers).cwiseAbs().maxCoeff() < 1e-5);
  CHECK(a.objective == Approx(c.objective).epsilon(1e-9));
}

TEST_CASE("bounds on defined unknowns, and inequality rows, may change from frame to frame",
          "[qp][structured_box]") {
  Contacts<double> p(6);
  ActiveSet<double> solver;
  REQUIRE(solver.set_hessian(p.H) == QpStatus::Solved);
  REQUIRE(solver.set_rows(p.A) == QpStatus::Solved);
  QpResult<double> result;
  const double open = p.ub[7];
  for (int frame = 0; frame < 9; ++frame) {
    p.change();
    VectorX<double> upper = p.b;
    p.ub[7] = frame % 3 == 1 ? 0.1 : open;
    if (frame % 3 == 2) upper[4] += 0.5;
    REQUIRE(solver.solve(p.g, p.lb, p.ub, p.b, upper, result) == QpStatus::Solved);
    const KktResiduals<double> r = kkt_residuals(p.H, p.g, p.A, p.b, upper, p.lb, p.ub, result.x,
                                                 result.row_multipliers, result.bound_multipliers);
    CHECK(r.relative_stationarity < 1e-8);
    CHECK(r.relative_feasibility < 1e-8);
    CHECK(r.relative_complementarity < 1e-8);
  }
}

TEST_CASE("problems that only resemble the structure go to the general method",
          "[qp][structured_box]") {
  const Contacts<double> good(4);
  REQUIRE(structured(good));
  const auto refused = [&](auto change) {
    Contacts<double> p = good;
    change(p);
    return !structured(p);
  };
  CHECK(refused([](Contacts<double>& p) { p.H(0, 3) = p.H(3, 0) = 0.01; }));  // w and d are coupled
  CHECK(refused([](Contacts<double>& p) { p.H(3, 4) = p.H(4, 3) = 0.01; }));  // d among themselves
  CHECK(refused([](Contacts<double>& p) { p.H(3, 3) = 0.0; }));               // a flat d
  CHECK(refused([](Contacts<double>& p) { p.H(3, 3) = 1e-12; }));  // too flat for Woodbury
  CHECK(refused([](Contacts<double>& p) { p.A(1, 0) = 0.5; }));    // w_0 is in two rows
  CHECK(refused([](Contacts<double>& p) { p.lb[0] = 0.0; }));      // w_0 has a bound
  CHECK(refused([](Contacts<double>& p) { p.A(0, 0) = 0.0; }));    // row 0 defines nothing
}

TEST_CASE("iteration limits end structured solves within the bounds and on the rows",
          "[qp][structured_box]") {
  Contacts<double> p(12);
  QpSettings<double> settings;
  settings.max_iterations = 1;
  ActiveSet<double> solver(settings);
  REQUIRE(solver.set_hessian(p.H) == QpStatus::Solved);
  REQUIRE(solver.set_rows(p.A) == QpStatus::Solved);
  QpResult<double> result;
  const QpStatus status = solve(solver, p, result);
  CHECK((status == QpStatus::IterationLimit || status == QpStatus::SolvedInaccurate));
  CHECK(result.iterations == 1);
  CHECK(result.feasibility < 1e-12);
}

TEST_CASE("with small iteration limits, repeated structured solves make progress",
          "[qp][structured_box]") {
  for (const int budget : {1, 2, 3, 4, 7}) {
    Contacts<double> p(12);
    QpSettings<double> settings;
    settings.max_iterations = budget;
    ActiveSet<double> solver(settings), free_of_budget;
    QpResult<double> result, expected;
    for (ActiveSet<double>* s : {&solver, &free_of_budget}) {
      REQUIRE(s->set_hessian(p.H) == QpStatus::Solved);
      REQUIRE(s->set_rows(p.A) == QpStatus::Solved);
    }
    for (int frame = 0; frame < 5; ++frame) {
      p.change();
      REQUIRE(solve(free_of_budget, p, expected) == QpStatus::Solved);
      QpStatus status = QpStatus::IterationLimit;
      for (int k = 0; k < 300 && status != QpStatus::Solved; ++k) {
        status = solve(solver, p, result);
        CHECK(result.iterations <= budget);
      }
      CHECK(status == QpStatus::Solved);
      CHECK(result.objective == Approx(expected.objective));
    }
  }
}

TEST_CASE("an answer that fails the check of residuals is refined, not discarded",
          "[qp][structured_box]") {
  Contacts<double> p(12);
  QpSettings<double> sharp;
  sharp.stationarity_tolerance =
      1e-15;  // about the rounding of the sums: often missed, never by much
  ActiveSet<double> solver(sharp), plain;
  QpResult<double> result, expected;
  for (ActiveSet<double>* s : {&solver, &plain}) {
    REQUIRE(s->set_hessian(p.H) == QpStatus::Solved);
    REQUIRE(s->set_rows(p.A) == QpStatus::Solved);
  }
  for (int frame = 0; frame < 20; ++frame) {
    p.change();
    REQUIRE(solve(plain, p, expected) == QpStatus::Solved);
    const QpStatus status = solve(solver, p, result);
    CHECK((status == QpStatus::Solved || status == QpStatus::SolvedInaccurate));
    CHECK(result.stationarity < 1e-13);
    CHECK((result.x - expected.x).norm() < 1e-9 * expected.x.norm());
  }
}
