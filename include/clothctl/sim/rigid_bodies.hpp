#pragma once

// Rigid bodies with contacts, friction and joints. A step of length h is, for velocities v (of all
// bodies) and contact impulses λ,
//
//   predict   v_free = v + h g;  contacts of the poses at the start of the step
//   solve     M (v⁺ - v_free) = Jᵀ λ, with λ and J v⁺ as Coulomb's law and the joints want
//   finish    x⁺ = x + h v⁺;  R⁺ and w⁺ by the midpoint rule (detail/free_rotation.hpp)
//
// Contacts are slightly soft and remember where they stuck, so that friction holds without creep
// (detail/island_solver.hpp). A contact of a gap g > 0 only keeps the bodies from closing it by
// more than g in the step. A body that moves by more than half of its inner radius is swept: it
// stops where a ball of that half radius touches something, and goes on in the next step.
//
// Islands (detail/rigid_islands.hpp) are solved apart from each other. One whose bodies are still
// falls asleep as a whole: nothing of it changes until something that moves touches one of its
// bodies.

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/body_contacts.hpp"
#include "clothctl/concepts/executor.hpp"
#include "clothctl/sim/detail/rigid_step.hpp"
#include "clothctl/sim/rigid_setup.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A system of rigid bodies. Bodies, obstacles and joints have numbers from 0 in the order in which
/// they are added. A step allocates only when there are more contacts or close pairs than ever
/// before and than `reserve` made room for.
template <RealScalar Scalar>
class RigidBodies {
 public:
  /// The set-up of a body.
  using BodySetup = RigidBodySetup<Scalar>;
  /// The set-up of a joint.
  using JointSetup = RigidJointSetup<Scalar>;
  /// The settings.
  using Settings = RigidBodiesSettings<Scalar>;
  /// The state.
  using State = RigidBodiesState<Scalar>;
  /// What a step reports.
  using Report = RigidStepReport<Scalar>;

  /// Makes an empty system. When the text of `settings.validate()` is not empty, every step returns
  /// InvalidInput.
  explicit RigidBodies(const Settings& settings = {}) : world_(settings) {}

  /// Adds a body and returns its number. Allocates. Fails when: a number of the set-up is not
  /// finite or out of its range, or the inertia is too small for the scalar.
  Result<int> add(const BodySetup& setup) { return world_.add(setup); }
  /// Adds an obstacle: any collider, which must outlive this and not move in memory. What of it
  /// moves, moves by its own surface velocity; where its pose changes, call `wake_all`. Its
  /// friction is its own, its restitution is given. Returns its number. Allocates. Fails when: the
  /// restitution is not within 0 to 1.
  Result<int> add_obstacle(const ColliderRef<Scalar>& collider,
                           const Scalar& restitution = Scalar(0),
                           const CollisionGroups& groups = {}) {
    return world_.add_obstacle(collider, restitution, groups);
  }
  /// Adds a joint and returns its number. Allocates. Fails when: a body does not exist, both are
  /// the same, none is free, or a number is not finite or negative.
  Result<int> add_joint(const JointSetup& setup) { return world_.add_joint(setup); }
  /// Makes room for `contacts` contacts and four times as many close pairs. Allocates.
  void reserve(std::size_t contacts) { world_.reserve(contacts); }

  /// Number of bodies.
  int body_count() const { return static_cast<int>(world_.bodies.size()); }
  /// Number of obstacles.
  int obstacle_count() const { return static_cast<int>(world_.obstacles.size()); }
  /// Number of joints.
  int joint_count() const { return static_cast<int>(world_.joints.size()); }
  /// The settings.
  const Settings& settings() const { return world_.settings; }

  /// Advances all bodies by `dt` (s): predict, solve and finish. The same bits with any executor.
  [[nodiscard]] Report step(const Scalar& dt, const ExecutorRef& executor = {}) {
    const StepStatus status = predict(dt);
    if (status != StepStatus::Converged) {
      Report report;
      report.status = status;
      return report;
    }
    solve(executor);
    return finish();
  }
  /// The first part of a step: gravity, contacts, islands. Velocities are then free ones, and may
  /// be changed by `apply_impulse`. InvalidInput: see RigidStepReport.
  [[nodiscard]] StepStatus predict(const Scalar& dt) { return world_.predict(dt); }
  /// The second part: changes velocities by contacts and joints. May be repeated after further
  /// impulses.
  void solve(const ExecutorRef& executor = {}) { world_.solve(executor); }
  /// The third part: moves the bodies, lets them fall asleep, and reports.
  [[nodiscard]] Report finish() { return world_.finish(); }

  /// Pose and velocities of the centre of mass of a body.
  const RigidMotion<Scalar>& motion(int body) const { return world_.body_state(body).motion; }
  /// Gives a body a pose and velocities, and wakes it. Returns an empty string, or what is wrong;
  /// nothing changes then.
  std::string set_motion(int body, const RigidMotion<Scalar>& motion) {
    return world_.set_motion(body, motion);
  }
  /// The shape of a body.
  const ConvexShape<Scalar>& shape(int body) const { return world_.body(body).shape; }
  /// Mass, kg; 0 for a body that impulses do not move.
  const Scalar& mass(int body) const { return world_.body(body).mass; }
  /// 1/mass, 1/kg; 0 for a body that impulses do not move.
  const Scalar& inverse_mass(int body) const { return world_.body(body).lightness; }
  /// The inverse of the inertia about the centre of mass, 1/(kg m²), world axes; 0 for a body that
  /// impulses do not move.
  Matrix3<Scalar> inverse_inertia(int body) const { return world_.inverse_inertia(body); }
  /// Inertia about the centre of mass in body axes, kg m².
  const Matrix3<Scalar>& inertia(int body) const { return world_.body(body).inertia; }
  /// Applies an impulse (N s) to a free body at a point (m, world), and wakes it. Returns false,
  /// and changes nothing, when a number is not finite.
  bool apply_impulse(int body, const Vector3<Scalar>& impulse, const Vector3<Scalar>& point) {
    return world_.apply_impulse(body, impulse, point);
  }
  /// A body as a collider with its pose, surface velocity, friction, and the body's number. Valid
  /// as long as this; queries see the pose after the last finish() or set_motion().
  ColliderRef<Scalar> collider(int body) const { return world_.body(body).moving->collider(); }

  /// The motion of the body that `collider` answers with: pose and velocities at the end of the
  /// last step, or those that were set since.
  const RigidMotion<Scalar>& surface_motion(int body) const {
    return world_.body(body).moving->motion();
  }
  /// Returns whether a joint, or another body or obstacle that it touches, may stop a body that
  /// gains the velocities (m/s; rad/s, about its centre of mass). Complexity: O(contacts + joints).
  bool is_held(int body, const Vector3<Scalar>& velocity,
               const Vector3<Scalar>& angular_velocity) const {
    return world_.is_held(body, velocity, angular_velocity);
  }
  /// Lets `collider` answer with other velocities (m/s, rad/s) until the end of the step: those
  /// that the body will probably have then. Returns an empty string, or what is wrong; nothing
  /// changes then.
  std::string set_surface_velocity(int body, const Vector3<Scalar>& velocity,
                                   const Vector3<Scalar>& angular_velocity) {
    RigidMotion<Scalar> motion = surface_motion(body);
    motion.velocity = velocity;
    motion.angular_velocity = angular_velocity;
    return world_.body(body).moving->set_motion(motion);
  }

  /// Whether a body is asleep.
  bool asleep(int body) const { return world_.body_state(body).asleep >= 0; }
  /// Wakes a body and its island.
  void wake(int body) { world_.wake(body); }
  /// Wakes all bodies.
  void wake_all() {
    for (int i = 0; i < body_count(); ++i) wake(i);
  }
  /// The contacts of the last step, valid until the next.
  std::span<const RigidContact<Scalar>> contacts() const { return world_.state.contacts; }
  /// The events of the last step, and of bodies that were woken since; valid until the next.
  std::span<const RigidEvent> events() const { return world_.events; }

  /// The state, to be copied and restored.
  const State& state() const { return world_.state; }
  /// Goes back to a state. Returns false, and changes nothing, when it is of other bodies or
  /// joints. Allocates only for more contacts than ever before.
  bool restore(const State& state) { return world_.restore(state); }

 private:
  detail::RigidWorld<Scalar> world_;
};

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class detail::IslandSolver<double>);
CLOTHCTL_INSTANTIATE(struct detail::RigidWorld<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
