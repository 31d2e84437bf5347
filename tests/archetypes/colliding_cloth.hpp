#pragma once

// The least type that satisfies CollidingCloth: masses without springs, which fall freely and stop
// at obstacles. The type can be moved and nothing else.

#include <array>
#include <utility>
#include <vector>

#include "clothctl/concepts/colliding_cloth.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"

namespace clothctl_test {

/// A type with only what ClothModel and CollidingCloth name. Every mass is 0.1 kg.
template <class Scalar>
class CollidingClothArchetype {
 public:
  /// Scratch memory that can only be moved.
  class Scratch {
   public:
    Scratch(Scratch&&) = default;
    Scratch& operator=(Scratch&&) = default;

   private:
    friend CollidingClothArchetype;
    Scratch() = default;
  };
  using State = clothctl::ClothState<Scalar>;
  using Input = clothctl::ClothInput<Scalar>;
  using Report = clothctl::StepReport<Scalar>;
  using Triangles = std::vector<std::array<int, 3>>;

  CollidingClothArchetype(clothctl::Points<Scalar> rest, Triangles triangles)
      : rest_(std::move(rest)), triangles_(std::move(triangles)) {}
  CollidingClothArchetype(CollidingClothArchetype&&) = default;
  CollidingClothArchetype& operator=(CollidingClothArchetype&&) = default;

  int vertex_count() const { return static_cast<int>(rest_.cols()); }
  State rest_state() const { return {rest_, clothctl::Points<Scalar>::Zero(3, rest_.cols())}; }
  Scratch make_workspace() const { return Scratch(); }
  Report step(State& state, const Input&, Scalar dt, Scratch&) const {
    if (!(Scalar(0) < dt)) return {clothctl::StepStatus::InvalidInput, false, Scalar(0), 0};
    state.velocities.row(2).array() -= Scalar(9.81) * dt;
    state.positions += dt * state.velocities;
    return {clothctl::StepStatus::Converged, true, Scalar(0), 1};
  }
  /// What the traits read.
  const Triangles& triangles() const { return triangles_; }
  clothctl::VectorX<Scalar> masses() const {
    return clothctl::VectorX<Scalar>::Constant(rest_.cols(), Scalar(0.1));
  }
  /// Stops each vertex at the surface, without friction.
  static void stop(State& state, clothctl::ObstacleContacts<Scalar>& contacts, Scalar dt) {
    for (clothctl::ObstacleContact<Scalar>& c : contacts.contacts()) {
      c.impulse.setZero();
      c.state = clothctl::ContactState::Open;
      if (c.point.vertex_count() != 1) continue;
      const clothctl::Index v = c.point.vertex[0];
      const auto& there = c.point.surface;
      const Scalar depth =
          contacts.settings().thickness - c.point.slack -
          there.normal.dot(state.positions.col(v) - there.point - dt * there.velocity);
      if (!(Scalar(0) < depth)) continue;
      state.positions.col(v) += depth * there.normal;
      state.velocities.col(v) += depth / dt * there.normal;
      c.impulse = Scalar(0.1) * depth / dt * there.normal;
      c.state = clothctl::ContactState::Slip;
      ++c.age;
      ++contacts.report().closed;
    }
  }

 private:
  clothctl::Points<Scalar> rest_;
  Triangles triangles_;
};

}  // namespace clothctl_test

namespace clothctl {

template <class Scalar>
struct colliding_cloth_traits<clothctl_test::CollidingClothArchetype<Scalar>> {
  using Model = clothctl_test::CollidingClothArchetype<Scalar>;
  static typename Model::Scratch make_workspace(const Model& model, Index) {
    return model.make_workspace();
  }
  static StepReport<Scalar> step(const Model& model, ClothState<Scalar>& state,
                                 const ClothInput<Scalar>& input,
                                 ObstacleContacts<Scalar>& contacts, Scalar dt,
                                 typename Model::Scratch& workspace) {
    const StepReport<Scalar> report = model.step(state, input, dt, workspace);
    if (report.advanced) Model::stop(state, contacts, dt);
    return report;
  }
  static VectorX<Scalar> masses(const Model& model) { return model.masses(); }
  static const std::vector<std::array<int, 3>>& triangles(const Model& model) {
    return model.triangles();
  }
};

}  // namespace clothctl
