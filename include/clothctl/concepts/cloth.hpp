#pragma once

// ClothPlant: all that a controller may ask of a sheet it does not own. ClothModel: a simulator of our own kind, whose
// model is const, whose state is a value and whose scratch memory is apart. Both are checked through a trait, so a type
// that has never heard of clothctl joins in by specialising the trait.

#include <concepts>

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"

namespace clothctl {

/// How a type acts as a plant. The primary forwards to members of the same names.
template <class Plant>
struct plant_traits {
  /// Number of vertices.
  static Index vertex_count(const Plant& plant) requires requires { plant.vertex_count(); }
  { return plant.vertex_count(); }
  /// Vertex positions, 3×n, m.
  static decltype(auto) positions(const Plant& plant) requires requires { plant.positions(); }
  { return plant.positions(); }
  /// Vertex velocities, 3×n, m/s.
  static decltype(auto) velocities(const Plant& plant) requires requires { plant.velocities(); }
  { return plant.velocities(); }
  /// Sets what acts on the sheet from now on.
  template <class Input>
  requires requires(Plant& p, const Input& input) { p.apply(input); }
  static void apply(Plant& plant, const Input& input) { plant.apply(input); }
  /// Advances by `dt` seconds under the input that was applied last.
  template <class Scalar>
  requires requires(Plant& p, Scalar dt) { p.advance(dt); }
  static auto advance(Plant& plant, Scalar dt) { return plant.advance(dt); }
};

/// A sheet that can be pushed and watched, simulated or real.
///
/// Axioms: after `advance` reports `advanced`, positions and velocities are those dt later; when it does not, they are
/// as before; with equal state and input, equal results (simulated plants).
template <class Plant, class Scalar = double>
concept ClothPlant = RealScalar<Scalar> &&
    requires(Plant& plant, const Plant& watched, const ClothInput<Scalar>& input, Scalar dt) {
  { plant_traits<Plant>::vertex_count(watched) } -> std::convertible_to<Index>;
  { plant_traits<Plant>::positions(watched) } -> std::convertible_to<PointsView<Scalar>>;
  { plant_traits<Plant>::velocities(watched) } -> std::convertible_to<PointsView<Scalar>>;
  plant_traits<Plant>::apply(plant, input);
  { plant_traits<Plant>::advance(plant, dt) } -> std::same_as<StepReport<Scalar>>;
};

/// How a type acts as a cloth model. The primary forwards to members of the same names.
template <class Model>
struct cloth_traits {
  /// Number of vertices.
  static Index vertex_count(const Model& model) requires requires { model.vertex_count(); }
  { return model.vertex_count(); }
  /// The undeformed sheet at rest. Allocates.
  static auto rest_state(const Model& model) requires requires { model.rest_state(); }
  { return model.rest_state(); }
  /// All scratch memory of a step, made once. Allocates.
  static auto make_workspace(const Model& model) requires requires { model.make_workspace(); }
  { return model.make_workspace(); }
  /// Advances `state` by `dt`. Never allocates.
  template <class State, class Input, class Scalar, class Workspace>
  requires requires(const Model& m, State& s, const Input& i, Scalar h, Workspace& w) { m.step(s, i, h, w); }
  static auto step(const Model& model, State& state, const Input& input, Scalar dt, Workspace& workspace) {
    return model.step(state, input, dt, workspace);
  }
};

/// A simulator with a const model, a state that is a value and a workspace of its own.
///
/// Axioms: `step` depends on model, state, input and dt alone (the workspace carries no history that matters); a step
/// that does not report `advanced` leaves the state bitwise as it was; one model serves many threads, each with its own
/// state and workspace. `ModelPlant` makes a ClothPlant of any ClothModel.
template <class Model, class Scalar = double>
concept ClothModel = RealScalar<Scalar> && requires(const Model& model, const ClothInput<Scalar>& input, Scalar dt) {
  { cloth_traits<Model>::vertex_count(model) } -> std::convertible_to<Index>;
  { cloth_traits<Model>::rest_state(model) } -> std::same_as<ClothState<Scalar>>;
  cloth_traits<Model>::make_workspace(model);
  requires requires(ClothState<Scalar> & state, decltype(cloth_traits<Model>::make_workspace(model))& workspace) {
    { cloth_traits<Model>::step(model, state, input, dt, workspace) } -> std::same_as<StepReport<Scalar>>;
  };
};

}  // namespace clothctl
