#include "clothctl/qp/active_set.hpp"

#include <filesystem>
#include <limits>

#include "laws/qp_solver_laws.hpp"
#include "support/catch.hpp"
#include "support/qpt.hpp"
#include "support/shared_data.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

static_assert(QpSolver<ActiveSet<float>, float> && QpSolver<ActiveSet<double>, double>);
static_assert(WarmStartable<ActiveSet<float>, float> && WarmStartable<ActiveSet<double>, double>);
static_assert(!BoxQpSolver<ActiveSet<double>>);

namespace {

template <class S>
double tolerance() {
  return sizeof(S) == sizeof(float) ? 5e-4 : 1e-7;
}

const double inf = std::numeric_limits<double>::infinity();

VectorX<double> vec(double a, double b) { return (VectorX<double>(2) << a, b).finished(); }
VectorX<double> vec(double a) { return VectorX<double>::Constant(1, a); }

KnownQp<double> from_file(const Qpt& file) {
  KnownQp<double> q;
  q.H = file.H;
  q.A = file.A;
  q.g = file.g;
  q.lb = file.lb;
  q.ub = file.ub;
  q.rl = file.rl;
  q.ru = file.ru;
  return q;
}

// Aᵀy + z = 0 and the support function of the bounds is negative.
void check_farkas(const KnownQp<double>& q, const QpResult<double>& r) {
  const VectorX<double>&y = r.row_multipliers, &z = r.bound_multipliers;
  const VectorX<double> terms = q.A.cwiseAbs().transpose() * y.cwiseAbs();
  CHECK((q.A.transpose() * y + z).cwiseAbs().maxCoeff() <= 1e-10 * (1e-300 + terms.maxCoeff()));
  double support = 0.0;
  for (Index i = 0; i < y.size(); ++i) {
    if (y[i] != 0.0) support += y[i] * (y[i] > 0.0 ? q.ru[i] : q.rl[i]);
  }
  for (Index j = 0; j < z.size(); ++j) {
    if (z[j] != 0.0) support += z[j] * (z[j] > 0.0 ? q.ub[j] : q.lb[j]);
  }
  CHECK(support < 0.0);
}

// H d = 0, gᵀd < 0, and d leaves no finite bound or row.
void check_ray(const KnownQp<double>& q, const VectorX<double>& d) {
  const double size = d.cwiseAbs().maxCoeff();
  REQUIRE(size > 0.0);
  CHECK(q.g.dot(d) < 0.0);
  CHECK((q.H * d).cwiseAbs().maxCoeff() <= 1e-9 * size * (1.0 + q.H.cwiseAbs().maxCoeff()));
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
      ++inaccurate;  // said so itself
    } else {
      CHECK(broken == "");
    }
  }
  CHECK(inaccurate <= count / 50);
}

TEMPLATE_TEST_CASE("the general solver keeps the laws of history and recovery", "[qp]", float, double) {
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

TEST_CASE("the synthetic problems end with the right status, proof and objective", "[qp]") {
  const std::string folder = shared_path("data/qp/synthetic");
  if (folder.empty()) {
    WARN("shared data is missing; synthetic problems were not run");
    return;
  }
  int seen = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().stem().string();
    if (entry.path().extension() != ".qpt" || name[0] == 'e') continue;
    if (name == "a_degenerate_n300_0" && !full_tier()) continue;
    Qpt file;
    REQUIRE(read_qpt(entry.path().string(), file));
    const KnownQp<double> q = from_file(file);
    QpSession<double, ActiveSet<double>> session;
    REQUIRE(session.set(q) == QpStatus::Solved);
    const QpStatus status = session.solve(q);
    INFO(name);
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
      CHECK(std::abs(r.objective + file.r - file.objective) <= 1e-7 * std::max(1.0, std::abs(file.objective)));
      session.solve(q);
      CHECK(session.result.iterations == 0);
    }
  }
  CHECK(seen >= 96);
}

TEST_CASE("small problems of the public collection are solved", "[qp]") {
  for (const char* name :
       {"HS118", "HS268",  "HS35MOD", "HS52",   "HS76",     "ZECEVIC2", "QPTEST",  "QAFIRO",   "LOTSCHD",  "DUAL2",
        "DUAL4", "DUALC2", "DUALC8",  "DPKLO1", "QPCBLEND", "QSC205",   "QSCAGR7", "QSHARE1B", "PRIMALC2", "PRIMAL1"}) {
    const std::string path = shared_path("data/qp/maros_meszaros/" + std::string(name) + ".qpt");
    if (path.empty()) {
      WARN("shared data is missing; " << name << " was not run");
      continue;
    }
    Qpt file;
    REQUIRE(read_qpt(path, file));
    const KnownQp<double> q = from_file(file);
    QpSession<double, ActiveSet<double>> session;
    REQUIRE(session.set(q) == QpStatus::Solved);
    INFO(name);
    CHECK(session.solve(q) == QpStatus::Solved);
    CHECK(session.residuals(q).worst() < 1e-8);
    const double value = session.result.objective + file.r;
    CHECK(std::abs(value - file.objective) <= 1e-6 * std::max(1.0, std::max(std::abs(file.objective), std::abs(file.r))));
  }
}

TEST_CASE("sequences with equality rows keep their reference objectives", "[qp]") {
  for (const char* name : {"e_eqpatch_n125_0", "e_eqslide_n500_0"}) {
    const std::string path = shared_path("data/qp/synthetic/" + std::string(name) + ".qpt");
    if (path.empty()) {
      WARN("shared data is missing; " << name << " was not run");
      continue;
    }
    Qpt file;
    REQUIRE(read_qpt(path, file));
    KnownQp<double> q = from_file(file);
    QpSession<double, ActiveSet<double>> session;
    REQUIRE(session.set(q) == QpStatus::Solved);
    for (std::size_t k = 0; k < file.frames.size(); ++k) {
      const QptFrame& frame = file.frames[k];
      q.g = frame.g;
      q.lb = frame.lb;
      q.ub = frame.ub;
      q.rl = frame.rl;
      q.ru = frame.ru;
      session.solver.shift(file.shift, file.shift * file.m / file.n);
      INFO(name << " frame " << k);
      REQUIRE(session.solve(q) == QpStatus::Solved);
      CHECK(session.residuals(q).worst() < 1e-8);
      CHECK(session.result.objective == Approx(frame.objective).epsilon(1e-7).margin(1e-10));
    }
  }
}

TEST_CASE("contradictions and open directions in two dimensions are proven", "[qp]") {
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

TEST_CASE("inequality rows: active ones carry multipliers, others none", "[qp]") {
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

TEST_CASE("indefinite Hessians and bad rows are named", "[qp]") {
  ActiveSet<double> solver;
  solver.reserve(2, 1);
  QpResult<double> r;
  const MatrixX<double> I = MatrixX<double>::Identity(2, 2);
  REQUIRE(solver.set_hessian(I) == QpStatus::Solved);
  MatrixX<double> A = MatrixX<double>::Ones(1, 2);
  A(0, 1) = std::numeric_limits<double>::quiet_NaN();
  CHECK(solver.set_rows(A) == QpStatus::InvalidData);
  CHECK(solver.solve(vec(0, 0), vec(0, 0), vec(1, 1), vec(0), vec(1), r) == QpStatus::InvalidData);
  CHECK(std::string(r.message) == "row entry is not finite");
  CHECK(r.invalid_index == 1);
  CHECK(solver.set_rows(MatrixX<double>::Ones(1, 3)) == QpStatus::InvalidData);
  REQUIRE(solver.set_rows(MatrixX<double>::Ones(1, 2)) == QpStatus::Solved);
  CHECK(solver.solve(vec(0, 0), vec(0, 0), vec(1, 1), vec(2), vec(1), r) == QpStatus::InvalidData);
  CHECK(r.invalid_index == 0);
  CHECK(solver.solve(vec(0, 0), vec(0, 0), vec(1, 1), vec(1, 1), vec(1, 1), r) == QpStatus::InvalidData);
  REQUIRE(solver.solve(vec(0, 0), vec(0, 0), vec(1, 1), vec(1), vec(1), r) == QpStatus::Solved);
  CHECK(r.x[0] == Approx(0.5));
  MatrixX<double> H = I;
  H(0, 1) = H(1, 0) = 2.0;
  REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
  CHECK(solver.solve(vec(1, 3), vec(-5, -5), vec(5, 5), vec(-inf), vec(inf), r) == QpStatus::NonConvex);
}

TEST_CASE("reserved sizes are maxima, sizes may shrink and grow, rows may be absent", "[qp]") {
  std::mt19937 random(23);
  ActiveSet<double> solver;
  solver.reserve(40, 30);
  for (const auto& [n, m] : {std::pair<Index, Index>{40, 30}, {12, 5}, {25, 0}, {40, 30}, {50, 45}}) {
    const KnownQp<double> q = draw_qp<double>({.n = n, .m = m}, random);
    const long before = allocations();
    const QpStatus hessian = solver.set_hessian(q.H), rows = solver.set_rows(q.A);
    const long taken = allocations() - before;
    if (n <= 40 && allocation_counting_works()) CHECK(taken == 0);
    REQUIRE(hessian == QpStatus::Solved);
    REQUIRE(rows == QpStatus::Solved);
    QpResult<double> r;
    REQUIRE(solver.solve(q.g, q.lb, q.ub, q.rl, q.ru, r) == QpStatus::Solved);
    CHECK(r.objective == Approx(q.objective()).epsilon(1e-7));
  }
  const KnownQp<double> q = draw_qp<double>({.n = 8}, random);  // a new size forgets the rows
  QpResult<double> r;
  REQUIRE(solver.set_hessian(q.H) == QpStatus::Solved);
  REQUIRE(solver.solve(q.g, q.lb, q.ub, q.rl, q.ru, r) == QpStatus::Solved);
  CHECK(r.objective == Approx(q.objective()).epsilon(1e-7));
}

TEST_CASE("a large solve takes nothing from the heap", "[qp]") {
  if (!allocation_counting_works()) return;
  std::mt19937 random(25);
  const KnownQp<double> q = draw_qp<double>({.n = 300, .m = 150, .active = 0.4, .equalities = 0.5}, random);
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

TEST_CASE("an exhausted budget gives a point within the bounds", "[qp]") {
  std::mt19937 random(24);
  const KnownQp<double> q = draw_qp<double>({.n = 30, .m = 20}, random);
  QpSettings<double> settings;
  settings.max_iterations = 1;
  ActiveSet<double> solver(settings);
  solver.reserve(30, 20);
  REQUIRE(solver.set_hessian(q.H) == QpStatus::Solved);
  REQUIRE(solver.set_rows(q.A) == QpStatus::Solved);
  QpResult<double> r;
  CHECK(solver.solve(q.g, q.lb, q.ub, q.rl, q.ru, r) == QpStatus::IterationLimit);
  for (Index i = 0; i < 30; ++i) {
    CHECK(r.x[i] >= q.lb[i]);
    CHECK(r.x[i] <= q.ub[i]);
  }
  CHECK(r.feasibility > 0.0);
}
