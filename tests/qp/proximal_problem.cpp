#include "clothctl/qp/detail/proximal_problem.hpp"

#include <limits>
#include <random>

#include "support/catch.hpp"

using namespace clothctl;
using Problem = detail::ProximalProblem<double>;
using State = Problem::State;

namespace {

detail::Budget rounds(int most) {
  QpSettings<double> settings;
  settings.max_iterations = most;
  return detail::Budget(settings, 1);
}

// φ by its definition, for the check by finite differences.
double phi(const Problem& p, const VectorX<double>& x) {
  const Index n = p.unknowns(), m = p.rows();
  double value =
      0.5 * x.dot(p.H() * x) + p.g.head(n).dot(x) + 0.5 * p.rho * (x - p.xk.head(n)).squaredNorm();
  const VectorX<double> v = p.A() * x - p.mu * p.yk.head(m);
  for (Index i = 0; i < m; ++i) {
    const double distance = v[i] - std::min(std::max(v[i], p.rl[i]), p.ru[i]);
    value += 0.5 * distance * distance / p.mu;
  }
  return value;
}

}  // namespace

TEST_CASE(
    "the inner minimiser beats every nearby point of the box, and its gradient matches the "
    "definition",
    "[qp]") {
  std::mt19937 random(41);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (int trial = 0; trial < 40; ++trial) {
    const Index n = 12, m = trial % 3 == 0 ? 0 : 9;
    const auto draw = [&](Index r, Index c) {
      MatrixX<double> M(r, c);
      for (Index k = 0; k < M.size(); ++k) M.data()[k] = normal(random);
      return M;
    };
    Problem p;
    p.reserve(n + 3, m + 2);
    p.resize(n, m);
    const MatrixX<double> J = draw(n / 2, n), A = draw(m, n);
    p.H() = J.transpose() * J;
    p.A() = A;
    p.At() = A.transpose();
    p.rho = 1e-3;
    p.mu = trial % 2 == 0 ? 1e-1 : 1e-4;
    for (Index j = 0; j < n; ++j) {
      p.g[j] = normal(random);
      p.lo[j] = -uniform(random);
      p.hi[j] = j % 4 == 0 ? p.lo[j] : uniform(random);
      p.x[j] = p.lo[j];
      p.xk[j] = normal(random);
    }
    for (Index i = 0; i < m; ++i) {
      p.rl[i] = i % 3 == 0 ? -detail::no_bound<double>() : normal(random);
      p.ru[i] = i % 3 == 1 ? p.rl[i] : std::max(p.rl[i], normal(random));
      p.yk[i] = normal(random);
    }
    p.refresh_products();
    int iterations = 0;
    REQUIRE(p.minimise(1e-9, iterations, rounds(1000)) == Problem::Outcome::Minimised);
    const VectorX<double> x = p.x.head(n);
    const double least = phi(p, x);
    for (int probe = 0; probe < 200; ++probe) {
      VectorX<double> other = x + std::pow(10.0, -probe % 6) * VectorX<double>(draw(n, 1));
      other = other.cwiseMax(p.lo.head(n)).cwiseMin(p.hi.head(n));
      REQUIRE(phi(p, other) >= least - 1e-9 * (1.0 + std::abs(least)));
    }
    p.refresh_products();
    p.update_multipliers();
    for (Index j = 0; j < n; ++j) {
      VectorX<double> up = x, down = x;
      up[j] += 1e-6;
      down[j] -= 1e-6;
      const double difference = (phi(p, up) - phi(p, down)) / 2e-6;
      CHECK(p.grad[j] == Approx(difference).epsilon(1e-4).margin(1e-4 / p.mu * 1e-2));
      CHECK(p.x[j] >= p.lo[j]);
      CHECK(p.x[j] <= p.hi[j]);
    }
  }
}

TEST_CASE("running out of iterations and a concave problem have different statuses", "[qp]") {
  Problem p;
  p.reserve(2, 0);
  p.resize(2, 0);
  p.H() << 1.0, 3.0, 3.0, 1.0;
  p.rho = 1e-6;
  p.mu = 1.0;
  p.g << 1.0, -1.0;
  p.lo.setConstant(-detail::no_bound<double>());
  p.hi.setConstant(detail::no_bound<double>());
  p.state.assign(2, State::Free);
  p.refresh_products();
  int iterations = 0;
  CHECK(p.minimise(1e-9, iterations, rounds(100)) == Problem::Outcome::NonConvex);
  p.rho = 1e-6;
  p.factor.clear();
  p.H() << 1.0, 0.5, 0.5, 1.0;
  iterations = 0;
  CHECK(p.minimise(1e-9, iterations, rounds(1)) == Problem::Outcome::IterationLimit);
}

TEST_CASE("numbers that cannot be factored end with a status, not in an endless loop", "[qp]") {
  for (double rho : {0.0, std::numeric_limits<double>::infinity()}) {
    Problem p;
    p.reserve(2, 1);
    p.resize(2, 1);
    p.H().setZero();
    p.A().setOnes();
    p.At().setOnes();
    p.rho = rho;
    p.rho_ceiling = std::numeric_limits<double>::infinity();
    p.mu = 1.0;
    p.g << 1.0, -1.0;
    p.lo.setConstant(-detail::no_bound<double>());
    p.hi.setConstant(detail::no_bound<double>());
    p.rl.setConstant(1.0);
    p.ru.setConstant(1.0);
    p.state.assign(2, State::Free);
    p.refresh_products();
    int iterations = 0;
    CHECK(p.minimise(1e-9, iterations, rounds(100)) == Problem::Outcome::NumericalError);
  }
}
