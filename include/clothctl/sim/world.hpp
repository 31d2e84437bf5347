#pragma once

// Sheets, hands, rigid bodies and obstacles in one step h:
//
//   1. bodies   free velocities, and their contacts (sim/rigid_bodies.hpp)
//      hands    torques of their controllers, and free velocities (sim/hand_setup.hpp)
//   2. sheets   each with its contacts with obstacles, links of hands and bodies, which move with
//               their free velocities (contact/obstacle_contacts.hpp). Bodies and hands receive the
//               opposite impulses.
//               Mass-spring sheets expect of pads what they did in the last step.
//   3. pads     the contacts of soft pads with sheets, hands and bodies as sides of one problem,
//               each with the matrix of its step (contact/contact_solver.hpp). What they change at
//               the contacts of a mass-spring sheet with obstacles, the latter's sides receive.
//   4. layers   sheets that meet themselves or each other are kept apart
//               (contact/sheet_impacts.hpp)
//   5. bodies   contacts and joints; everything moves
//
// Sheets take the motion of a link for granted in 2, and it learns of them afterwards: that is
// sound as long as the part of a sheet that touches it weighs less. Where a body is too light for
// that, the step of the sheet is made again with other velocities of the body. Pads have no such
// bound.
//
// The world owns what is added to it, no thread and no main loop. The same calls give the same
// bits.

#include <cassert>
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/self_contacts.hpp"
#include "clothctl/concepts/colliding_cloth.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/sim/detail/world_step.hpp"
#include "clothctl/sim/world_setup.hpp"

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/cloth/mass_spring.hpp"  // what is compiled once
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#endif

namespace clothctl::inline CLOTHCTL_ABI {

/// A world of sheets, rigid bodies and obstacles.
///
/// Sheets, hands, bodies, obstacles and pads have numbers: each kind is counted from 0, in the
/// order in which they were added. What adds or sets something refuses a number that nothing has;
/// what reads something asserts that its number is between 0 and the count - 1.
template <RealScalar S>
class World {
 public:
  /// The scalar type.
  using Scalar = S;
  /// The settings.
  using Settings = WorldSettings<Scalar>;
  /// The set-up of a sheet.
  using SheetSetup = WorldSheetSetup<Scalar>;

  /// Makes an empty world. When a setting is wrong, every step returns InvalidInput.
  explicit World(const Settings& settings = {}) : step_(settings) {}

  /// Adds a sheet: a MassSpring, a PositionBased, or a model of yours (concept CollidingCloth), and
  /// its state. Returns its number. Allocates. Fails when: the set-up is not valid, the state is of
  /// another size or not finite, or the masses, pinned vertices or mesh of the model are not sound.
  template <class Model>
  requires CollidingCloth<Model, ObstacleContacts<S>, S> Result<int> add_sheet(
      Model model, ClothState<Scalar> state, const SheetSetup& setup = {});
  /// Adds an obstacle that may move, and returns its number. `surface` takes the place of the
  /// friction and the body number that the collider answers. Its motion goes on with its velocities
  /// until you set another (`set_motion`). Allocates. Fails when: `MovingCollider::create` does.
  template <Collider<S> C>
  Result<int> add_obstacle(C shape, const RigidMotion<Scalar>& motion = {},
                           const ColliderSurface<Scalar>& surface = {},
                           const CollisionGroups& groups = {});
  /// Adds a hand, or any robot, and returns its number. Allocates. Fails when: positions or
  /// velocities are of another size than the model's or not finite, or `StablePd::create` does.
  template <class Model>
  requires ArticulatedDynamics<Model, S> Result<int> add_hand(Model model,
                                                              const HandSetup<Scalar>& setup);
  /// Adds an obstacle that a link of a hand carries, with the frame of the link, and returns its
  /// number. Impulses on it act on the hand. Allocates. Fails when: the hand or the frame does not
  /// exist, or `MovingCollider::create` does.
  template <Collider<S> C>
  Result<int> add_link_shape(int hand, int frame, C shape,
                             const ColliderSurface<Scalar>& surface = {},
                             const CollisionGroups& groups = {});
  /// Returns an empty string, or why `add_link_shape` would refuse any shape there. Allocates.
  std::string check_link_shape(int hand, int frame,
                               const ColliderSurface<Scalar>& surface = {}) const;
  /// Adds a soft pad to an obstacle, or to body b with `carrier` -1 - b, and returns its number.
  /// Samples are in the frame of the carrier. What carries pads touches sheets with its pads only.
  /// Allocates. Fails when: the carrier does not exist, or samples or settings are not valid.
  Result<int> add_pad(int carrier, std::vector<PadSample<Scalar>> samples,
                      const PadSettings<Scalar>& settings = {});
  /// Adds a body (RigidBodies::add) and returns its number. Allocates.
  Result<int> add_body(const RigidBodySetup<Scalar>& setup);
  /// The bodies: add joints, read and set their motion, read contacts and events. Add bodies to the
  /// world, not here.
  RigidBodies<Scalar>& bodies() { return step_.parts.bodies; }
  /// The bodies.
  const RigidBodies<Scalar>& bodies() const { return step_.parts.bodies; }

  /// Advances everything by `dt` (s), 1e-9 to 1000. Driven vertices of the inputs go straight to
  /// their positions. Allocates only in the first step after something was added. Fails when: see
  /// WorldReport; `check_input` says why an input was refused.
  [[nodiscard]] WorldReport<Scalar> step(const Scalar& dt, const ExecutorRef& executor = {}) {
    return step_.step(dt, executor);
  }

  /// Returns an empty string, or why every step returns InvalidInput: a setting, or parts that do
  /// not go together, such as pads on a sheet whose model makes no factor of its step. Allocates.
  std::string check_setup() { return step_.check_setup(); }
  /// Returns an empty string, or why a step of `dt` (s) returns InvalidInput: what `check_setup`
  /// returns, the step length, or an entry of a sheet's input or a hand's drive, with its index and
  /// value. Allocates. Complexity: O(vertices).
  std::string check_input(const Scalar& dt) { return step_.check_input(dt); }

  /// Number of sheets.
  int sheet_count() const { return static_cast<int>(step_.parts.sheets.size()); }
  /// Number of obstacles.
  int obstacle_count() const { return static_cast<int>(step_.parts.obstacles.size()); }
  /// Number of hands.
  int hand_count() const { return static_cast<int>(step_.parts.hands.size()); }
  /// Number of pads.
  int pad_count() const { return step_.grips.pad_count(); }
  /// What carries a pad: an obstacle, or -1 - b for body b.
  int pad_carrier(int pad) const { return step_.grips.carrier(pad); }
  /// What a hand is to do in the steps to come; change it at will.
  HandDrive<Scalar>& drive(int hand) { return item(step_.parts.hands, hand)->drive; }
  /// Positions and velocities of a hand.
  const HandState<Scalar>& hand(int hand) const { return item(step_.parts.hands, hand)->state; }
  /// What the motors of a hand exerted (nv) in the last step (its last part): its controller, with
  /// its answer to contact, and the torques of its drive.
  const VectorX<Scalar>& torques(int hand) const { return item(step_.parts.hands, hand)->torques; }
  /// Puts a hand elsewhere. Returns an empty string, or what is wrong (there is no such hand, a
  /// size or a value of the state); nothing changes then.
  std::string set_hand(int hand, const HandState<Scalar>& state);
  /// The contacts of a pad in the last part of the last step, with their impulses in all of it.
  std::span<const PadContact<Scalar>> pad_contacts(int pad) const {
    return step_.grips.contacts(pad);
  }
  /// The input of a sheet in the steps to come; change it at will.
  ClothInput<Scalar>& input(int sheet) { return item(step_.parts.sheets, sheet)->input; }
  /// The state of a sheet.
  const ClothState<Scalar>& state(int sheet) const {
    return item(step_.parts.sheets, sheet)->state;
  }
  /// Puts a sheet elsewhere; its contacts are forgotten. Returns an empty string, or what is wrong
  /// (there is no such sheet, a size, or a vertex and its value); nothing changes then.
  std::string set_state(int sheet, const ClothState<Scalar>& state);
  /// The contacts of a sheet in the last step (its last part): `obstacle` is the number of an
  /// obstacle, or -1 - b for body b.
  std::span<const ObstacleContact<Scalar>> contacts(int sheet) const {
    return item(step_.contacts, sheet);
  }
  /// The length of the part of the last step that `contacts` and `torques` tell of, s: all of it
  /// where the world did not divide it; 0 before any step.
  const Scalar& last_part() const { return step_.last_part; }
  /// The motion of an obstacle.
  const RigidMotion<Scalar>& motion(int obstacle) const {
    return item(step_.parts.obstacles, obstacle)->motion();
  }
  /// Gives an obstacle its pose at the start of the next step, and velocities that hold within it
  /// and go on after it. (A shape on a link goes where the link does.) Returns an empty string, or
  /// what is wrong (there is no such obstacle, or a number of the motion); nothing changes then.
  std::string set_motion(int obstacle, const RigidMotion<Scalar>& motion);

 private:
  /// Returns element i, which must be there.
  template <class List>
  static auto& item(List& list, int i) {
    assert(has(list, i));
    return list[static_cast<std::size_t>(i)];
  }
  template <class List>
  static bool has(const List& list, int i) {
    return i >= 0 && static_cast<std::size_t>(i) < list.size();
  }

  detail::WorldStep<Scalar> step_;
};

template <RealScalar S>
template <class Model>
requires CollidingCloth<Model, ObstacleContacts<S>, S> Result<int> World<S>::add_sheet(
    Model model, ClothState<Scalar> state, const SheetSetup& setup) {
  const std::string name = "sheet " + std::to_string(step_.parts.sheets.size());
  if (const std::string bad = setup.validate(); !bad.empty()) return Error{name + " has " + bad};
  auto mesh = detail::SheetMesh<Scalar>::of(model);
  const Index n = mesh.vertex_count();
  std::string bad = mesh.validate();
  if (bad.empty()) bad = check_state(state, n);
  if (bad.empty()) bad = detail::validate_pairs("joined pair", setup.joined, n);
  if (!bad.empty()) return Error{name + ": " + bad};
  if (setup.meets_sheets) {
    const Result<SelfContactFinder<Scalar>> itself = SelfContactFinder<Scalar>::create(
        mesh.rest_positions, mesh.triangles, {}, {setup.thickness, setup.joined});
    if (!itself) return Error{name + ": " + itself.error()};
  }
  SheetContactSettings<Scalar> inside;
  inside.smooth_gain = Scalar(0.5) * setup.thickness;
  Result<SheetContactFinder<Scalar>> finder = SheetContactFinder<Scalar>::create(
      mesh.rest_positions, mesh.triangles, mesh.rope_segments, inside);
  if (!finder) return Error{name + ": " + finder.error()};
  ObstacleContactSettings<Scalar> touch;
  touch.thickness = Scalar(0.5) * setup.thickness;
  if (!(touch.thickness < touch.reach)) touch.reach = Scalar(2) * touch.thickness;
  const Index room = setup.contacts > 0 ? setup.contacts : 4 * n;
  Result<ObstacleContacts<Scalar>> contacts = ObstacleContacts<Scalar>::create(room, touch);
  if (!contacts) return Error{name + ": " + contacts.error()};
  step_.parts.sheets.push_back(std::make_unique<detail::WorldSheetOf<Model, Scalar>>(
      std::move(model), std::move(mesh), std::move(state), std::move(finder).value(),
      std::move(contacts).value(), room));
  step_.parts.setups.push_back(setup);
  step_.contacts.emplace_back().reserve(static_cast<std::size_t>(room));
  step_.prepared = false;
  return static_cast<int>(step_.parts.sheets.size()) - 1;
}

template <RealScalar S>
template <Collider<S> C>
Result<int> World<S>::add_obstacle(C shape, const RigidMotion<Scalar>& motion,
                                   const ColliderSurface<Scalar>& surface,
                                   const CollisionGroups& groups) {
  Result<MovingCollider<Scalar, C>> moving =
      MovingCollider<Scalar, C>::create(std::move(shape), motion, surface);
  if (!moving) return Error{"obstacle " + std::to_string(obstacle_count()) + ": " + moving.error()};
  auto obstacle = std::make_unique<detail::WorldObstacleOf<Scalar, C>>(std::move(moving).value());
  obstacle->groups = groups;
  Result<int> added = step_.parts.bodies.add_obstacle(obstacle->collider(), Scalar(0), groups);
  if (!added) return added;
  step_.parts.obstacles.push_back(std::move(obstacle));
  step_.prepared = false;
  return static_cast<int>(step_.parts.obstacles.size()) - 1;
}

template <RealScalar S>
template <class Model>
requires ArticulatedDynamics<Model, S> Result<int> World<S>::add_hand(
    Model model, const HandSetup<Scalar>& setup) {
  using Traits = articulated_traits<Model>;
  const std::string name = "hand " + std::to_string(step_.parts.hands.size());
  const Index nq = Traits::nq(model), nv = Traits::nv(model);
  std::string bad = detail::find_bad_entry("positions", setup.positions, nq);
  if (bad.empty() && setup.velocities.size() > 0)
    bad = detail::find_bad_entry("velocities", setup.velocities, nv);
  if (!bad.empty()) return Error{name + " has " + bad};
  Result<StablePd<Model, Scalar>> pd = StablePd<Model, Scalar>::create(model, setup.control);
  if (!pd) return Error{name + ": " + pd.error()};
  step_.parts.hands.push_back(std::make_unique<detail::WorldHandOf<Model, Scalar>>(
      std::move(model), std::move(pd).value(), setup));
  step_.prepared = false;
  return hand_count() - 1;
}

template <RealScalar S>
template <Collider<S> C>
Result<int> World<S>::add_link_shape(int hand, int frame, C shape,
                                     const ColliderSurface<Scalar>& surface,
                                     const CollisionGroups& groups) {
  if (std::string bad = check_link_shape(hand, frame, surface); !bad.empty()) return Error{bad};
  detail::WorldHand<Scalar>& carrier = *item(step_.parts.hands, hand);
  Result<int> added = add_obstacle(std::move(shape), carrier.frame_motion(frame), surface, groups);
  if (!added) return added;
  step_.parts.obstacles.back()->hand = hand;
  step_.parts.obstacles.back()->frame = frame;
  return added;
}

template <RealScalar S>
std::string World<S>::check_link_shape(int hand, int frame,
                                       const ColliderSurface<Scalar>& surface) const {
  if (!has(step_.parts.hands, hand)) return missing_item_line("hand", hand, hand_count());
  if (!item(step_.parts.hands, hand)->has_frame(frame))
    return "hand " + std::to_string(hand) + " has no frame " + std::to_string(frame);
  const std::string bad = surface.validate();
  return bad.empty() ? bad : "obstacle " + std::to_string(obstacle_count()) + ": " + bad;
}

template <RealScalar S>
Result<int> World<S>::add_pad(int carrier, std::vector<PadSample<Scalar>> samples,
                              const PadSettings<Scalar>& settings) {
  const std::string name = "pad " + std::to_string(pad_count());
  const int bodies = step_.parts.bodies.body_count();
  if (carrier >= obstacle_count())
    return Error{name + ": " + missing_item_line("obstacle", carrier, obstacle_count())};
  if (-1 - carrier >= bodies)
    return Error{name + ": " + missing_item_line("body", -1 - carrier, bodies)};
  std::string bad = validate_pad_samples<Scalar>(samples);
  if (bad.empty()) bad = settings.validate();
  if (!bad.empty()) return Error{name + " has " + bad};
  step_.prepared = false;
  return step_.grips.add({carrier, std::move(samples), settings});
}

template <RealScalar S>
std::string World<S>::set_hand(int hand, const HandState<Scalar>& state) {
  if (!has(step_.parts.hands, hand)) return missing_item_line("hand", hand, hand_count());
  detail::WorldHand<Scalar>& now = *item(step_.parts.hands, hand);
  if (const std::string bad = now.check_state(state); !bad.empty())
    return "hand " + std::to_string(hand) + " has " + bad;
  now.state = state;
  now.update_frames();
  step_.move_links();
  return {};
}

template <RealScalar S>
Result<int> World<S>::add_body(const RigidBodySetup<Scalar>& setup) {
  Result<int> added = step_.parts.bodies.add(setup);
  if (!added) return added;
  step_.parts.body_groups.push_back(setup.groups);
  step_.prepared = false;
  return added;
}

template <RealScalar S>
std::string World<S>::set_state(int sheet, const ClothState<Scalar>& state) {
  if (!has(step_.parts.sheets, sheet)) return missing_item_line("sheet", sheet, sheet_count());
  detail::WorldSheet<Scalar>& s = *item(step_.parts.sheets, sheet);
  if (const std::string bad = check_state(state, s.state.positions.cols()); !bad.empty())
    return "sheet " + std::to_string(sheet) + ": " + bad;
  s.state = state;
  s.contacts.clear();
  return {};
}

template <RealScalar S>
std::string World<S>::set_motion(int obstacle, const RigidMotion<Scalar>& motion) {
  if (!has(step_.parts.obstacles, obstacle))
    return missing_item_line("obstacle", obstacle, obstacle_count());
  if (const std::string bad = item(step_.parts.obstacles, obstacle)->set_motion(motion);
      !bad.empty())
    return "obstacle " + std::to_string(obstacle) + " has " + bad;
  step_.parts.bodies.wake_all();
  return {};
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp): a world with the sheets and
// robots of this library.
CLOTHCTL_INSTANTIATE(class detail::CarryingSide<PositionBased<double>>);
CLOTHCTL_INSTANTIATE(class detail::WorldGrips<double>);
CLOTHCTL_INSTANTIATE(class detail::WorldLayers<double>);
CLOTHCTL_INSTANTIATE(class detail::WorldStep<double>);
CLOTHCTL_INSTANTIATE(class World<double>);
CLOTHCTL_INSTANTIATE(Result<int> World<double>::add_sheet(MassSpring<double>, ClothState<double>,
                                                          const WorldSheetSetup<double>&));
CLOTHCTL_INSTANTIATE(Result<int> World<double>::add_sheet(PositionBased<double>, ClothState<double>,
                                                          const WorldSheetSetup<double>&));
CLOTHCTL_INSTANTIATE(Result<int> World<double>::add_hand(KinematicTree<double>,
                                                         const HandSetup<double>&));

}  // namespace clothctl::inline CLOTHCTL_ABI
