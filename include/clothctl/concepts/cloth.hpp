#pragma once

// ClothPlant: what a controller may ask of a sheet, simulated or real, that it does not own.
// ClothModel: a simulator with a const model, a state that is a value, and separate scratch memory.
// ClothRollout: a ClothModel whose step can start from a guess of the velocities, for predictions.
//
// Each is checked through a trait, so that a type of another library takes part unchanged.

#include <concepts>
#include <span>
#include <vector>

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a type acts as a plant. The primary template forwards to members of the same names.
template <class Plant>
struct plant_traits {
  /// Returns the number of vertices n.
  static Index vertex_count(const Plant& plant) requires requires { plant.vertex_count(); }
  { return plant.vertex_count(); }
  /// Returns the vertex positions, 3×n, m, world frame, z up.
  static decltype(auto) positions(const Plant& plant) requires requires { plant.positions(); }
  { return plant.positions(); }
  /// Returns the vertex velocities, 3×n, m/s.
  static decltype(auto) velocities(const Plant& plant) requires requires { plant.velocities(); }
  { return plant.velocities(); }
  /// Sets the input that acts on the sheet from now on.
  template <class Input>
  requires requires(Plant& p, const Input& input) { p.apply(input); }
  static void apply(Plant& plant, const Input& input) { plant.apply(input); }
  /// Advances by `dt` (s) under the input that was applied last.
  template <class Scalar>
  requires requires(Plant& p, Scalar dt) { p.advance(dt); }
  static auto advance(Plant& plant, Scalar dt) { return plant.advance(dt); }
  /// Returns the force that holds the whole sheet at rest against gravity, 3, N: (0, 0, weight).
  /// Optional.
  static decltype(auto) gravity_load(const Plant& plant) requires requires { plant.gravity_load(); }
  { return plant.gravity_load(); }
  /// Returns the only time step that `advance` takes, s. Optional.
  static auto time_step(const Plant& plant) requires requires { plant.time_step(); }
  { return plant.time_step(); }
};

/// A sheet, simulated or real, that takes inputs and can be measured.
///
/// Axioms: after `advance` reports `advanced`, positions and velocities are those `dt` later; after
/// any other report they are unchanged; `advance` refuses a `dt` that is not positive and input
/// that is not finite; a simulated plant gives equal results for equal state and input.
///
/// Optional hooks: `gravity_load(plant)` and `time_step(plant)`; where a plant has them,
/// `run_frame` compares them with the planner's settings.
template <class Plant, class Scalar = double>
concept ClothPlant = RealScalar<Scalar> &&
    requires(Plant& plant, const Plant& watched, const ClothInput<Scalar>& input, Scalar dt) {
  { plant_traits<Plant>::vertex_count(watched) } -> std::convertible_to<Index>;
  { plant_traits<Plant>::positions(watched) } -> std::convertible_to<PointsView<Scalar>>;
  { plant_traits<Plant>::velocities(watched) } -> std::convertible_to<PointsView<Scalar>>;
  plant_traits<Plant>::apply(plant, input);
  { plant_traits<Plant>::advance(plant, dt) } -> std::same_as<StepReport<Scalar>>;
};

/// How a type acts as a cloth model. The primary template forwards to members of the same names.
template <class Model>
struct cloth_traits {
  /// Returns the number of vertices n.
  static Index vertex_count(const Model& model) requires requires { model.vertex_count(); }
  { return model.vertex_count(); }
  /// Returns the undeformed sheet at rest. Allocates.
  static auto rest_state(const Model& model) requires requires { model.rest_state(); }
  { return model.rest_state(); }
  /// Returns the scratch memory of a step. Allocates.
  static auto make_workspace(const Model& model) requires requires { model.make_workspace(); }
  { return model.make_workspace(); }
  /// Advances `state` by `dt` (s). Never allocates.
  template <class State, class Input, class Scalar, class Workspace>
  requires requires(const Model& m, State& s, const Input& i, Scalar h, Workspace& w) {
    m.step(s, i, h, w);
  }
  static auto step(const Model& model, State& state, const Input& input, Scalar dt,
                   Workspace& workspace) {
    return model.step(state, input, dt, workspace);
  }
  /// Returns the force that holds the whole sheet at rest against gravity, 3, N. Optional.
  static decltype(auto) gravity_load(const Model& model) requires requires { model.gravity_load(); }
  { return model.gravity_load(); }
};

/// A simulator with a const model, a state that is a value and a workspace for scratch memory.
///
/// Axioms: `step` depends only on model, state, input and dt (no content of the workspace carries
/// over from step to step); a step that does not report `advanced` leaves the state bitwise as it
/// was; one model serves many threads, each with a state and a workspace. `ModelPlant` makes a
/// ClothPlant of any ClothModel.
///
/// Optional hooks: `gravity_load(model)`, which `ModelPlant` passes on.
template <class Model, class Scalar = double>
concept ClothModel = RealScalar<Scalar> &&
    requires(const Model& model, const ClothInput<Scalar>& input, Scalar dt) {
  { cloth_traits<Model>::vertex_count(model) } -> std::convertible_to<Index>;
  { cloth_traits<Model>::rest_state(model) } -> std::same_as<ClothState<Scalar>>;
  cloth_traits<Model>::make_workspace(model);
  requires requires(ClothState<Scalar> & state,
                    decltype(cloth_traits<Model>::make_workspace(model))& workspace) {
    {
      cloth_traits<Model>::step(model, state, input, dt, workspace)
      } -> std::same_as<StepReport<Scalar>>;
  };
};

/// How a type acts as a model that can be rolled out. The primary template forwards to members of
/// the same names.
template <class Model>
struct cloth_rollout_traits {
  /// Advances `state` by `dt` with at most `newton_steps` Newton steps from the velocities `guess`
  /// (3×n, m/s); a Newton step that changes no velocity by more than `tolerance` (m/s) is the last.
  /// Never allocates.
  template <class Guess, class State, class Input, class Scalar, class Workspace>
  requires requires(const Model& m, const Guess& g, State& s, const Input& i, Scalar h,
                    Workspace& w) {
    m.step_from(g, 1, s, i, h, w, h);
  }
  static auto step_from(const Model& model, const Guess& guess, int newton_steps, State& state,
                        const Input& input, Scalar dt, Workspace& workspace, Scalar tolerance) {
    return model.step_from(guess, newton_steps, state, input, dt, workspace, tolerance);
  }
  /// Takes what carries vertices of a sheet at `x` (3×n, m) in the steps to come: VertexSupport,
  /// each vertex once, without the forces, which come with the inputs. Optional.
  template <class Supports, class Positions>
  requires requires(Model& m, const Supports& supports, const Positions& x) {
    m.set_supports(supports, x);
  }
  static void set_supports(Model& model, const Supports& supports, const Positions& x) {
    model.set_supports(supports, x);
  }
  /// Makes an object that linearises steps with `driven` vertices, and pushes and pulls changes
  /// through them as MassSpringDerivative does. Allocates. Optional.
  static auto make_derivative(const Model& model,
                              const std::vector<int>& driven) requires requires {
    model.make_derivative(driven);
  }
  { return model.make_derivative(driven); }
  /// Writes the forces (3×vertices, N) that the driven `vertices` needed in the last step of this
  /// workspace. Never allocates.
  template <class Workspace, class Out>
  requires requires(const Model& m, std::span<const int> v, Workspace& w, Out& out) {
    m.holding_forces(v, w, out);
  }
  static void holding_forces(const Model& model, std::span<const int> vertices,
                             Workspace& workspace, Out& forces) {
    model.holding_forces(vertices, workspace, forces);
  }
};

/// A ClothModel that a RolloutPredictor can simulate along a plan: it can start its nonlinear step
/// from a guess, and returns the forces that kept driven vertices on their paths.
///
/// Axioms: with enough Newton steps `step_from` ends where `step` ends, from any guess nearby; a
/// step with the holding forces applied instead of the driven positions ends at the same state.
///
/// Optional hooks: `set_supports(model, supports, x)`; without it, supports are constant forces.
/// `make_derivative(model, driven)`; with it, a RolloutPredictor knows how the features respond
/// along the rollout.
template <class Model, class Scalar = double>
concept ClothRollout = ClothModel<Model, Scalar> &&
    requires(const Model& model, const Points<Scalar>& guess, ClothState<Scalar>& state,
             const ClothInput<Scalar>& input, Scalar dt,
             decltype(cloth_traits<Model>::make_workspace(model))& workspace,
             std::span<const int> vertices, Points<Scalar>& forces) {
  {
    cloth_rollout_traits<Model>::step_from(model, guess, 1, state, input, dt, workspace, dt)
    } -> std::same_as<StepReport<Scalar>>;
  cloth_rollout_traits<Model>::holding_forces(model, vertices, workspace, forces);
};

}  // namespace clothctl::inline CLOTHCTL_ABI
