#pragma once

// Sheets, rigid bodies and obstacles in one step h:
//
//   1. bodies   free velocities, and their contacts (sim/rigid_bodies.hpp)
//   2. sheets   each with its contacts with obstacles and bodies, which move as at the start of the
//               step (contact/obstacle_contacts.hpp). Bodies receive the opposite impulses.
//   3. layers   sheets that meet themselves or each other are kept apart
//               (contact/sheet_impacts.hpp)
//   4. bodies   contacts and joints; all move
//
// A body is as heavy as you like for the sheets in 2: it learns of them in 4. That is sound as long
// as the part of a sheet that touches a body weighs less than the body.
//
// The world owns what is added to it, no thread and no main loop. The same calls give the same
// bits.

#include <cmath>
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/sim/detail/world_layers.hpp"
#include "clothctl/sim/detail/world_obstacle.hpp"
#include "clothctl/sim/detail/world_sheet.hpp"
#include "clothctl/sim/rigid_bodies.hpp"
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
  explicit World(const Settings& settings = {}) : settings_(settings), bodies_(settings.bodies) {}

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
  /// Adds a body (RigidBodies::add) and returns its number. Allocates.
  Result<int> add_body(const RigidBodySetup<Scalar>& setup);
  /// The bodies: add joints, read and set their motion, read contacts and events. Add bodies to the
  /// world, not here.
  RigidBodies<Scalar>& bodies() { return bodies_; }
  /// The bodies.
  const RigidBodies<Scalar>& bodies() const { return bodies_; }

  /// Advances everything by `dt` (s). Driven vertices of the inputs go straight to their positions.
  /// Allocates only in the first step after something was added.
  [[nodiscard]] WorldReport<Scalar> step(const Scalar& dt, const ExecutorRef& executor = {});

  /// Number of sheets.
  int sheet_count() const { return static_cast<int>(sheets_.size()); }
  /// Number of obstacles.
  int obstacle_count() const { return static_cast<int>(obstacles_.size()); }
  /// The input of a sheet in the steps to come; change it at will.
  ClothInput<Scalar>& input(int sheet) { return at(sheet).input; }
  /// The state of a sheet.
  const ClothState<Scalar>& state(int sheet) const { return at(sheet).state; }
  /// Puts a sheet elsewhere; its contacts are forgotten. Returns false, and changes nothing, when
  /// the state is of another size or not finite.
  bool set_state(int sheet, const ClothState<Scalar>& state);
  /// The contacts of a sheet in the last step (its last part): `obstacle` is the number of an
  /// obstacle, or -1 - b for body b.
  std::span<const ObstacleContact<Scalar>> contacts(int sheet) const { return told_[index(sheet)]; }
  /// The motion of an obstacle.
  const RigidMotion<Scalar>& motion(int obstacle) const {
    return obstacles_[index(obstacle)]->motion();
  }
  /// Gives an obstacle a motion. Returns an empty string, or what is wrong.
  std::string set_motion(int obstacle, const RigidMotion<Scalar>& motion) {
    std::string bad = obstacles_[index(obstacle)]->set_motion(motion);
    if (bad.empty()) bodies_.wake_all();
    return bad;
  }

 private:
  using Sheet = detail::WorldSheet<Scalar>;

  using Obstacle = detail::WorldObstacle<Scalar>;

  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  Sheet& at(int sheet) { return *sheets_[index(sheet)]; }
  const Sheet& at(int sheet) const { return *sheets_[index(sheet)]; }

  /// Makes what depends on all that was added. Returns an empty string, or what is wrong.
  std::string prepare();
  /// A part of a step.
  bool advance(const Scalar& dt, const Scalar& share, const ExecutorRef& executor,
               WorldReport<Scalar>& report);
  bool step_sheet(Sheet& sheet, const Scalar& dt, const Scalar& share, WorldReport<Scalar>& report);
  void push_bodies(const Sheet& sheet, const Scalar& dt);
  void keep_layers_apart(const Scalar& dt, WorldReport<Scalar>& report);
  /// Wakes bodies that a moving obstacle may touch within a step of `dt` s.
  void wake_bodies(const Scalar& dt);
  void save();
  void restore();

  Settings settings_;
  RigidBodies<Scalar> bodies_;
  std::vector<CollisionGroups> body_groups_;
  std::vector<std::unique_ptr<Obstacle>> obstacles_;
  std::vector<std::unique_ptr<Sheet>> sheets_;
  std::vector<SheetSetup> setups_;
  bool prepared_ = false;
  int substeps_ = 1;

  detail::WorldLayers<Scalar> layers_;
  std::vector<std::vector<ObstacleContact<Scalar>>> told_;
  std::vector<Vector3<Scalar>> body_impulse_;

  /// What a failed step goes back to.
  std::vector<ClothState<Scalar>> saved_states_;
  std::vector<RigidMotion<Scalar>> saved_motions_;
  RigidBodiesState<Scalar> saved_bodies_;
};

template <RealScalar S>
template <class Model>
Result<int> World<S>::add_sheet(Model model, ClothState<Scalar> state, const SheetSetup& setup) {
  const std::string name = "sheet " + std::to_string(sheets_.size());
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
  Result<SheetContactFinder<Scalar>> finder =
      SheetContactFinder<Scalar>::create(network.rest_positions, network.triangles, {}, inside);
  if (!finder) return Error{name + ": " + finder.error()};
  ObstacleContactSettings<Scalar> touch;
  touch.thickness = Scalar(0.5) * setup.thickness;
  if (!(touch.thickness < touch.reach)) touch.reach = Scalar(2) * touch.thickness;
  const Index room = setup.contacts > 0 ? setup.contacts : 4 * n;
  Result<ObstacleContacts<Scalar>> contacts = ObstacleContacts<Scalar>::create(room, touch);
  if (!contacts) return Error{name + ": " + contacts.error()};
  sheets_.push_back(std::make_unique<detail::WorldSheetOf<Model>>(
      std::move(model), std::move(state), std::move(finder).value(), std::move(contacts).value(),
      room));
  setups_.push_back(setup);
  told_.emplace_back().reserve(static_cast<std::size_t>(room));
  prepared_ = false;
  return static_cast<int>(sheets_.size()) - 1;
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
  Result<int> added = bodies_.add_obstacle(obstacle->collider(), Scalar(0), groups);
  if (!added) return added;
  obstacles_.push_back(std::move(obstacle));
  prepared_ = false;
  return static_cast<int>(obstacles_.size()) - 1;
}

template <RealScalar S>
Result<int> World<S>::add_body(const RigidBodySetup<Scalar>& setup) {
  Result<int> added = bodies_.add(setup);
  if (!added) return added;
  body_groups_.push_back(setup.groups);
  prepared_ = false;
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

template <RealScalar S>
std::string World<S>::prepare() {
  if (body_groups_.size() != index(bodies_.body_count())) return "a body was added elsewhere";
  substeps_ = 1;
  for (std::size_t i = 0; i < sheets_.size(); ++i) {
    Sheet& sheet = *sheets_[i];
    sheet.obstacles.clear();
    sheet.obstacle_number.clear();
    const auto add = [&](const ColliderRef<Scalar>& collider, const CollisionGroups& groups,
                         int number) {
      if (!groups.meets(setups_[i].groups)) return;
      sheet.obstacles.push_back(collider);
      sheet.obstacle_number.push_back(number);
    };
    for (std::size_t k = 0; k < obstacles_.size(); ++k)
      add(obstacles_[k]->collider(), obstacles_[k]->groups, static_cast<int>(k));
    for (int b = 0; b < bodies_.body_count(); ++b)
      add(bodies_.collider(b), body_groups_[index(b)], -1 - b);
    if (substeps_ < setups_[i].substeps) substeps_ = setups_[i].substeps;
  }
  body_impulse_.resize(index(bodies_.body_count()));
  saved_motions_.resize(obstacles_.size());
  saved_states_.resize(sheets_.size());
  const std::size_t room = 32 * (body_groups_.size() + 1);
  bodies_.reserve(room);
  saved_bodies_ = bodies_.state();
  saved_bodies_.contacts.reserve(room);
  return layers_.prepare(sheets_, setups_, settings_.sheet_friction);
}

template <RealScalar S>
void World<S>::save() {
  for (std::size_t i = 0; i < sheets_.size(); ++i) saved_states_[i] = sheets_[i]->state;
  for (std::size_t i = 0; i < obstacles_.size(); ++i) saved_motions_[i] = obstacles_[i]->motion();
  saved_bodies_ = bodies_.state();
}

template <RealScalar S>
void World<S>::restore() {
  for (std::size_t i = 0; i < sheets_.size(); ++i) {
    sheets_[i]->state = saved_states_[i];
    sheets_[i]->contacts.clear();
  }
  for (std::size_t i = 0; i < obstacles_.size(); ++i)
    (void)obstacles_[i]->set_motion(saved_motions_[i]);
  (void)bodies_.restore(saved_bodies_);
}

template <RealScalar S>
WorldReport<S> World<S>::step(const Scalar& dt, const ExecutorRef& executor) {
  WorldReport<Scalar> report;
  report.status = StepStatus::InvalidInput;
  if (!is_finite(dt) || !(Scalar(0) < dt) || !settings_.bodies.validate().empty()) return report;
  if (!prepared_) {
    if (!prepare().empty()) return report;
    prepared_ = true;
  }
  report.status = StepStatus::Converged;
  save();
  for (int part = 0; part < substeps_; ++part) {
    // Driven vertices go an equal part of what is left of their way.
    const Scalar share = Scalar(1) / Scalar(static_cast<double>(substeps_ - part));
    if (!advance(dt / Scalar(static_cast<double>(substeps_)), share, executor, report)) {
      restore();
      report.advanced = false;
      return report;
    }
  }
  for (std::size_t i = 0; i < sheets_.size(); ++i) {
    const auto list = sheets_[i]->contacts.contacts();
    told_[i].assign(list.begin(), list.end());
    for (ObstacleContact<Scalar>& c : told_[i])
      c.obstacle = sheets_[i]->obstacle_number[index(c.obstacle)];
  }
  report.advanced = true;
  return report;
}

template <RealScalar S>
bool World<S>::advance(const Scalar& dt, const Scalar& share, const ExecutorRef& executor,
                       WorldReport<Scalar>& report) {
  report.contacts = report.layers = 0;
  wake_bodies(dt);
  const StepStatus predicted = bodies_.predict(dt);
  if (predicted != StepStatus::Converged) {
    report.status = predicted;
    return false;
  }
  layers_.begin(sheets_);
  for (std::size_t i = 0; i < sheets_.size(); ++i) {
    report.sheet = static_cast<int>(i);
    if (!step_sheet(*sheets_[i], dt, share, report)) return false;
    push_bodies(*sheets_[i], dt);
  }
  report.sheet = -1;
  keep_layers_apart(dt, report);
  bodies_.solve(executor);
  report.bodies = bodies_.finish();
  if (!report.bodies.advanced) {
    report.status = report.bodies.status;
    return false;
  }
  if (report.bodies.status != StepStatus::Converged) report.status = report.bodies.status;
  for (const auto& obstacle : obstacles_) obstacle->move(dt);
  return true;
}

template <RealScalar S>
bool World<S>::step_sheet(Sheet& sheet, const Scalar& dt, const Scalar& share,
                          WorldReport<Scalar>& report) {
  const QueryStatus found = sheet.find_contacts(dt);
  if (found != QueryStatus::Answered) {
    report.status = StepStatus::InvalidState;
    return false;
  }
  report.complete = report.complete && sheet.contacts.complete();
  const ClothInput<Scalar>* now = &sheet.input;
  if (share < Scalar(1)) {
    sheet.part = sheet.input;
    const Index given = sheet.part.driven_positions.cols();
    for (std::size_t k = 0; k < sheet.part.driven_vertices.size(); ++k) {
      const int v = sheet.part.driven_vertices[k];
      // The model refuses these.
      if (v < 0 || v >= sheet.state.positions.cols() || given <= static_cast<Index>(k)) continue;
      const Vector3<Scalar> from = sheet.state.positions.col(v);
      auto to = sheet.part.driven_positions.col(static_cast<Index>(k));
      to = from + share * (to - from);
    }
    now = &sheet.part;
  }
  const StepReport<Scalar> made = sheet.step(dt, *now);
  if (made.status != StepStatus::Converged) report.status = made.status;
  const ObstacleContactReport<Scalar>& told = sheet.contacts.report();
  report.contacts += told.closed;
  if (report.penetration < told.penetration) report.penetration = told.penetration;
  if (report.force_residual < told.force_residual) report.force_residual = told.force_residual;
  return made.advanced;
}

template <RealScalar S>
void World<S>::push_bodies(const Sheet& sheet, const Scalar& dt) {
  using std::sqrt;
  for (Vector3<Scalar>& sum : body_impulse_) sum.setConstant(Scalar(0));
  const auto for_each = [&](auto visit) {
    for (const ObstacleContact<Scalar>& c : sheet.contacts.contacts()) {
      const int number = sheet.obstacle_number[index(c.obstacle)];
      if (number < 0 && c.state != ContactState::Open) visit(-1 - number, c);
    }
  };
  for_each([&](int b, const ObstacleContact<Scalar>& c) { body_impulse_[index(b)] -= c.impulse; });
  for_each([&](int b, const ObstacleContact<Scalar>& c) {
    // A sheet that lies on a sleeping body does not wake it.
    const Scalar gain = bodies_.inverse_mass(b) * sqrt(body_impulse_[index(b)].squaredNorm());
    const Scalar fall = dt * sqrt(settings_.bodies.gravity.squaredNorm());
    if (bodies_.asleep(b) && gain < fall + settings_.bodies.sleep_speed) return;
    bodies_.apply_impulse(b, Vector3<Scalar>(Scalar(-1) * c.impulse), c.point.surface.point);
  });
}

template <RealScalar S>
void World<S>::keep_layers_apart(const Scalar& dt, WorldReport<Scalar>& report) {
  const SheetImpactReport told = layers_.keep_apart(sheets_, dt);
  report.layers = told.contacts;
  report.crossings = told.crossings_left;
  report.complete = report.complete && told.complete;
  if (told.status != StepStatus::Converged) report.status = StepStatus::IterationLimit;
  layers_.for_each_support(sheets_, [this](const Sheet& sheet, const ObstacleContact<Scalar>& c,
                                           const Vector3<Scalar>& impulse) {
    const int body = -1 - sheet.obstacle_number[index(c.obstacle)];
    if (body < 0 || !(Scalar(0) < impulse.squaredNorm()) || bodies_.asleep(body)) return;
    bodies_.apply_impulse(body, Vector3<Scalar>(Scalar(-1) * impulse), c.point.surface.point);
  });
}

template <RealScalar S>
void World<S>::wake_bodies(const Scalar& dt) {
  for (const auto& obstacle : obstacles_) {
    if (!obstacle->moves()) continue;
    const BoundingBox<Scalar> box = obstacle->collider().bounds(dt);
    for (int b = 0; b < bodies_.body_count(); ++b) {
      if (bodies_.asleep(b) && obstacle->groups.meets(body_groups_[index(b)]) &&
          box.overlaps(bodies_.collider(b).bounds(Scalar(0))))
        bodies_.wake(b);
    }
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI
