#pragma once

// A model, its state and its workspace bundled into a plant.

#include <utility>

#include "clothctl/concepts/cloth.hpp"

namespace clothctl {

/// Makes a ClothPlant of any ClothModel: owns model, state, workspace and the input that was applied last. A model type
/// without a member `Scalar` names it in `S`.
template <class Model, RealScalar S = typename Model::Scalar>
requires ClothModel<Model, S>
class ModelPlant {
 public:
  /// The scalar type.
  using Scalar = S;

  /// Starts at the model's rest state. Allocates.
  explicit ModelPlant(Model model)
      : model_(std::move(model)),
        state_(cloth_traits<Model>::rest_state(model_)),
        workspace_(cloth_traits<Model>::make_workspace(model_)) {}

  /// The model.
  const Model& model() const { return model_; }
  /// The model, for changing its settings between steps.
  Model& model() { return model_; }
  /// The state.
  const ClothState<Scalar>& state() const { return state_; }
  /// Replaces the state; a state of another size is refused by the next step.
  void set_state(const ClothState<Scalar>& state) { state_ = state; }

  /// Number of vertices.
  Index vertex_count() const { return cloth_traits<Model>::vertex_count(model_); }
  /// Vertex positions, 3×n, m.
  const Points<Scalar>& positions() const { return state_.positions; }
  /// Vertex velocities, 3×n, m/s.
  const Points<Scalar>& velocities() const { return state_.velocities; }
  /// Sets what acts on the sheet from now on. Allocates when the lists grow.
  void apply(const ClothInput<Scalar>& input) { input_ = input; }
  /// Advances by `dt` seconds under the input that was applied last. Never allocates. Fails when: the model's step does; the
  /// state is then as it was.
  [[nodiscard]] StepReport<Scalar> advance(Scalar dt) {
    return cloth_traits<Model>::step(model_, state_, input_, dt, workspace_);
  }

 private:
  Model model_;
  ClothState<Scalar> state_;
  decltype(cloth_traits<Model>::make_workspace(std::declval<const Model&>())) workspace_;
  ClothInput<Scalar> input_;
};

}  // namespace clothctl
