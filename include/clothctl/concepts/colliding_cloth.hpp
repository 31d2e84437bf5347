#pragma once

// CollidingCloth: a ClothModel whose step can keep it out of obstacles, as a World needs it. It is
// checked through a trait, so that a type of another library takes part unchanged.

#include <array>
#include <concepts>
#include <vector>

#include "clothctl/concepts/cloth.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a type acts as a cloth model that collides. The primary template forwards to members as
/// those of MassSpring and PositionBased: `make_workspace` and `step` with contacts, `network()`
/// and `settings()`.
template <class Model>
struct colliding_cloth_traits {
  /// Returns the scratch memory of a step with at most `contacts` contacts. Allocates.
  static auto make_workspace(const Model& model, Index contacts) requires requires {
    model.make_workspace(contacts);
  }
  { return model.make_workspace(contacts); }
  /// Advances `state` by `dt` (s), keeps its points on their side of the obstacles in `contacts`
  /// (ObstacleContacts, contact/obstacle_contacts.hpp), and writes impulse and state of each, and
  /// their report. Never allocates.
  template <class State, class Input, class Contacts, class Scalar, class Workspace>
  requires requires(const Model& m, State& s, const Input& i, Contacts& c, Scalar h, Workspace& w) {
    m.step(s, i, c, h, w);
  }
  static auto step(const Model& model, State& state, const Input& input, Contacts& contacts,
                   Scalar dt, Workspace& workspace) {
    return model.step(state, input, contacts, dt, workspace);
  }
  /// Returns the masses of the vertices, n, positive, kg.
  static decltype(auto) masses(const Model& model) requires requires { model.network().mass; }
  { return (model.network().mass); }
  /// Returns the triangles, three vertices each; none for a rope.
  static decltype(auto) triangles(const Model& model) requires requires {
    model.network().triangles;
  }
  { return (model.network().triangles); }
  /// Returns the vertices that never move. Optional.
  static decltype(auto) pinned(const Model& model) requires requires { model.settings().pinned; }
  { return (model.settings().pinned); }
  /// Returns pairs of vertices: edges on no triangle that may touch between their ends. Optional.
  static auto rope_segments(const Model& model) requires requires {
    model.network().rope_segments();
  }
  { return model.network().rope_segments(); }
};

/// A ClothModel whose step takes contacts with obstacles: the type `Contacts`, for a World
/// `ObstacleContacts<Scalar>`.
///
/// Axioms: a step without contacts ends as that of the ClothModel does; the momentum of the sheet
/// changes by the impulses that it writes, besides what acts on it without contacts; an impulse
/// pushes out of the obstacle, never pulls; a step that does not report `advanced` leaves the state
/// bitwise as it was; masses, triangles and pinned vertices stay as they are.
///
/// Optional hooks: `pinned(model)` and `rope_segments(model)`; without them nothing is pinned, and
/// vertices on no triangle touch by themselves alone.
template <class Model, class Contacts, class Scalar = double>
concept CollidingCloth = ClothModel<Model, Scalar> &&
    requires(const Model& model, const ClothInput<Scalar>& input, Contacts& contacts, Scalar dt,
             Index room) {
  { colliding_cloth_traits<Model>::masses(model) } -> std::convertible_to<VectorX<Scalar>>;
  {
    colliding_cloth_traits<Model>::triangles(model)
    } -> std::convertible_to<std::vector<std::array<int, 3>>>;
  colliding_cloth_traits<Model>::make_workspace(model, room);
  requires requires(
      ClothState<Scalar> & state,
      decltype(colliding_cloth_traits<Model>::make_workspace(model, room))& workspace) {
    {
      colliding_cloth_traits<Model>::step(model, state, input, contacts, dt, workspace)
      } -> std::same_as<StepReport<Scalar>>;
  };
};

}  // namespace clothctl::inline CLOTHCTL_ABI
