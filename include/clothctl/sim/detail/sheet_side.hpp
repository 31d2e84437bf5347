#pragma once

// How a sheet within a world answers to the impulses of pads, after its step. A model that names a
// type `Impulses`, as MassSpring does, answers through the matrix of its step; one whose step can
// carry vertices, as that of PositionBased, with what pads hold as rigid patches
// (carrying_side.hpp); any other with the masses of its touched vertices alone, and its own sweeps
// of the next step spread what they got.

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/contact/impulse_responses.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/sim/detail/carrying_side.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A side that does not carry what pads hold.
template <RealScalar Scalar>
class FreeSide {
 public:
  /// What patches are found by: none are.
  const VertexNeighbours<Scalar>* neighbours() const { return nullptr; }
  /// Before and after the sheet's step: nothing.
  template <class Workspace>
  void carry(const GripPatches<Scalar>&, const ClothState<Scalar>&, Workspace&) {}
  void hold(VectorX<Scalar>&) const {}
  template <class Model, class Workspace>
  void release(const Model&, const ClothInput<Scalar>&, const Scalar&, const Workspace&) {}
};

/// The answer of a sheet by the masses of its vertices.
template <class Model, RealScalar Scalar>
class SheetSide : public FreeSide<Scalar> {
 public:
  /// Makes room for `capacity` touched vertices. Allocates. Returns an empty string, or why it
  /// cannot.
  std::string create(const Model& model, Index capacity) {
    const Index n = cloth_traits<Model>::vertex_count(model);
    response_ = ParticleResponse<Scalar>(capacity);
    point_.assign(static_cast<std::size_t>(n), -1);
    touched_.reserve(static_cast<std::size_t>(capacity));
    return {};
  }
  /// Takes the vertices that are touched in a step that ended with `state`, and the inverse masses
  /// of all in it.
  template <class Workspace>
  StepStatus attach(std::span<const int> vertices, ClothState<Scalar>& state, Workspace&,
                    const VectorX<Scalar>& inverse_masses) {
    for (const int v : touched_) point_[static_cast<std::size_t>(v)] = -1;
    touched_.assign(vertices.begin(), vertices.end());
    for (std::size_t i = 0; i < touched_.size(); ++i)
      point_[static_cast<std::size_t>(touched_[i])] = static_cast<int>(i);
    state_ = &state;
    const QueryStatus status = response_.gather(vertices, inverse_masses, state.velocities);
    return status == QueryStatus::Answered ? StepStatus::Converged : StepStatus::InvalidState;
  }
  int point(int vertex) const { return point_[static_cast<std::size_t>(vertex)]; }
  ImpulseResponseRef<Scalar> side() { return ImpulseResponseRef<Scalar>(response_); }
  /// Moves the vertices by what the impulses changed in a step of `dt` s.
  template <class Workspace>
  void take(const Scalar& dt, bool, const Workspace&) {
    for (const int v : touched_) state_->positions.col(v) -= dt * state_->velocities.col(v);
    (void)response_.scatter(touched_, state_->velocities);
    for (const int v : touched_) state_->positions.col(v) += dt * state_->velocities.col(v);
  }

 private:
  ParticleResponse<Scalar> response_;
  std::vector<int> touched_, point_;
  ClothState<Scalar>* state_ = nullptr;
};

/// The answer of a sheet with patches.
template <CarryingModel Model, RealScalar Scalar>
class SheetSide<Model, Scalar> : public CarryingSide<Model> {};

/// The answer of a sheet by its step matrix.
template <class Model, RealScalar Scalar>
requires requires { typename Model::Impulses; }
class SheetSide<Model, Scalar> : public FreeSide<Scalar> {
 public:
  std::string create(const Model& model, Index capacity) {
    Result<typename Model::Impulses> made = Model::Impulses::create(model, capacity);
    if (!made) return made.error();
    impulses_.emplace(std::move(made).value());
    return {};
  }
  StepStatus attach(std::span<const int> vertices, ClothState<Scalar>& state,
                    typename Model::Workspace& ws, const VectorX<Scalar>&) {
    return impulses_->attach(vertices, state, ws);
  }
  void expect(std::span<const int> vertices, const PointsView<Scalar>& impulses,
              typename Model::Workspace& ws) {
    if (impulses_) (void)impulses_->expect(vertices, impulses, ws);
  }
  int point(int vertex) const { return impulses_->point(vertex); }
  ImpulseResponseRef<Scalar> side() { return ImpulseResponseRef<Scalar>(*impulses_); }
  void take(const Scalar&, bool, const typename Model::Workspace&) {}
  /// Gives the contacts of the step what they exert since then.
  template <class More>
  void update_contacts(ObstacleContacts<Scalar>& contacts, More more) const {
    impulses_->update_contacts(contacts, more);
  }

 private:
  std::optional<typename Model::Impulses> impulses_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
