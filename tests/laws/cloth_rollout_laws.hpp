#pragma once

// The laws that every ClothRollout must obey, in addition to those of ClothModel (cloth_laws.hpp).
// Call check_cloth_rollout_laws(model, state, held, laws) inside a TEST_CASE.
//
//   guess      with many Newton steps, step_from ends where step ends, whatever the guess
//   holding    the forces that held driven vertices on their path, applied instead of it, end at
//              the same state
//   refusal    a step that does not report `advanced` leaves the state bitwise as it was
//   memory     neither call allocates

#include <cmath>
#include <limits>
#include <type_traits>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// The properties of a model, and the tolerance of the laws.
template <class Scalar>
struct ClothRolloutLaws {
  /// Step length, s.
  Scalar dt = Scalar(0.02);
  /// A number of Newton steps that converges from any guess near the solution.
  int newton_steps = 30;
  /// Largest difference between the velocities of the guess and of the state, m/s.
  Scalar guess = Scalar(0.1);
  /// How far the driven vertices move in the step, m.
  Scalar move = Scalar(0.004);
  /// Largest error of velocities, m/s.
  Scalar tolerance = std::is_same_v<Scalar, float> ? Scalar(1e-3) : Scalar(1e-8);
};

/// Checks the laws from `state`, with the vertices `held` driven.
template <class Model, class Scalar>
void check_cloth_rollout_laws(const Model& model, const clothctl::ClothState<Scalar>& state,
                              const std::vector<int>& held,
                              const ClothRolloutLaws<Scalar>& laws = {}) {
  using namespace clothctl;
  static_assert(ClothRollout<Model, Scalar>);
  using Traits = cloth_traits<Model>;
  using Rollout = cloth_rollout_traits<Model>;
  const Index n = Traits::vertex_count(model), count = static_cast<Index>(held.size());
  ClothInput<Scalar> driven;
  driven.forces.setZero(3, 0);
  driven.driven_vertices = held;
  driven.driven_positions.resize(3, count);
  for (Index j = 0; j < count; ++j) {
    const Vector3<Scalar> step(laws.move, -laws.move * Scalar(j), laws.move / Scalar(2));
    driven.driven_positions.col(j) = state.positions.col(held[static_cast<std::size_t>(j)]) + step;
  }
  auto workspace = Traits::make_workspace(model);
  ClothState<Scalar> stepped = state;
  REQUIRE(Traits::step(model, stepped, driven, laws.dt, workspace).advanced);

  ClothState<Scalar> guessed = state;
  Points<Scalar> forces(3, count);
  for (const double phase : {0.0, 1.0, 2.0}) {
    CAPTURE(phase);
    INFO("law: guess");
    Points<Scalar> guess = state.velocities;
    for (Index i = 0; i < guess.size(); ++i)
      guess(i) += laws.guess * Scalar(std::sin(1.3 * static_cast<double>(i) + phase));
    guessed = state;
    const long before = allocations();
    const StepReport<Scalar> report = Rollout::step_from(model, guess, laws.newton_steps, guessed,
                                                         driven, laws.dt, workspace, Scalar(0));
    Rollout::holding_forces(model, held, workspace, forces);
    const long made = allocations() - before;
    REQUIRE(report.advanced);
    if (allocation_counting_works()) CHECK(made == 0);
    CHECK((guessed.velocities - stepped.velocities).cwiseAbs().maxCoeff() <= laws.tolerance);
  }
  {
    INFO("law: holding");
    ClothInput<Scalar> pushed;
    pushed.force_vertices = held;
    pushed.forces = forces;
    pushed.driven_positions.setZero(3, 0);
    ClothState<Scalar> ended = state;
    const Points<Scalar> guess = guessed.velocities;
    REQUIRE(Rollout::step_from(model, guess, laws.newton_steps, ended, pushed, laws.dt, workspace,
                               Scalar(0))
                .advanced);
    CHECK((ended.velocities - guessed.velocities).cwiseAbs().maxCoeff() <= laws.tolerance);
    CHECK((ended.positions - guessed.positions).cwiseAbs().maxCoeff() <=
          laws.dt * laws.tolerance + Scalar(8) * scalar_traits<Scalar>::epsilon());
    // The forces have an effect: without them, the vertices end elsewhere.
    pushed.forces.setZero();
    ClothState<Scalar> free = state;
    REQUIRE(Traits::step(model, free, pushed, laws.dt, workspace).advanced);
    CHECK((free.velocities - guessed.velocities).cwiseAbs().maxCoeff() >
          Scalar(10) * laws.tolerance);
  }
  {
    INFO("law: refusal");
    ClothState<Scalar> refused = state;
    const Points<Scalar> guess = Points<Scalar>::Zero(3, n);
    const StepReport<Scalar> report = Rollout::step_from(
        model, guess, 1, refused, driven, Scalar(-1) * laws.dt, workspace, Scalar(0));
    CHECK_FALSE(report.advanced);
    CHECK(refused == state);
  }
}

}  // namespace clothctl_test
