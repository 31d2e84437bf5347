// The solvers of a step: the truncated Newton method against the direct one, conjugate gradients
// against factors, the bound on the energy, matrices that float cannot factor.

#include "clothctl/cloth/detail/step_solver.hpp"

#include <cmath>
#include <limits>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/network/rope.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/square_sheets.hpp"

using namespace clothctl;
using clothctl_test::noise;
using clothctl_test::square_sheet;

namespace {

template <class S>
MassSpring<S> make(const SpringNetwork<S>& network, const MassSpringSettings<S>& settings) {
  return MassSpring<S>::create(network, settings).value();
}

double energy(const SpringNetwork<double>& network, const ClothState<double>& state) {
  return detail::spring_energy<double>(network, state.positions) +
         0.5 * network.mass.dot(state.velocities.colwise().squaredNorm());
}

}  // namespace

TEST_CASE("the truncated and the direct Newton method end at the same velocities", "[cloth]") {
  MassSpringSettings<double> settings;
  settings.integration = Integration::Newton;
  settings.velocity_tolerance = 1e-9;
  settings.pinned = {90, 99};
  const MassSpring<double> model = make(square_sheet<double>(10), settings);
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  state.velocities = noise<double>(1, 100, 0.3);
  for (int k = 0; k < 30; ++k) {
    ClothState<double> direct = state;
    const long before = clothctl_test::allocations();
    const StepReport<double> report = model.step(state, {}, 0.02, ws);
    const long made = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
    REQUIRE(report.status == StepStatus::Converged);
    // step_from factorises in each iteration. It starts close by: a buckling sheet has more than
    // one solution.
    const Points<double> guess = state.velocities + noise<double>(2, 100, 1e-4);
    REQUIRE(model.step_from(guess, 200, direct, {}, 0.02, ws).status == StepStatus::Converged);
    CHECK((direct.velocities - state.velocities).cwiseAbs().maxCoeff() <= 1e-6);
  }
}

TEST_CASE("Newton falls back to exact factors where float is too coarse", "[cloth]") {
  // h² k / m = 1e11: in float, the step matrix has no positive pivots left.
  SpringNetwork<double> network = square_sheet<double>(6);
  network.mass *= 1e-7;
  MassSpringSettings<double> settings;
  settings.integration = Integration::Newton;
  settings.pinned = {30, 35};
  const MassSpring<double> model = make(network, settings);
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  state.positions += noise<double>(3, 36, 1e-4);
  for (int v : settings.pinned) state.positions.col(v) = network.rest_positions.col(v);
  for (int k = 0; k < 10; ++k) {
    const StepReport<double> report = model.step(state, {}, 0.02, ws);
    CHECK(report.advanced);
    CHECK(all_finite(state.positions));
  }
  CHECK((state.positions - network.rest_positions).cwiseAbs().maxCoeff() < 0.3);
}

TEMPLATE_TEST_CASE("conjugate gradients take the steps that factors take", "[cloth]", float,
                   double) {
  using S = TestType;
  const bool single = std::is_same_v<S, float>;
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    CAPTURE(integration);
    MassSpringSettings<S> settings;
    settings.integration = integration;
    settings.velocity_tolerance = single ? S(1e-3) : S(1e-9);
    settings.pinned = {90, 99};
    settings.drag = S(1);
    const MassSpring<S> exact = make(square_sheet<S>(10), settings);
    settings.linear_solver = LinearSolver::ConjugateGradient;
    const MassSpring<S> iterative = make(square_sheet<S>(10), settings);
    auto ws = exact.make_workspace(), cg = iterative.make_workspace();
    ClothState<S> state = exact.rest_state(), other = state;
    CHECK(exact.step(state, {}, S(0.02), cg).status == StepStatus::InvalidWorkspace);
    CHECK(iterative.step(state, {}, S(0.02), ws).status == StepStatus::InvalidWorkspace);
    const std::vector<int> pins = settings.pinned;
    Points<S> forces(3, 2), expected(3, 2);
    for (int k = 0; k < 20; ++k) {
      other = state;
      REQUIRE(exact.step(state, {}, S(0.02), ws).advanced);
      const long before = clothctl_test::allocations();
      const StepReport<S> report = iterative.step(other, {}, S(0.02), cg);
      const long made = clothctl_test::allocations() - before;
      if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
      CHECK(report.status == StepStatus::Converged);
      const S tolerance = single ? S(2e-2) : S(1e-6);
      CHECK((state.velocities - other.velocities).cwiseAbs().maxCoeff() <= tolerance);
    }
    REQUIRE(exact.holding_forces(pins, ws, expected));
    REQUIRE(iterative.holding_forces(pins, cg, forces));
    CHECK((forces - expected).norm() <= (single ? S(0.05) : S(1e-4)) * expected.norm());
  }
}

TEST_CASE("when conjugate gradients run out of iterations the step says so", "[cloth]") {
  MassSpringSettings<double> settings;
  settings.linear_solver = LinearSolver::ConjugateGradient;
  settings.max_linear_iterations = 2;
  settings.velocity_tolerance = 1e-12;
  settings.limit_energy = false;
  settings.pinned = {30, 35};
  const MassSpring<double> model = make(square_sheet<double>(6), settings);
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  const StepReport<double> report = model.step(state, {}, 0.02, ws);
  CHECK(report.status == StepStatus::IterationLimit);
  CHECK((report.advanced && report.iterations == 2 && 0.0 < report.residual));
}

TEST_CASE("with the bound, a linear solve of a pushed rope creates no energy", "[cloth]") {
  // A light undamped rope that starts compressed: about its straight shape the forces are linear
  // only for much shorter steps.
  RopeSettings<double> rope;
  rope.damping_time = 0.0;
  SpringNetwork<double> network = rope_network(rope).value();
  network.mass *= 0.01;
  MassSpringSettings<double> settings;
  settings.gravity.setZero();
  double most[2] = {0, 0};
  long solves = 0;
  for (const bool limited : {false, true}) {
    settings.limit_energy = limited;
    const MassSpring<double> model = make(network, settings);
    auto ws = model.make_workspace();
    for (unsigned seed = 0; seed < 40; ++seed) {
      ClothState<double> state = model.rest_state();
      const Index n = state.positions.cols();
      state.positions += noise<double>(seed, n, 0.012);
      state.velocities = noise<double>(seed + 100, n, 10.0);
      for (int k = 0; k < 50; ++k) {
        const double start = energy(network, state);
        const StepReport<double> report = model.step(state, {}, 0.01, ws);
        REQUIRE(report.advanced);
        if (limited) solves += report.iterations;
        most[limited] = std::max(most[limited], energy(network, state) / start);
      }
    }
  }
  CHECK(most[0] > 1.001);
  CHECK(most[1] <= 1.0 + 1e-4);
  CHECK(solves < 40 * 50 * 8);
}
