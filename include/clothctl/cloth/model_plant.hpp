#pragma once

// A plant made of a model, its state and its workspace.

#include <string>
#include <utility>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/core/step_input.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Makes a ClothPlant of any ClothModel. It owns the model, the state, the workspace and the input
/// that was applied last. For a model type without a member type `Scalar`, name the scalar as `S`.
template <class Model, RealScalar S = typename Model::Scalar>
requires ClothModel<Model, S>
class ModelPlant {
 public:
  /// The scalar type.
  using Scalar = S;

  /// Starts at the rest state of the model. Allocates.
  explicit ModelPlant(Model model)
      : model_(std::move(model)),
        state_(cloth_traits<Model>::rest_state(model_)),
        workspace_(cloth_traits<Model>::make_workspace(model_)) {}

  /// Returns the model.
  const Model& model() const { return model_; }
  /// Returns the model, to change its settings between steps. If you replace it by a model that the
  /// workspace does not fit, `advance` reports InvalidWorkspace; `set_model` makes one that does.
  Model& model() { return model_; }
  /// Returns the state.
  const ClothState<Scalar>& state() const { return state_; }
  /// Replaces the model and makes a workspace for it. State and input stay: the caller sets those
  /// that belong to the new model. Allocates.
  void set_model(Model model) {
    model_ = std::move(model);
    workspace_ = cloth_traits<Model>::make_workspace(model_);
  }
  /// Replaces the state. `advance` reports InvalidState when its size is wrong.
  void set_state(const ClothState<Scalar>& state) { state_ = state; }

  /// Returns the number of vertices.
  Index vertex_count() const { return cloth_traits<Model>::vertex_count(model_); }
  /// Returns the vertex positions, 3×n, m.
  const Points<Scalar>& positions() const { return state_.positions; }
  /// Returns the vertex velocities, 3×n, m/s.
  const Points<Scalar>& velocities() const { return state_.velocities; }
  /// Sets what acts on the sheet from now on. Allocates when the input has more entries than
  /// before.
  void apply(const ClothInput<Scalar>& input) { input_ = input; }
  /// Returns the input that was applied last.
  const ClothInput<Scalar>& input() const { return input_; }
  /// Returns the upward force (3-vector, N) that holds the sheet at rest: minus its weight, by the
  /// masses and the gravity of the model. A controller takes it as its gravity load, for example
  /// PlannerSettings::gravity_load. Exists for models whose `cloth_traits` have that hook
  /// (MassSpring, PositionBased).
  Vector3<Scalar> gravity_load() const requires requires(const Model& m) {
    cloth_traits<Model>::gravity_load(m);
  }
  { return cloth_traits<Model>::gravity_load(model_); }
  /// Returns why `advance(dt)` would refuse its arguments: one line that names the item, its index
  /// and the bad value. Returns an empty string when they are good. Allocates. Complexity: O(n).
  std::string check_input(Scalar dt) const {
    if constexpr (requires { model_.check_input(state_, input_, dt, workspace_); }) {
      return model_.check_input(state_, input_, dt, workspace_);
    } else {
      return check_step_input(state_, input_, dt, vertex_count());
    }
  }
  /// Advances by `dt` (s) under the input that was applied last. Never allocates. Fails when the
  /// step of the model fails; the state is then unchanged, and `check_input` says why.
  [[nodiscard]] StepReport<Scalar> advance(Scalar dt) {
    return cloth_traits<Model>::step(model_, state_, input_, dt, workspace_);
  }

 private:
  Model model_;
  ClothState<Scalar> state_;
  decltype(cloth_traits<Model>::make_workspace(std::declval<const Model&>())) workspace_;
  ClothInput<Scalar> input_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
