// Newton's method and the sweeps of contact problems by themselves.

#include "clothctl/contact/detail/friction_newton.hpp"

#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;

namespace {

/// Contacts whose impulses also move all others.
void fill(detail::FrictionProblem<double>& problem, Index c, unsigned seed) {
  clothctl_test::Numbers random(seed);
  problem.resize(c);
  MatrixX<double> G(3 * c, 3 * c);
  for (Index i = 0; i < G.size(); ++i) G(i) = random(-1, 1);
  problem.D() = G * G.transpose() / static_cast<double>(c);
  problem.D().diagonal().array() += 0.5;
  for (Index i = 0; i < 3 * c; ++i) problem.b()[i] = random(-1, i % 3 == 0 ? 0.2 : 1);
  for (Index i = 0; i < c; ++i) problem.friction(i) = i % 5 == 0 ? 0.0 : random(0.1, 1);
  REQUIRE(problem.prepare() == -1);
}

constexpr detail::FrictionLimits<double> kLimits{1e-12, 1e-12, 5, 30, 3, 100};

}  // namespace

TEST_CASE("Newton's method finds what many sweeps find", "[contact]") {
  detail::FrictionProblem<double> problem;
  problem.reserve(10);
  detail::FrictionNewton<double> newton, sweeps;
  newton.reserve(10);
  sweeps.reserve(10);
  for (unsigned k = 0; k < 20; ++k) {
    fill(problem, 1 + static_cast<Index>(k % 10), k);
    const Index n = 3 * problem.contacts();
    newton.impulses().setZero();
    const detail::FrictionReport<double> one = newton.solve(problem, kLimits);
    detail::FrictionLimits<double> only = kLimits;
    only.newton_steps = 0;
    only.first_sweeps = 3000;
    only.rounds = 0;
    sweeps.impulses().setZero();
    const detail::FrictionReport<double> other = sweeps.solve(problem, only);
    CHECK(one.solved);
    CHECK(other.solved);
    CHECK(one.newton_steps <= 12);
    CHECK(one.sweeps <= 5);
    CHECK((newton.impulses().head(n) - sweeps.impulses().head(n)).norm() < 1e-9);
    VectorX<double> u(30);
    problem.velocities(newton.impulses(), u);
    CHECK(u.head(n) == newton.velocities().head(n));
    // From the answer nothing is left to do.
    const detail::FrictionReport<double> again = newton.solve(problem, kLimits);
    CHECK((again.solved && again.newton_steps == 0 && again.sweeps == 0));
  }
}

TEST_CASE("the best impulses are kept", "[contact]") {
  detail::FrictionProblem<double> problem;
  problem.reserve(6);
  detail::FrictionNewton<double> newton;
  newton.reserve(6);
  fill(problem, 6, 3);
  double last = 1e30;
  for (int steps = 0; steps < 15; ++steps) {
    detail::FrictionLimits<double> limits = kLimits;
    limits.newton_steps = steps;
    limits.rounds = 0;
    newton.impulses().setZero();
    const detail::FrictionReport<double> report = newton.solve(problem, limits);
    CHECK(report.residual.excess <= last);
    last = report.residual.excess;
  }
  CHECK(last <= 1);
}

TEST_CASE("no contacts are solved at once", "[contact]") {
  detail::FrictionProblem<double> problem;
  problem.reserve(0);
  problem.resize(0);
  detail::FrictionNewton<double> newton;
  newton.reserve(0);
  CHECK(newton.solve(problem, kLimits).solved);
}
