#pragma once

// Sheets, hands, rigid bodies and obstacles in one step h:
//
//   1. bodies   free velocities, and their contacts (sim/rigid_bodies.hpp)
//      hands    torques of their controllers, and free velocities (sim/hand_setup.hpp)
//   2. sheets   each with its contacts with obstacles, links of hands and bodies, which move with
//               their free velocities (contact/obstacle_contacts.hpp). Bodies and hands receive the
//               opposite impulses.
//   3. pads     the contacts of soft pads with sheets, hands and bodies as sides of one problem,
//               each with the matrix of its step (contact/contact_solver.hpp)
//   4. layers   sheets that meet themselves or each other are kept apart
//               (contact/sheet_impacts.hpp)
//   5. bodies   contacts and joints; everything moves
//
// A body or a link is as heavy as you like for the sheets in 2: it learns of them afterwards. That
// is sound as long as the part of a sheet that touches it weighs less. Pads have no such bound.
//
// The world owns what is added to it, no thread and no main loop. The same calls give the same
// bits.

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/sim/detail/world_step.hpp"
#include "clothctl/sim/world_setup.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A world of sheets, rigid bodies and obstacles.
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

  /// Adds a sheet: a MassSpring, a PositionBased, or any model like them, and its state. Returns
  /// its number. Allocates. Fails when: the set-up is not valid, the state is of another size or
  /// not finite, or the mesh of its network is not sound.
  template <class Model>
  Result<int> add_sheet(Model model, ClothState<Scalar> state, const SheetSetup& setup = {});
  /// Adds an obstacle that may move, and returns its number. Its motion goes on with its velocities
  /// until you set another. Allocates. Fails when: `MovingCollider::create` does.
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

  /// Advances everything by `dt` (s). Driven vertices of the inputs go straight to their positions.
  /// Allocates only in the first step after something was added.
  [[nodiscard]] WorldReport<Scalar> step(const Scalar& dt, const ExecutorRef& executor = {}) {
    return step_.step(dt, executor);
  }

  /// Returns an empty string, or why every step returns InvalidInput: a setting, or parts that do
  /// not go together, such as pads on a sheet whose model makes no factor of its step. Allocates.
  std::string check_setup() { return step_.check_setup(); }

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
  HandDrive<Scalar>& drive(int hand) { return step_.parts.hands[index(hand)]->drive; }
  /// Positions and velocities of a hand.
  const HandState<Scalar>& hand(int hand) const { return step_.parts.hands[index(hand)]->state; }
  /// The torques (nv) of a hand's controller in the last step, with its answer to contact.
  const VectorX<Scalar>& torques(int hand) const { return step_.parts.hands[index(hand)]->torques; }
  /// Puts a hand elsewhere. Returns false, and changes nothing, when the state is of another size
  /// or not finite.
  bool set_hand(int hand, const HandState<Scalar>& state);
  /// The contacts of a pad in the last step (its last part).
  std::span<const PadContact<Scalar>> pad_contacts(int pad) const {
    return step_.grips.contacts(pad);
  }
  /// The input of a sheet in the steps to come; change it at will.
  ClothInput<Scalar>& input(int sheet) { return at(sheet).input; }
  /// The state of a sheet.
  const ClothState<Scalar>& state(int sheet) const { return at(sheet).state; }
  /// Puts a sheet elsewhere; its contacts are forgotten. Returns false, and changes nothing, when
  /// the state is of another size or not finite.
  bool set_state(int sheet, const ClothState<Scalar>& state);
  /// The contacts of a sheet in the last step (its last part): `obstacle` is the number of an
  /// obstacle, or -1 - b for body b.
  std::span<const ObstacleContact<Scalar>> contacts(int sheet) const {
    return step_.contacts[index(sheet)];
  }
  /// The motion of an obstacle.
  const RigidMotion<Scalar>& motion(int obstacle) const {
    return step_.parts.obstacles[index(obstacle)]->motion();
  }
  /// Gives an obstacle a motion. Returns an empty string, or what is wrong.
  std::string set_motion(int obstacle, const RigidMotion<Scalar>& motion) {
    std::string bad = step_.parts.obstacles[index(obstacle)]->set_motion(motion);
    if (bad.empty()) step_.parts.bodies.wake_all();
    return bad;
  }

 private:
  using Sheet = detail::WorldSheet<Scalar>;

  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  Sheet& at(int sheet) { return *step_.parts.sheets[index(sheet)]; }
  const Sheet& at(int sheet) const { return *step_.parts.sheets[index(sheet)]; }

  detail::WorldStep<Scalar> step_;
};

template <RealScalar S>
template <class Model>
Result<int> World<S>::add_sheet(Model model, ClothState<Scalar> state, const SheetSetup& setup) {
  const std::string name = "sheet " + std::to_string(step_.parts.sheets.size());
  if (const std::string bad = setup.validate(); !bad.empty()) return Error{name + " has " + bad};
  const Index n = model.vertex_count();
  if (state.positions.cols() != n || state.velocities.cols() != n)
    return Error{name + ": the state is not of the " + std::to_string(n) +
                 " vertices of the model"};
  if (!all_finite(state.positions) || !all_finite(state.velocities))
    return Error{name + ": the state is not finite"};
  const SpringNetwork<Scalar>& network = model.network();
  if (setup.meets_sheets) {
    const Result<SelfContactFinder<Scalar>> itself = SelfContactFinder<Scalar>::create(
        network.rest_positions, network.triangles, {}, {setup.thickness, setup.joined});
    if (!itself) return Error{name + ": " + itself.error()};
  }
  SheetContactSettings<Scalar> inside;
  inside.smooth_gain = Scalar(0.5) * setup.thickness;
  Result<SheetContactFinder<Scalar>> finder = SheetContactFinder<Scalar>::create(
      network.rest_positions, network.triangles, detail::thread_edges(network), inside);
  if (!finder) return Error{name + ": " + finder.error()};
  ObstacleContactSettings<Scalar> touch;
  touch.thickness = Scalar(0.5) * setup.thickness;
  if (!(touch.thickness < touch.reach)) touch.reach = Scalar(2) * touch.thickness;
  const Index room = setup.contacts > 0 ? setup.contacts : 4 * n;
  Result<ObstacleContacts<Scalar>> contacts = ObstacleContacts<Scalar>::create(room, touch);
  if (!contacts) return Error{name + ": " + contacts.error()};
  step_.parts.sheets.push_back(std::make_unique<detail::WorldSheetOf<Model>>(
      std::move(model), std::move(state), std::move(finder).value(), std::move(contacts).value(),
      room));
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
  if (!moving) return Error{moving.error()};
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
  if (setup.positions.size() != nq || !all_finite(setup.positions))
    return Error{name + " needs " + std::to_string(nq) + " finite positions"};
  if (setup.velocities.size() > 0 &&
      (setup.velocities.size() != nv || !all_finite(setup.velocities)))
    return Error{name + " needs " + std::to_string(nv) + " finite velocities, or none"};
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
  if (hand < 0 || hand >= hand_count()) return Error{"no hand " + std::to_string(hand)};
  detail::WorldHand<Scalar>& carrier = *step_.parts.hands[index(hand)];
  if (!carrier.has_frame(frame))
    return Error{"hand " + std::to_string(hand) + " has no frame " + std::to_string(frame)};
  Result<int> added = add_obstacle(std::move(shape), carrier.frame_motion(frame), surface, groups);
  if (!added) return added;
  step_.parts.obstacles.back()->hand = hand;
  step_.parts.obstacles.back()->frame = frame;
  return added;
}

template <RealScalar S>
Result<int> World<S>::add_pad(int carrier, std::vector<PadSample<Scalar>> samples,
                              const PadSettings<Scalar>& settings) {
  const std::string name = "pad " + std::to_string(pad_count());
  if (carrier >= obstacle_count() || -1 - carrier >= step_.parts.bodies.body_count())
    return Error{name + ": nothing has the number " + std::to_string(carrier)};
  std::string bad = validate_pad_samples<Scalar>(samples);
  if (bad.empty()) bad = settings.validate();
  if (!bad.empty()) return Error{name + " has " + bad};
  step_.prepared = false;
  return step_.grips.add({carrier, std::move(samples), settings});
}

template <RealScalar S>
bool World<S>::set_hand(int hand, const HandState<Scalar>& state) {
  HandState<Scalar>& now = step_.parts.hands[index(hand)]->state;
  if (state.positions.size() != now.positions.size() ||
      state.velocities.size() != now.velocities.size() || !all_finite(state.positions) ||
      !all_finite(state.velocities))
    return false;
  now = state;
  step_.parts.hands[index(hand)]->update_frames();
  step_.move_links();
  return true;
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
bool World<S>::set_state(int sheet, const ClothState<Scalar>& state) {
  Sheet& s = at(sheet);
  if (state.positions.cols() != s.state.positions.cols() ||
      state.velocities.cols() != s.state.positions.cols() || !all_finite(state.positions) ||
      !all_finite(state.velocities))
    return false;
  s.state = state;
  s.contacts.clear();
  return true;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
