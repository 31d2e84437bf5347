#pragma once

// The least type that satisfies ClothRollout: masses without springs. They fall freely unless they
// are driven. The type can be moved and nothing else.

#include <span>
#include <vector>

#include "clothctl/concepts/cloth.hpp"

namespace clothctl_test {

/// A type with only what ClothModel and ClothRollout name. Every mass is 0.1 kg.
template <class Scalar>
class ClothRolloutArchetype {
 public:
  /// Scratch memory that can only be moved: the forces of the last step.
  class Scratch {
   public:
    Scratch(Scratch&&) = default;
    Scratch& operator=(Scratch&&) = default;

   private:
    friend ClothRolloutArchetype;
    explicit Scratch(clothctl::Index n)
        : force(clothctl::Points<Scalar>::Zero(3, n)), before(force), needed(force) {}
    clothctl::Points<Scalar> force, before, needed;
  };
  using State = clothctl::ClothState<Scalar>;
  using Input = clothctl::ClothInput<Scalar>;
  using Report = clothctl::StepReport<Scalar>;

  explicit ClothRolloutArchetype(clothctl::Index vertices) : vertices_(vertices) {}
  ClothRolloutArchetype(ClothRolloutArchetype&&) = default;
  ClothRolloutArchetype& operator=(ClothRolloutArchetype&&) = default;

  int vertex_count() const { return static_cast<int>(vertices_); }
  State rest_state() const {
    return {clothctl::Points<Scalar>::Zero(3, vertices_),
            clothctl::Points<Scalar>::Zero(3, vertices_)};
  }
  Scratch make_workspace() const { return Scratch(vertices_); }
  Report step(State& state, const Input& input, Scalar dt, Scratch& ws) const {
    if (!(Scalar(0) < dt)) return {clothctl::StepStatus::InvalidInput, false, Scalar(0), 0};
    ws.force.setZero();
    ws.force.row(2).setConstant(Scalar(-0.981));
    for (std::size_t i = 0; i < input.force_vertices.size(); ++i)
      ws.force.col(input.force_vertices[i]) += input.forces.col(static_cast<clothctl::Index>(i));
    ws.before = state.velocities;
    state.velocities += dt / Scalar(0.1) * ws.force;
    for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
      const clothctl::Index v = input.driven_vertices[i], j = static_cast<clothctl::Index>(i);
      state.velocities.col(v) = (input.driven_positions.col(j) - state.positions.col(v)) / dt;
    }
    state.positions += dt * state.velocities;
    ws.needed = Scalar(0.1) / dt * (state.velocities - ws.before) - ws.force;
    return {clothctl::StepStatus::Converged, true, Scalar(0), 1};
  }
  /// The step is linear, so the guess does not change its result.
  Report step_from(const clothctl::PointsView<Scalar>&, int, State& state, const Input& input,
                   Scalar dt, Scratch& ws, Scalar) const {
    return step(state, input, dt, ws);
  }
  void holding_forces(std::span<const int> vertices, Scratch& ws,
                      clothctl::Points<Scalar>& forces) const {
    for (std::size_t j = 0; j < vertices.size(); ++j)
      forces.col(static_cast<clothctl::Index>(j)) = ws.needed.col(vertices[j]);
  }

 private:
  clothctl::Index vertices_;
};

}  // namespace clothctl_test
