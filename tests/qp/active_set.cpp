#include "clothctl/qp/active_set.hpp"

#include "clothctl/qp/certificate.hpp"

#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <vector>

#include "laws/qp_solver_laws.hpp"
#include "support/catch.hpp"
#include "support/qpt.hpp"
#include "support/shared_data.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

static_assert(QpSolver<ActiveSet<float>, float> && QpSolver<ActiveSet<double>, double>);
static_assert(clothctl_test::WarmStartable<ActiveSet<float>, float> &&
              clothctl_test::WarmStartable<ActiveSet<double>, double>);
static_assert(!BoxQpSolver<ActiveSet<double>>);

namespace {

template <class S>
double tolerance() {
  return sizeof(S) == sizeof(float) ? 5e-4 : 1e-7;
}

const double inf = std::numeric_limits<double>::infinity();

VectorX<double> vec(double a, double b) { return (VectorX<double>(2) << a, b).finished(); }
VectorX<double> vec(double a) { return VectorX<double>::Constant(1, a); }

// Gradient and bounds of a file or of one of its frames.
template <class S, class Source>
void set_vectors(KnownQp<S>& q, const Source& from) {
  q.g = from.g.template cast<S>();
  q.lb = from.lb.template cast<S>();
  q.ub = from.ub.template cast<S>();
  q.rl = from.rl.template cast<S>();
  q.ru = from.ru.template cast<S>();
}

template <class S>
KnownQp<S> from_file(const Qpt& file) {
  KnownQp<S> q;
  q.H = file.H.cast<S>();
  q.A = file.A.cast<S>();
  set_vectors(q, file);
  return q;
}

bool any(const std::string&) { return true; }

// Calls `visit` with the problems of a shared folder whose names `wanted` accepts. If the folder is
// missing, warns and returns false.
template <class Wanted, class Visit>
bool for_each_problem(const std::string& folder, const Wanted& wanted, const Visit& visit) {
  const std::string path = shared_path("data/qp/" + folder);
  if (path.empty()) {
    WARN("shared data is missing; " << folder << " was not run");
    return false;
  }
  for (const auto& entry : std::filesystem::directory_iterator(path)) {
    const std::string name = entry.path().stem().string();
    if (entry.path().extension() != ".qpt" || !wanted(name)) continue;
    Qpt file;
    REQUIRE(read_qpt(entry.path().string(), file));
    INFO(name);
    visit(name, file);
  }
  return true;
}

// The synthetic problems without frames; the slowest one only in the full tier.
template <class Wanted, class Visit>
bool for_each_synthetic(const Wanted& wanted, const Visit& visit) {
  const auto single = [&](const std::string& name) {
    return name[0] != 'e' && (name != "a_degenerate_n300_0" || full_tier()) && wanted(name);
  };
  return for_each_problem("synthetic", single, visit);
}

template <class S>
void set(ActiveSet<S>& solver, const KnownQp<S>& q) {
  REQUIRE(solver.set_hessian(q.H) == QpStatus::Solved);
  REQUIRE(solver.set_rows(q.A) == QpStatus::Solved);
}

template <class S>
QpStatus solve(ActiveSet<S>& solver, const KnownQp<S>& q, QpResult<S>& r) {
  return solver.solve(q.g, q.lb, q.ub, q.rl, q.ru, r);
}

template <class S>
void check_within_bounds(const KnownQp<S>& q, const VectorX<S>& x) {
  for (Index i = 0; i < x.size(); ++i) {
    CHECK(x[i] >= q.lb[i]);
    CHECK(x[i] <= q.ub[i]);
  }
}

// Aᵀy + z = 0, and the support function of the bounds is negative.
void check_farkas(const KnownQp<double>& q, const QpResult<double>& r) {
  const VectorX<double>&y = r.row_multipliers, &z = r.bound_multipliers;
  const VectorX<double> terms = q.A.cwiseAbs().transpose() * y.cwiseAbs();
  CHECK((q.A.transpose() * y + z).cwiseAbs().maxCoeff() <= 1e-10 * (1e-300 + terms.maxCoeff()));
  double support = 0.0;
  const auto add = [&support](double v, double lower, double upper) {
    if (v != 0.0) support += v * (v > 0.0 ? upper : lower);
  };
  for (Index i = 0; i < y.size(); ++i) add(y[i], q.rl[i], q.ru[i]);
  for (Index j = 0; j < z.size(); ++j) add(z[j], q.lb[j], q.ub[j]);
  CHECK(support < 0.0);
  CHECK(farkas_residuals(q.A, q.rl, q.ru, q.lb, q.ub, y, z).holds());
}

// H d = 0, gᵀd < 0, and moving along d reaches no finite bound or row.
void check_ray(const KnownQp<double>& q, const VectorX<double>& d) {
  const double size = d.cwiseAbs().maxCoeff();
  REQUIRE(size > 0.0);
  CHECK(q.g.dot(d) < 0.0);
  CHECK((q.H * d).cwiseAbs().maxCoeff() <= 1e-9 * size * (1.0 + q.H.cwiseAbs().maxCoeff()));
  CHECK(ray_residuals(q.H, q.g, q.A, q.rl, q.ru, q.lb, q.ub, d).holds());
  const VectorX<double> Ad = q.A * d;
  for (Index j = 0; j < d.size(); ++j) {
    if (q.lb[j] > -inf) CHECK(d[j] >= 0.0);
    if (q.ub[j] < inf) CHECK(d[j] <= 0.0);
  }
  for (Index i = 0; i < Ad.size(); ++i) {
    if (q.rl[i] > -inf) CHECK(Ad[i] >= -1e-9 * size * q.A.row(i).cwiseAbs().sum());
    if (q.ru[i] < inf) CHECK(Ad[i] <= 1e-9 * size * q.A.row(i).cwiseAbs().sum());
  }
}

}  // namespace

TEMPLATE_TEST_CASE("random problems of every kind are solved", "[qp]", float, double) {
  using S = TestType;
  const bool single = sizeof(S) == sizeof(float);
  std::mt19937 random(21);
  int inaccurate = 0;
  const int count = trials(200, 20000);
  for (int trial = 0; trial < count; ++trial) {
    QpFamily family;
    family.n = 1 + trial % 40;
    family.m = trial % 7 == 0 ? 0 : (trial * 5) % 45;
    family.active = 0.1 * (trial % 9);
    family.degenerate = trial % 3 == 0 ? 0.5 : 0.0;
    family.rank = trial % 4 == 1 ? 0.5 : trial % 4 == 2 ? 0.0 : 1.0;
    family.equalities = trial % 5 == 0 ? 0.5 : 0.1;
    family.copies = trial % 2 == 0 ? 0.4 : 0.0;
    family.spread = trial % 6 == 2 ? (single ? 1 : 7) : 0;
    const KnownQp<S> q = draw_qp<S>(family, random);
    QpSession<S, ActiveSet<S>> session;
    REQUIRE(session.set(q) == QpStatus::Solved);
    INFO("trial " << trial << " n " << family.n << " m " << family.m);
    const std::string broken = qp_law_solved(session, q, tolerance<S>());
    if (single && session.result.status == QpStatus::SolvedInaccurate) {
      ++inaccurate;  // reports reduced accuracy, and keeps what that status promises
      const auto r = session.residuals(q);
      CHECK(static_cast<double>(r.worst()) <=
            2000.0 * static_cast<double>(QpSettings<S>::default_tolerance()));
      CHECK(static_cast<double>(session.result.feasibility) <=
            1000.0 * static_cast<double>(QpSettings<S>::default_tolerance()));
      check_within_bounds(q, session.result.x);
    } else {
      CHECK(broken == "");
    }
  }
  CHECK(inaccurate <= count / 50);
}

TEMPLATE_TEST_CASE("the general solver obeys the laws of history and recovery", "[qp]", float,
                   double) {
  using S = TestType;
  std::mt19937 random(22);
  for (Index n : {Index(2), Index(9), Index(40)}) {
    for (double rank : {1.0, 0.5}) {
      QpFamily family;
      family.n = n;
      family.m = n / 2 + 1;
      family.rank = rank;
      const KnownQp<S> q = draw_qp<S>(family, random);
      CHECK(qp_law_history<S, ActiveSet<S>>(q, tolerance<S>()) == "");
      CHECK(qp_law_recovery<S, ActiveSet<S>>(q, tolerance<S>()) == "");
    }
  }
}

TEST_CASE("the synthetic problems end with the expected status, certificate and objective",
          "[qp]") {
  int seen = 0;
  const bool present = for_each_synthetic(any, [&](const std::string& name, const Qpt& file) {
    const KnownQp<double> q = from_file<double>(file);
    QpSession<double, ActiveSet<double>> session;
    REQUIRE(session.set(q) == QpStatus::Solved);
    const QpStatus status = session.solve(q);
    ++seen;
    if (name.find("crossed") != std::string::npos) {
      CHECK(status == QpStatus::InvalidData);
      CHECK(session.result.invalid_index >= 0);
    } else if (file.status == "infeasible") {
      CHECK(status == QpStatus::PrimalInfeasible);
      check_farkas(q, session.result);
    } else if (file.status == "unbounded") {
      CHECK(status == QpStatus::DualInfeasible);
      check_ray(q, session.result.ray);
    } else {
      CHECK(status == QpStatus::Solved);
      const auto r = session.residuals(q);
      CHECK(r.worst() < 1e-8);
      CHECK(std::abs(r.objective + file.r - file.objective) <=
            1e-7 * std::max(1.0, std::abs(file.objective)));
      session.solve(q);
      CHECK(session.result.iterations == 0);
    }
  });
  if (present) CHECK(seen >= 96);
}

TEST_CASE("in single precision the synthetic problems end as expected where float can decide it",
          "[qp]") {
  int seen = 0;
  const auto clear = [](const std::string& name) {  // no contradictions below the tolerance
    return name.find("crossed") == std::string::npos && name.find("comb1e-4") == std::string::npos;
  };
  const bool present = for_each_synthetic(clear, [&](const std::string&, const Qpt& file) {
    const KnownQp<float> q = from_file<float>(file);
    QpSession<float, ActiveSet<float>> session;
    REQUIRE(session.set(q) == QpStatus::Solved);
    const QpStatus status = session.solve(q);
    ++seen;
    if (file.status == "infeasible") {
      CHECK(status == QpStatus::PrimalInfeasible);
    } else if (file.status == "unbounded") {
      CHECK(status == QpStatus::DualInfeasible);
    } else {
      CHECK(status == QpStatus::Solved);
      // Relative to the summed terms: with badly scaled columns they far exceed the objective.
      const VectorX<double> x = session.result.x.cast<double>();
      const double size = file.g.cwiseAbs().dot(x.cwiseAbs()) +
                          0.5 * x.cwiseAbs().dot(file.H.cwiseAbs() * x.cwiseAbs());
      CHECK(std::abs(x.dot(0.5 * (file.H * x) + file.g) + file.r - file.objective) <=
            1e-4 * std::max(1.0, size));
    }
  });
  if (present) CHECK(seen >= 90);
}

TEST_CASE("the public test problems are solved; the quick tier takes the small ones", "[qp]") {
  int seen = 0;
  const bool present =
      for_each_problem("maros_meszaros", any, [&](const std::string&, const Qpt& file) {
        if (file.n > 300 && !full_tier()) return;
        const KnownQp<double> q = from_file<double>(file);
        QpSession<double, ActiveSet<double>> session;
        REQUIRE(session.set(q) == QpStatus::Solved);
        ++seen;
        CHECK(session.solve(q) == QpStatus::Solved);
        CHECK(session.residuals(q).worst() < 1e-8);
        const double value = session.result.objective + file.r;
        CHECK(std::abs(value - file.objective) <=
              1e-6 * std::max(1.0, std::max(std::abs(file.objective), std::abs(file.r))));
      });
  if (present) CHECK(seen >= (full_tier() ? 36 : 20));
}

TEST_CASE("sequences with equality rows reach their reference objectives", "[qp]") {
  for (const char* name : {"e_eqpatch_n125_0", "e_eqslide_n500_0"}) {
    const std::string path = shared_path("data/qp/synthetic/" + std::string(name) + ".qpt");
    if (path.empty()) {
      WARN("shared data is missing; " << name << " was not run");
      continue;
    }
    Qpt file;
    REQUIRE(read_qpt(path, file));
    KnownQp<double> q = from_file<double>(file);
    QpSession<double, ActiveSet<double>> session;
    REQUIRE(session.set(q) == QpStatus::Solved);
    for (std::size_t k = 0; k < file.frames.size(); ++k) {
      const QptFrame& frame = file.frames[k];
      set_vectors(q, frame);
      session.solver.shift(file.shift, file.shift * file.m / file.n);
      INFO(name << " frame " << k);
      REQUIRE(session.solve(q) == QpStatus::Solved);
      CHECK(session.residuals(q).worst() < 1e-8);
      CHECK(session.result.objective == Approx(frame.objective).epsilon(1e-7).margin(1e-10));
    }
  }
}

TEST_CASE("infeasibility and unboundedness in two dimensions are reported with certificates",
          "[qp]") {
  KnownQp<double> q;
  q.H = MatrixX<double>::Identity(2, 2);
  q.A = MatrixX<double>::Ones(1, 2);
  q.g = vec(0.0, 0.0);
  q.lb = vec(0.0, 0.0);
  q.ub = vec(1.0, 1.0);
  q.rl = vec(2.0 + 1e-4);
  q.ru = vec(inf);
  QpSession<double, ActiveSet<double>> session;
  REQUIRE(session.set(q) == QpStatus::Solved);
  REQUIRE(session.solve(q) == QpStatus::PrimalInfeasible);
  check_farkas(q, session.result);
  q.rl = vec(2.0);  // one feasible point
  REQUIRE(session.solve(q) == QpStatus::Solved);
  CHECK((session.result.x - vec(1.0, 1.0)).cwiseAbs().maxCoeff() < 1e-8);
  q.rl = vec(2.0 - 1e-4);
  REQUIRE(session.solve(q) == QpStatus::Solved);

  q.H.setZero();
  q.ub = vec(inf, inf);
  q.g = vec(-1.0, 0.5);
  q.rl = vec(-inf);
  q.ru = vec(4.0);
  REQUIRE(session.set(q) == QpStatus::Solved);
  REQUIRE(session.solve(q) == QpStatus::Solved);
  CHECK(session.result.objective == Approx(-4.0));
  q.ru = vec(inf);
  REQUIRE(session.solve(q) == QpStatus::DualInfeasible);
  check_ray(q, session.result.ray);
  q.ru = vec(7.0);
  REQUIRE(session.solve(q) == QpStatus::Solved);
  CHECK(session.result.objective == Approx(-7.0));
}

TEST_CASE("a huge slope or a kept multiplier does not hide unknowns with small slopes", "[qp]") {
  // Unknown 0 has a row and a bound that meet, so its multiplier may have any size. The others have
  // slopes of their own, and go to the bound that these point at.
  const double edge = GENERATE(0.0, 5.0);
  const double unit = GENERATE(1e-10, 1e-5, 1.0, 1e5, 1e12);
  const Index others = GENERATE(1, 2, 7);
  KnownQp<double> q;
  const Index n = others + 1;
  q.H = MatrixX<double>::Zero(n, n);
  q.A = MatrixX<double>::Identity(1, n);
  q.rl = vec(edge);
  q.ru = vec(inf);
  q.lb = VectorX<double>::Constant(n, -10.0);
  q.ub = VectorX<double>::Constant(n, 10.0);
  q.ub[0] = edge;
  ActiveSet<double> warm;
  set(warm, q);
  std::mt19937 random(33);
  for (int frame = 0; frame < 12; ++frame) {
    q.g = VectorX<double>::Constant(n, unit);
    for (Index j = 1; j < n; ++j) q.g[j] *= random() % 2u == 0 ? 1.0 : -1.0;
    q.g[0] = unit * (frame % 3 == 1 ? 1e10 : frame % 3 == 2 ? -1e10 : 1.0);
    INFO("edge " << edge << " unit " << unit << " n " << n << " frame " << frame);
    ActiveSet<double> cold;
    set(cold, q);
    for (ActiveSet<double>* solver : {&warm, &cold}) {
      QpResult<double> r;
      REQUIRE(solve(*solver, q, r) == QpStatus::Solved);
      CHECK(r.x[0] == Approx(edge).margin(1e-8));
      // A slope below the tolerance counts as zero only where there is no larger one beside it.
      const bool counts = q.g.cwiseAbs().maxCoeff() > 1e-8;
      for (Index j = 1; j < n && counts; ++j) CHECK(r.x[j] == (q.g[j] > 0.0 ? -10.0 : 10.0));
    }
  }
}

TEST_CASE("a huge unknown or objective of the last frame does not hide rows and multipliers",
          "[qp]") {
  KnownQp<double> q;
  q.H = MatrixX<double>::Zero(2, 2);
  q.A = MatrixX<double>::Identity(1, 2);  // the row is unknown 0 alone
  q.lb = vec(-100.0, -1e12);
  q.ub = vec(100.0, 1e12);
  q.rl = vec(3.0);
  q.ru = vec(inf);
  q.g = vec(1.0, -1.0);
  ActiveSet<double> solver;
  set(solver, q);
  QpResult<double> r;
  REQUIRE(solver.warm_start(vec(3.0, 1e12)));
  REQUIRE(solve(solver, q, r) == QpStatus::Solved);
  CHECK(r.x[0] == Approx(3.0));
  CHECK(r.x[1] == 1e12);
  q.g[1] = 0.0;  // every value of unknown 1 is a minimum
  for (const double edge : {5.0, -7.0, 0.0, 1e-3}) {
    q.rl[0] = edge;
    REQUIRE(solve(solver, q, r) == QpStatus::Solved);
    CHECK(r.x[0] == Approx(edge).margin(1e-9));
  }
  q.g[1] = -1.0;  // the objective is -1e12
  for (const double edge : {5.0, -7.0, 0.0, 1e-3}) {
    q.rl[0] = edge;
    REQUIRE(solve(solver, q, r) == QpStatus::Solved);
    CHECK(r.x[0] == Approx(edge).margin(1e-9));
  }
}

TEST_CASE("a cold start takes fewer rounds than there are rows and unknowns to decide", "[qp]") {
  // With a stiff first penalty, the line search stops at nearly every row.
  std::mt19937 random(35);
  int rounds = 0, sets = 0;
  for (int trial = 0; trial < 10; ++trial) {
    QpFamily family;
    family.n = family.m = 40;
    family.active = 0.1;
    family.equalities = 0.0;
    const KnownQp<double> q = draw_qp<double>(family, random);
    QpSession<double, ActiveSet<double>> session;
    REQUIRE(session.set(q) == QpStatus::Solved);
    CHECK(qp_law_solved(session, q, 1e-8) == "");
    rounds += session.result.iterations;
    sets += 40 + 40;
  }
  CHECK(5 * rounds < 2 * sets);
}

TEST_CASE("active inequality rows have multipliers and inactive ones have none", "[qp]") {
  // min ½|x|² - 3 x0 over x0 + x1 ≤ 1, x0 - x1 ≤ 10: x = (2, -1), y = (-1, 0).
  KnownQp<double> q;
  q.H = MatrixX<double>::Identity(2, 2);
  q.A.resize(2, 2);
  q.A << 1.0, 1.0, 1.0, -1.0;
  q.g = vec(-3.0, 0.0);
  q.lb = vec(-inf, -inf);
  q.ub = vec(inf, inf);
  q.rl = vec(-inf, -inf);
  q.ru = vec(1.0, 10.0);
  QpSession<double, ActiveSet<double>> session;
  REQUIRE(session.set(q) == QpStatus::Solved);
  REQUIRE(session.solve(q) == QpStatus::Solved);
  CHECK((session.result.x - vec(2.0, -1.0)).cwiseAbs().maxCoeff() < 1e-9);
  CHECK(session.result.row_multipliers[0] == Approx(-1.0));
  CHECK(session.result.row_multipliers[1] == 0.0);
  CHECK(session.result.bound_multipliers == vec(0.0, 0.0));
}

TEST_CASE("indefinite Hessians and bad rows are refused with a message", "[qp]") {
  ActiveSet<double> solver;
  solver.reserve(2, 1);
  QpResult<double> r;
  const MatrixX<double> I = MatrixX<double>::Identity(2, 2);
  REQUIRE(solver.set_hessian(I) == QpStatus::Solved);
  MatrixX<double> A = MatrixX<double>::Ones(1, 2);
  A(0, 1) = std::numeric_limits<double>::quiet_NaN();
  CHECK(solver.set_rows(A) == QpStatus::InvalidData);
  CHECK(std::string(solver.refusal().message) == "row entry is not finite");
  CHECK(solver.refusal().index == 1);
  CHECK(solver.solve(vec(0, 0), vec(0, 0), vec(1, 1), vec(0), vec(1), r) ==
        QpStatus::InvalidData);  // there are no rows
  CHECK(solver.solve(vec(-1, 0), vec(0, 0), vec(1, 1), VectorX<double>(0), VectorX<double>(0), r) ==
        QpStatus::Solved);
  CHECK(solver.set_rows(MatrixX<double>::Ones(1, 3)) == QpStatus::InvalidData);
  REQUIRE(solver.set_rows(MatrixX<double>::Ones(1, 2)) == QpStatus::Solved);
  CHECK(solver.solve(vec(0, 0), vec(0, 0), vec(1, 1), vec(2), vec(1), r) == QpStatus::InvalidData);
  CHECK(r.invalid_index == 0);
  CHECK(solver.solve(vec(0, 0), vec(0, 0), vec(1, 1), vec(1, 1), vec(1, 1), r) ==
        QpStatus::InvalidData);
  REQUIRE(solver.solve(vec(0, 0), vec(0, 0), vec(1, 1), vec(1), vec(1), r) == QpStatus::Solved);
  CHECK(r.x[0] == Approx(0.5));
  MatrixX<double> H = I;
  H(0, 1) = H(1, 0) = 2.0;
  CHECK(solver.set_hessian(H) == QpStatus::NonConvex);
  CHECK(solver.refusal().index == 1);
  REQUIRE(solver.solve(vec(0, 0), vec(0, 0), vec(1, 1), vec(1), vec(1), r) ==
          QpStatus::Solved);  // with the old H
  CHECK(r.x[0] == Approx(0.5));
  CHECK(r.iterations == 0);
}

TEST_CASE("a negative eigenvalue that no 2×2 minor shows is found on the free set", "[qp]") {
  MatrixX<double> H = MatrixX<double>::Constant(3, 3, -0.9);
  H.diagonal().setOnes();  // eigenvalue -0.8 along (1, 1, 1)
  ActiveSet<double> solver;
  REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
  QpResult<double> r;
  const VectorX<double> g = VectorX<double>::Constant(3, -1.0),
                        ub = VectorX<double>::Constant(3, 5.0), none(0);
  CHECK(solver.solve(g, -ub, ub, none, none, r) == QpStatus::NonConvex);
  for (Index i = 0; i < 3; ++i) CHECK(std::abs(r.x[i]) <= 5.0);
}

TEST_CASE("without a Hessian, or with bad settings, the solver refuses", "[qp]") {
  ActiveSet<double> solver;
  QpResult<double> r;
  const VectorX<double> none(0);
  CHECK(solver.solve(none, none, none, none, none, r) == QpStatus::InvalidData);
  CHECK(std::string(r.message) == "no Hessian was set");
  CHECK(solver.set_hessian(-MatrixX<double>::Identity(2, 2)) == QpStatus::NonConvex);
  CHECK(solver.set_rows(MatrixX<double>(0, 2)) == QpStatus::Solved);
  CHECK(solver.solve(vec(0, 0), vec(0, 0), vec(1, 1), none, none, r) == QpStatus::NonConvex);
  CHECK(r.invalid_index == 0);
  QpSettings<double> settings;
  settings.feasibility_tolerance = 0.0;  // must not make an infeasible point pass
  ActiveSet<double> careless(settings);
  REQUIRE(careless.set_hessian(MatrixX<double>::Zero(1, 1)) == QpStatus::Solved);
  REQUIRE(careless.set_rows(MatrixX<double>::Ones(1, 1)) == QpStatus::Solved);
  CHECK(careless.solve(vec(0.0), vec(-inf), vec(inf), vec(1.0), vec(inf), r) ==
        QpStatus::InvalidData);
  CHECK(std::string(r.message) == "feasibility_tolerance is not a positive number");
}

namespace {

// A small dense problem, written in doubles and solved in S.
template <class S>
struct Tiny {
  ActiveSet<S> solver;
  QpResult<S> result;
  MatrixX<S> H, A;
  VectorX<S> g, lb, ub, rl, ru;

  static VectorX<S> list(std::initializer_list<double> values) {
    VectorX<S> v(static_cast<Index>(values.size()));
    Index i = 0;
    for (double value : values) v[i++] = static_cast<S>(value);
    return v;
  }
  static MatrixX<S> table(Index rows, Index cols, std::initializer_list<double> values) {
    const VectorX<S> v = list(values);
    MatrixX<S> M(rows, cols);
    for (Index k = 0; k < v.size(); ++k) M(k / cols, k % cols) = v[k];
    return M;
  }
  Tiny(MatrixX<S> hessian, std::initializer_list<double> gradient)
      : H(std::move(hessian)), A(0, H.rows()), g(list(gradient)) {
    ub = VectorX<S>::Constant(H.rows(), std::numeric_limits<S>::infinity());
    lb = -ub;
  }
  Tiny& rows(MatrixX<S> matrix, std::initializer_list<double> lower,
             std::initializer_list<double> upper) {
    A = std::move(matrix);
    rl = list(lower);
    ru = list(upper);
    return *this;
  }
  QpStatus solve() {
    if (solver.set_hessian(H) != QpStatus::Solved || solver.set_rows(A) != QpStatus::Solved)
      return QpStatus::InvalidData;
    return solver.solve(g, lb, ub, rl, ru, result);
  }
};

}  // namespace

TEMPLATE_TEST_CASE("the solver ends for numbers at the limits of the scalar's range", "[qp]", float,
                   double) {
  using S = TestType;
  using T = Tiny<S>;
  const bool single = sizeof(S) == sizeof(float);
  for (double tiny : {single ? 1e-44 : 1e-320, single ? 1e-38 : 1e-300, 1e-30, 1e-20, 0.0}) {
    INFO("H = diag(" << tiny << ", 0)");
    T q(T::table(2, 2, {tiny, 0, 0, 0}), {0, 0});
    CHECK(q.rows(T::table(1, 2, {1, 1}), {1}, {2}).solve() == QpStatus::Solved);
    T p(T::table(2, 2, {0, 0, 0, 0}), {tiny, tiny});
    p.lb.setZero();
    CHECK(p.rows(T::table(1, 2, {1, 1}), {1}, {2}).solve() == QpStatus::Solved);
  }
  const double huge = single ? 1e38 : 1e308;
  for (double h : {huge, 1e36, 1e25}) {  // must end; the status only must not claim a solution
    T q(T::table(2, 2, {h, 0, 0, 1}), {h, -1});
    const QpStatus status = q.rows(T::table(1, 2, {1, h}), {1}, {h}).solve();
    INFO("H = diag(" << h << ", 1) " << to_string(status));
    CHECK((status == QpStatus::Solved || status == QpStatus::SolvedInaccurate ||
           status == QpStatus::IterationLimit));
  }
}

TEMPLATE_TEST_CASE("a nearly flat direction leads to its minimum and is not called unbounded",
                   "[qp]", float, double) {
  using S = TestType;
  using T = Tiny<S>;
  const bool single = sizeof(S) == sizeof(float);
  for (double e : single ? std::vector<double>{1e-5, 3e-5, 1e-4, 2e-4, 5e-4, 1e-3, 1e-2}
                         : std::vector<double>{1e-12, 1e-11, 3e-11, 1e-10, 3e-10, 1e-9, 1e-8}) {
    T q(T::table(2, 2, {1, -1, -1, 1.0 + e}), {-1, -1});
    const double actual = static_cast<double>(q.H(1, 1)) - 1.0;
    INFO("e = " << e);
    const QpStatus status = q.solve();
    // At 2/e, x may have too few digits for the tolerance. The status must then follow the true
    // residual.
    const long double x0 = q.result.x[0], x1 = q.result.x[1];
    const long double first = x0 - x1 - 1,
                      second = static_cast<long double>(q.H(1, 1)) * x1 - x0 - 1;
    const double error = static_cast<double>(std::max(std::abs(first), std::abs(second)));
    CHECK(error <= 2.1 * static_cast<double>(q.result.stationarity) +
                       0.6 * static_cast<double>(QpSettings<S>().stationarity_tolerance));
    CHECK(error <= 8 * static_cast<double>(scalar_traits<S>::epsilon()) / actual);
    CHECK(static_cast<double>(q.result.x[1]) == Approx(2.0 / actual).epsilon(1e-2));
    CHECK(q.result.ray.isZero(S(0)));
    if (status != QpStatus::Solved) CHECK(status == QpStatus::SolvedInaccurate);
    if (status == QpStatus::Solved) {
      CHECK(q.solve() == QpStatus::Solved);
      CHECK(q.result.iterations == 0);
    }
    q.g = T::list({-1, 1});  // a new gradient must bring x back from the far minimum
    CHECK(q.solve() == QpStatus::Solved);
    CHECK(static_cast<double>(q.result.x[0] - q.result.x[1]) == Approx(1.0).epsilon(1e-3));
  }
}

TEMPLATE_TEST_CASE("rows that intersect far away are not called contradictory", "[qp]", float,
                   double) {
  using S = TestType;
  using T = Tiny<S>;
  const bool single = sizeof(S) == sizeof(float);
  for (double e : single ? std::vector<double>{1e-6, 3e-6, 1e-5, 1e-4, 1e-3}
                         : std::vector<double>{1e-14, 1e-13, 1e-12, 3e-12, 1e-11, 1e-9, 1e-6}) {
    for (double curvature : {0.0, 1.0}) {
      T q(T::table(2, 2, {curvature, 0, 0, curvature}), {0, 0});
      q.rows(T::table(2, 2, {1, 1, 1, 1.0 - e}), {1, -INFINITY}, {INFINITY, 0});
      INFO("e = " << e << " H = " << curvature);
      CHECK(q.solve() != QpStatus::PrimalInfeasible);
    }
  }
  T q(T::table(2, 2, {1, 0, 0, 1}), {0, 0});  // e = 0 is a contradiction
  CHECK(q.rows(T::table(2, 2, {1, 1, 1, 1}), {1, -INFINITY}, {INFINITY, 0}).solve() ==
        QpStatus::PrimalInfeasible);
}

TEMPLATE_TEST_CASE("infeasibility is reported before unboundedness", "[qp]", float, double) {
  using S = TestType;
  using T = Tiny<S>;
  for (double top : {0.0, 0.9, 0.999}) {
    T q(T::table(3, 3, {1, 0, 0, 0, 1, 0, 0, 0, 0}), {0, 0, -1});
    q.rows(T::table(2, 3, {1, 1, 0, 1, 1, 0}), {1, -INFINITY}, {INFINITY, top});
    INFO("top " << top);
    CHECK(q.solve() == QpStatus::PrimalInfeasible);
    CHECK(q.result.ray.isZero(S(0)));
    CHECK(q.result.row_multipliers[0] < S(0));
    CHECK(q.result.row_multipliers[1] > S(0));
    q.ru[1] = S(1);
    CHECK(q.solve() == QpStatus::DualInfeasible);
    CHECK(q.result.ray[2] > S(0));
    CHECK(q.result.feasibility <= QpSettings<S>::default_tolerance());
    q.ub[2] = S(7);
    CHECK(q.solve() == QpStatus::Solved);
    CHECK(static_cast<double>(q.result.x[2]) == Approx(7.0));
  }
  T lp(T::table(2, 2, {0, 0, 0, 0}), {0, -1});
  CHECK(lp.rows(T::table(2, 2, {1, 0, 1, 0}), {1, -INFINITY}, {INFINITY, 0}).solve() ==
        QpStatus::PrimalInfeasible);
}

TEMPLATE_TEST_CASE("rays along which the objective falls slowly are recognised", "[qp]", float,
                   double) {
  using S = TestType;
  using T = Tiny<S>;
  const bool single =
      sizeof(S) == sizeof(float);  // in float, slopes below the tolerance count as solved
  for (double slope : {single ? 1e-3 : 1e-4, 1e-2, 1e-1}) {
    INFO("slope " << slope);
    T lp(T::table(2, 2, {0, 0, 0, 0}), {1, -1.0 - slope});
    lp.lb.setZero();
    CHECK(lp.rows(T::table(1, 2, {1, -1}), {0}, {0}).solve() == QpStatus::DualInfeasible);
    CHECK(static_cast<double>(lp.result.ray[0]) == Approx(static_cast<double>(lp.result.ray[1])));
    CHECK(lp.g.dot(lp.result.ray) < S(0));
    T qp(T::table(2, 2, {1, -1, -1, 1}), {1, -1.0 - slope});
    CHECK(qp.solve() == QpStatus::DualInfeasible);
    CHECK(qp.g.dot(qp.result.ray) < S(0));
    lp.g = T::list({1, -1.0 + slope});  // with the opposite slope the minimum is at zero
    CHECK(lp.solve() == QpStatus::Solved);
    CHECK(lp.result.ray.isZero(S(0)));
  }
}

TEMPLATE_TEST_CASE("bounds that become huge by scaling stay bounds", "[qp]", float, double) {
  using S = TestType;
  using T = Tiny<S>;
  T lp(T::table(2, 2, {0, 0, 0, 0}),
       {1, 1});  // min x0 + x1, x0 ≥ 1e8; the free row makes column 0 look like 1e18
  lp.lb = T::list({1e8, -3});
  CHECK(lp.rows(T::table(1, 2, {1e18, 1}), {-INFINITY}, {INFINITY}).solve() == QpStatus::Solved);
  CHECK(lp.result.x[0] == S(1e8));
  CHECK(lp.result.x[1] == S(-3));
  if (sizeof(S) == sizeof(float)) return;  // the objective exceeds float's range
  T q(T::table(2, 2, {1e36, 0, 0, 1}), {0, -1});
  q.lb[0] = S(1e8);
  CHECK(q.solve() == QpStatus::Solved);
  CHECK(q.result.x[0] == S(1e8));
}

TEMPLATE_TEST_CASE("an unfinished solve returns the iterate with the least violation", "[qp]",
                   float, double) {
  using S = TestType;
  std::mt19937 random(26);
  int unfinished = 0;
  for (int trial = 0; trial < 12; ++trial) {
    const KnownQp<S> q = draw_qp<S>({.n = 30, .m = 25, .active = 0.6, .equalities = 0.1}, random);
    const VectorX<S> start = VectorX<S>::Zero(30).cwiseMax(q.lb).cwiseMin(q.ub);
    const auto violation = [&q](const VectorX<S>& x) {
      const VectorX<S> Ax = q.A * x;
      const S worst = std::max((q.rl - Ax).maxCoeff(), (Ax - q.ru).maxCoeff());
      return std::max(S(0), worst) /
             std::max(S(1), std::max(Ax.cwiseAbs().maxCoeff(), x.cwiseAbs().maxCoeff()));
    };
    for (int budget = 1; budget < 12; ++budget) {
      QpSettings<S> settings;
      settings.max_iterations = budget;
      ActiveSet<S> solver(settings);
      set(solver, q);
      QpResult<S> r;
      if (solve(solver, q, r) != QpStatus::IterationLimit) continue;
      ++unfinished;
      INFO("trial " << trial << " budget " << budget);
      CHECK(static_cast<double>(violation(r.x)) <=
            1.001 * static_cast<double>(violation(start)) + 1e-6);
      CHECK(static_cast<double>(r.feasibility) ==
            Approx(static_cast<double>(violation(r.x))).epsilon(1e-2).margin(1e-6));
      check_within_bounds(q, r.x);
    }
  }
  CHECK(unfinished > 20);
}

TEMPLATE_TEST_CASE("the solver recognises progress beside a large constant in the objective",
                   "[qp]", float, double) {
  using S = TestType;
  using T = Tiny<S>;
  constexpr Index n = 60;  // a chain released link by link, and a fixed unknown far away
  for (double far : {0.0, 1e6, 1e10}) {
    MatrixX<S> H = MatrixX<S>::Zero(n, n);
    for (Index i = 1; i < n; ++i) {
      H(i, i) = S(2);
      if (i > 1) H(i, i - 1) = H(i - 1, i) = S(-1);
    }
    T q(H, {});
    q.g = VectorX<S>::Constant(n, S(1e-6));
    q.g[0] = S(1);
    q.g[1] = S(-1e-2);
    q.lb.setZero();
    q.lb[0] = q.ub[0] = S(far);
    INFO("far " << far);
    CHECK(q.solve() == QpStatus::Solved);
    CHECK(static_cast<double>(q.result.x[1]) == Approx(0.0093).epsilon(0.2));
  }
}

TEST_CASE("the general solver starts from x, from a shifted x, and cold after reset", "[qp]") {
  std::mt19937 random(27);
  // Independent blocks of 8 unknowns and 5 rows, so that the shifted problem has the shifted
  // solution.
  const KnownQp<double> block = draw_qp<double>({.n = 8, .m = 5, .equalities = 0.0}, random);
  const Index blocks = 5, n = 8 * blocks, m = 5 * blocks;
  KnownQp<double> q;
  q.H = MatrixX<double>::Zero(n, n);
  q.A = MatrixX<double>::Zero(m, n);
  q.g.resize(n);
  q.lb = VectorX<double>::Constant(n, -0.5);
  q.ub = VectorX<double>::Constant(n, 0.6);
  q.rl = VectorX<double>::Constant(m, -0.4);
  q.ru = VectorX<double>::Constant(m, 0.3);
  std::normal_distribution<double> normal;
  for (Index b = 0; b < blocks; ++b) {
    q.H.block(8 * b, 8 * b, 8, 8) = block.H;
    q.A.block(5 * b, 8 * b, 5, 8) = block.A;
    for (Index i = 0; i < 8; ++i) q.g[8 * b + i] = normal(random);
  }
  QpSession<double, ActiveSet<double>> session;
  REQUIRE(session.set(q) == QpStatus::Solved);
  REQUIRE(session.solve(q) == QpStatus::Solved);
  const int cold = session.result.iterations;
  CHECK(cold > 1);
  const VectorX<double> x = session.result.x;

  KnownQp<double> next = q;
  next.g.head(n - 8) = q.g.tail(n - 8);
  session.solver.shift(8, 5);
  REQUIRE(session.solve(next) == QpStatus::Solved);
  CHECK(session.result.iterations == 0);
  CHECK((session.result.x.head(n - 8) - x.tail(n - 8)).cwiseAbs().maxCoeff() < 1e-8);

  CHECK_FALSE(session.solver.warm_start(VectorX<double>::Zero(n - 1)));
  CHECK_FALSE(session.solver.warm_start(VectorX<double>::Constant(n, inf)));
  REQUIRE(session.solve(next) == QpStatus::Solved);
  CHECK(session.result.iterations == 0);  // the refused starts changed nothing

  REQUIRE(session.solver.warm_start(x));
  REQUIRE(session.solve(q) == QpStatus::Solved);
  CHECK(session.result.iterations < cold);
  CHECK((session.result.x - x).cwiseAbs().maxCoeff() < 1e-8);

  session.solver.reset();
  REQUIRE(session.solve(q) == QpStatus::Solved);
  CHECK(session.result.iterations == cold);
  CHECK((session.result.x - x).cwiseAbs().maxCoeff() < 1e-8);

  QpSession<double, ActiveSet<double>> fresh;  // warm_start is allowed before the first solve
  REQUIRE(fresh.set(q) == QpStatus::Solved);
  REQUIRE(fresh.solver.warm_start(x));
  REQUIRE(fresh.solve(q) == QpStatus::Solved);
  CHECK((fresh.result.x - x).cwiseAbs().maxCoeff() < 1e-8);
  CHECK_FALSE(ActiveSet<double>().warm_start(x));
}

TEST_CASE("reserved sizes are maxima; problems may shrink, grow or have no rows", "[qp]") {
  std::mt19937 random(23);
  ActiveSet<double> solver;
  solver.reserve(40, 30);
  for (const auto& [n, m] :
       {std::pair<Index, Index>{40, 30}, {12, 5}, {25, 0}, {40, 30}, {50, 45}}) {
    const KnownQp<double> q = draw_qp<double>({.n = n, .m = m}, random);
    const long before = allocations();
    const QpStatus hessian = solver.set_hessian(q.H), rows = solver.set_rows(q.A);
    const long taken = allocations() - before;
    if (n <= 40 && allocation_counting_works()) CHECK(taken == 0);
    REQUIRE(hessian == QpStatus::Solved);
    REQUIRE(rows == QpStatus::Solved);
    QpResult<double> r;
    REQUIRE(solve(solver, q, r) == QpStatus::Solved);
    CHECK(r.objective == Approx(q.objective()).epsilon(1e-7));
  }
  const KnownQp<double> q = draw_qp<double>({.n = 8}, random);  // a new size drops the rows
  QpResult<double> r;
  REQUIRE(solver.set_hessian(q.H) == QpStatus::Solved);
  REQUIRE(solve(solver, q, r) == QpStatus::Solved);
  CHECK(r.objective == Approx(q.objective()).epsilon(1e-7));
}

TEST_CASE("a large solve within the reserved size does not allocate", "[qp]") {
  if (!allocation_counting_works()) return;
  std::mt19937 random(25);
  const KnownQp<double> q =
      draw_qp<double>({.n = 300, .m = 150, .active = 0.4, .equalities = 0.5}, random);
  QpSession<double, ActiveSet<double>> session;
  REQUIRE(session.set(q) == QpStatus::Solved);
  session.result.resize(300, 150);
  const long before = allocations();
  const QpStatus cold = session.solve(q);
  const long taken = allocations() - before;
  CHECK(taken == 0);
  CHECK(cold == QpStatus::Solved);
  CHECK(session.residuals(q).worst() < 1e-8);
}

TEST_CASE("a solve that runs out of iterations returns a point within the bounds", "[qp]") {
  std::mt19937 random(24);
  const KnownQp<double> q = draw_qp<double>({.n = 30, .m = 20}, random);
  QpSettings<double> settings;
  settings.max_iterations = 1;
  ActiveSet<double> solver(settings);
  solver.reserve(30, 20);
  set(solver, q);
  QpResult<double> r;
  CHECK(solve(solver, q, r) == QpStatus::IterationLimit);
  check_within_bounds(q, r.x);
  CHECK(r.feasibility > 0.0);
}

TEMPLATE_TEST_CASE("the active set of a result starts another solver at its solution", "[qp]",
                   float, double) {
  using S = TestType;
  std::mt19937 random(91);
  int unique_ones = 0;
  for (int trial = 0; trial < 60; ++trial) {
    QpFamily family;
    family.n = 4 + trial % 20;
    family.m = trial % 13;
    family.active = 0.4;
    family.equalities = 0.3;
    KnownQp<S> q = draw_qp<S>(family, random);
    const S tiny = trial % 4 == 3 ? std::ldexp(S(1), -60)
                                  : S(1);  // sides of rows must not depend on their scale
    q.A *= tiny;
    for (VectorX<S>* r : {&q.rl, &q.ru})
      *r = r->unaryExpr([&](S v) { return is_unbounded(v) ? v : S(v * tiny); });
    ActiveSet<S> first, second, both;
    QpResult<S> cold, warm;
    for (ActiveSet<S>* s : {&first, &second, &both}) set(*s, q);
    REQUIRE(solve(first, q, cold) == QpStatus::Solved);
    for (Index i = 0; i < family.m; ++i) {
      const QpSide side = cold.row_sides[static_cast<std::size_t>(i)];
      const S y = cold.row_multipliers[i];
      CHECK((side == QpSide::Upper) == (y < S(0)));
      if (q.rl[i] < q.ru[i]) CHECK((side == QpSide::Between) == (y == S(0)));
    }
    for (Index j = 0; j < family.n; ++j) {
      const QpSide side = cold.bound_sides[static_cast<std::size_t>(j)];
      if (side == QpSide::Lower) CHECK(cold.x[j] == q.lb[j]);
      if (side == QpSide::Upper) CHECK(cold.x[j] == q.ub[j]);
      if (side == QpSide::Between) CHECK((q.lb[j] < cold.x[j] && cold.x[j] < q.ub[j]));
    }
    // With more active rows than free unknowns, the active sets do not determine the multipliers.
    const auto count = [](const std::vector<QpSide>& sides, QpSide side) {
      return std::count(sides.begin(), sides.end(), side);
    };
    const bool unique =
        count(cold.bound_sides, QpSide::Between) + count(cold.row_sides, QpSide::Between) >=
        family.m;
    unique_ones += unique ? 1 : 0;
    REQUIRE(second.warm_start(cold.bound_sides, cold.row_sides));
    REQUIRE(solve(second, q, warm) == QpStatus::Solved);
    if (unique) CHECK(warm.iterations == 0);
    CHECK(double((warm.x - q.x).norm()) <=
          (sizeof(S) == 8 ? 1e-6 : 2e-2) * (1.0 + double(q.x.norm())));
    REQUIRE(both.warm_start(cold.x, cold.bound_sides, cold.row_sides));
    REQUIRE(solve(both, q, warm) == QpStatus::Solved);
    if (unique) CHECK(warm.iterations == 0);
  }
  CHECK(unique_ones > 40);
}

TEST_CASE("wrong active sets cost iterations but not accuracy, and invalid ones are refused",
          "[qp]") {
  std::mt19937 random(92);
  std::uniform_int_distribution<int> three(-1, 1);
  for (int trial = 0; trial < 60; ++trial) {
    QpFamily family;
    family.n = 5 + trial % 17;
    family.m = 1 + trial % 9;
    const KnownQp<double> q = draw_qp<double>(family, random);
    ActiveSet<double> solver;
    set(solver, q);
    std::vector<QpSide> bounds(static_cast<std::size_t>(family.n)),
        rows(static_cast<std::size_t>(family.m));
    for (QpSide& s : bounds) s = static_cast<QpSide>(three(random));
    for (QpSide& s : rows) s = static_cast<QpSide>(three(random));
    REQUIRE(solver.warm_start(bounds, rows));
    QpResult<double> result;
    REQUIRE(solve(solver, q, result) == QpStatus::Solved);
    CHECK(result.objective == Approx(q.objective()).epsilon(1e-7).margin(1e-7));
    // Refused starts leave the solver's solution unchanged.
    bounds[0] = static_cast<QpSide>(3);
    CHECK_FALSE(solver.warm_start(bounds, rows));
    bounds.pop_back();
    CHECK_FALSE(solver.warm_start(bounds, rows));
    bounds.assign(static_cast<std::size_t>(family.n), QpSide::Lower);
    VectorX<double> x = VectorX<double>::Zero(family.n);
    x[1] = std::numeric_limits<double>::quiet_NaN();
    CHECK_FALSE(solver.warm_start(x, bounds, rows));
    CHECK_FALSE(solver.warm_start(VectorX<double>::Zero(family.n + 1), bounds, rows));
    rows.push_back(QpSide::Upper);
    CHECK_FALSE(solver.warm_start(bounds, rows));
    REQUIRE(solve(solver, q, result) == QpStatus::Solved);
    CHECK(result.iterations == 0);
  }
}

TEST_CASE("shift moves the active set of a warm start", "[qp]") {
  const Index n = 6;
  const MatrixX<double> I = MatrixX<double>::Identity(n, n);
  VectorX<double> g(n), lb = VectorX<double>::Constant(n, -10.0), ub = -lb;
  VectorX<double> rl = VectorX<double>::Constant(n, -1.0), ru = -rl;
  g << -3.0, 0.5, 2.0, -0.5, 4.0, -2.0;
  ActiveSet<double> first, second;
  QpResult<double> result;
  for (ActiveSet<double>* s : {&first, &second}) {
    REQUIRE(s->set_hessian(I) == QpStatus::Solved);
    REQUIRE(s->set_rows(I) == QpStatus::Solved);
  }
  REQUIRE(first.solve(g, lb, ub, rl, ru, result) == QpStatus::Solved);
  REQUIRE(second.warm_start(result.bound_sides, result.row_sides));
  second.shift(1, 1);
  const VectorX<double> last = g.tail(1);
  g.head(n - 1) = g.tail(n - 1).eval();
  g.tail(1) = last;
  REQUIRE(second.solve(g, lb, ub, rl, ru, result) == QpStatus::Solved);
  CHECK(result.iterations == 0);
}

TEST_CASE("copied and moved solvers are independent", "[qp]") {
  std::mt19937 random(4);
  for (const Index size : {6, 50}) {  // the larger one is sparse
    QpFamily family;
    family.n = size;
    family.m = size / 2;
    KnownQp<double> q = draw_qp<double>(family, random);
    auto first = std::make_unique<ActiveSet<double>>();
    QpResult<double> result, expected;
    set(*first, q);
    REQUIRE(solve(*first, q, result) == QpStatus::Solved);
    ActiveSet<double> copy = *first, assigned;
    assigned = *first;
    REQUIRE(first->set_hessian(100.0 * q.H) == QpStatus::Solved);
    REQUIRE(first->set_rows(-2.0 * q.A) == QpStatus::Solved);
    (void)solve(*first, q, result);
    ActiveSet<double> moved = std::move(*first);
    first.reset();
    (void)solve(moved, q, result);
    q.g *= 1.5;  // another optimum
    ActiveSet<double> fresh;
    set(fresh, q);
    REQUIRE(solve(fresh, q, expected) == QpStatus::Solved);
    for (ActiveSet<double>* s : {&copy, &assigned}) {
      REQUIRE(solve(*s, q, result) == QpStatus::Solved);
      CHECK(result.objective == Approx(expected.objective).epsilon(1e-7));
    }
  }
}

TEST_CASE("a solve that ran out of iterations continues in the next solve", "[qp]") {
  std::mt19937 random(21);
  int cut = 0;
  for (int trial = 0; trial < 40; ++trial) {
    QpFamily family;
    family.n = 20 + trial % 30;
    family.m = 15 + trial % 40;
    family.active = 0.5;
    const KnownQp<double> q = draw_qp<double>(family, random);
    for (const int budget : {3, 8}) {
      QpSettings<double> settings;
      settings.max_iterations = budget;
      ActiveSet<double> solver(settings);
      set(solver, q);
      QpResult<double> result;
      QpStatus status = QpStatus::IterationLimit;
      int solves = 0;
      for (; solves < 100 && status != QpStatus::Solved; ++solves) {
        status = solve(solver, q, result);
        CHECK(result.iterations <= budget);
      }
      INFO("trial " << trial << ", budget " << budget);
      CHECK(status == QpStatus::Solved);
      CHECK(result.objective == Approx(q.objective()).epsilon(1e-6).margin(1e-6));
      cut += solves > 1 ? 1 : 0;
    }
  }
  CHECK(cut > 40);
}

TEST_CASE("negative sizes are refused with a message and change nothing", "[qp]") {
  ActiveSet<double> solver;
  const MatrixX<double> H = MatrixX<double>::Identity(2, 2), A = MatrixX<double>::Ones(1, 2);
  CHECK(solver.reserve(-1, 1) == QpStatus::InvalidData);
  CHECK(std::string(solver.refusal().message) == "reserved number of unknowns is negative");
  REQUIRE(solver.reserve(2, 1) == QpStatus::Solved);
  REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
  REQUIRE(solver.set_rows(A) == QpStatus::Solved);
  CHECK(solver.reserve(2, -1) == QpStatus::InvalidData);
  CHECK(std::string(solver.refusal().message) == "reserved number of rows is negative");
  QpResult<double> result;
  const VectorX<double> g = VectorX<double>::Zero(2), low = VectorX<double>::Constant(2, -5.0);
  const VectorX<double> one = VectorX<double>::Ones(1);
  CHECK(solver.solve(g, low, -low, one, one, result) == QpStatus::Solved);
  CHECK(result.x[0] == Approx(0.5));
  CHECK(solver.solve(g, low, -low, one, g, result) == QpStatus::InvalidData);
  CHECK(std::string(result.message) == "upper row bounds differ in size from the rows");
}
