#pragma once

// What rigid bodies, obstacles and joints are made of, and what a step of them reports.

#include <cstdint>
#include <string>

#include "clothctl/collision/convex_shape.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/status.hpp"
#include "clothctl/sim/detail/rigid_state.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// What moves a rigid body.
enum class BodyKind {
  /// Gravity and impulses.
  Free,
  /// Its own velocities, which are given; no impulse changes them.
  Kinematic,
  /// Nothing.
  Pinned
};

/// Which bodies collide: A and B do if each has a group that the other looks for.
struct CollisionGroups {
  /// The groups that it belongs to, one bit each.
  std::uint32_t groups = 1;
  /// The groups that it collides with.
  std::uint32_t collides_with = 0xffffffffu;

  /// Returns whether two collide.
  bool meets(const CollisionGroups& other) const {
    return (groups & other.collides_with) != 0 && (other.groups & collides_with) != 0;
  }
};

/// A rigid body.
template <RealScalar Scalar>
struct RigidBodySetup {
  /// Its shape, about its centre of mass.
  ConvexShape<Scalar> shape;
  /// Mass, kg; 0 for the volume times the density.
  Scalar mass = Scalar(0);
  /// Density, kg/m³.
  Scalar density = Scalar(1000);
  /// Pose and velocities of the centre of mass.
  RigidMotion<Scalar> motion = {};
  /// What moves it.
  BodyKind kind = BodyKind::Free;
  /// Friction coefficient; that of a contact is √(μ_A μ_B).
  Scalar friction = Scalar(0.5);
  /// Restitution coefficient, 0 to 1; that of a contact is the larger one.
  Scalar restitution = Scalar(0);
  /// Which bodies it collides with.
  CollisionGroups groups = {};
  /// Whether it may fall asleep.
  bool may_sleep = true;

  /// Returns an empty string, or what is wrong.
  std::string validate() const;
};

/// A joint between body `a` and body `b`, or the world.
template <RealScalar Scalar>
struct RigidJointSetup {
  /// What it holds.
  JointKind kind = JointKind::Ball;
  /// The bodies; b = -1 is the world.
  int a = 0, b = -1;
  /// Where it is, m (world), in the poses that the bodies have when it is added.
  Vector3<Scalar> anchor = Vector3<Scalar>::Constant(Scalar(0));
  /// Axis of a hinge (world); its length does not matter.
  Vector3<Scalar> axis = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1));
  /// Compliance, m/N, and rad/(N m) for turns; 0 is as stiff as the step allows.
  Scalar compliance = Scalar(0);
  /// Whether the bodies collide with each other.
  bool collide = false;
};

/// How bodies are stepped.
template <RealScalar Scalar>
struct RigidBodiesSettings {
  /// m/s².
  Vector3<Scalar> gravity = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-9.81));
  /// κ: the compliance of a contact is h²/(β κ m), m the heaviest mass of its island. A weight m g
  /// on one contact sinks by g h²/(β κ): 14 µm at 60 Hz.
  Scalar stiffness = Scalar(1000);
  /// β: the share of an overlap, or of the error of a joint, that a step removes.
  Scalar relaxation = Scalar(0.2);
  /// Largest speed at which overlaps are pushed out, m/s.
  Scalar push_speed = Scalar(1);
  /// Contacts slower than this do not bounce, m/s; nor do those that two steps of gravity explain.
  Scalar bounce_speed = Scalar(0.1);
  /// Islands whose bodies are slower than this (m/s, of their fastest points) for `sleep_time` (s)
  /// fall asleep. A time of 0 means never.
  Scalar sleep_speed = Scalar(0.02), sleep_time = Scalar(0.5);
  /// Residual velocity up to which an island counts as solved, m/s.
  Scalar velocity_tolerance = Scalar(1e-6);
  /// Islands with up to so many contacts are solved by Newton's method, larger ones by `sweeps`.
  int newton_contacts = 60;
  /// See `newton_contacts`.
  int sweeps = 100;
  /// Whether bodies that move by more than half their inner radius in a step stop at what they hit.
  bool continuous = true;

  /// Returns an empty string, or what is wrong.
  std::string validate() const;
};

/// What happened in a step.
template <RealScalar Scalar>
struct RigidStepReport {
  /// Converged: all islands are solved to the tolerance. IterationLimit: some are not, see the
  /// residuals; the state was advanced. InvalidInput: the step length is not positive and finite,
  /// or the settings are not valid; the state is unchanged. NumericalFailure: a velocity or
  /// position is not finite; the bodies are as before the step.
  StepStatus status = StepStatus::Converged;
  /// Whether the state was advanced.
  bool advanced = false;
  /// Contacts (also of bodies asleep), islands that are awake, and bodies asleep.
  int contacts = 0, islands = 0, asleep = 0;
  /// Islands that are not solved to the tolerance.
  int unsolved = 0;
  /// Newton steps and sweeps of all islands.
  int newton_steps = 0, sweeps = 0;
  /// Largest natural map of a contact, as a force (N) and as a velocity (m/s).
  Scalar force_residual = Scalar(0), velocity_residual = Scalar(0);
  /// Kinetic and potential energy of the free bodies at the end of the step, J.
  Scalar kinetic = Scalar(0), potential = Scalar(0);
};

/// What happened to a body or a pair of bodies in a step.
enum class RigidEventKind {
  /// A and B began to touch: a contact transmits an impulse.
  ContactBegan,
  /// A and B no longer touch.
  ContactEnded,
  /// Body a fell asleep.
  Slept,
  /// Body a woke up.
  Woke
};

/// An event of a step.
struct RigidEvent {
  /// What happened.
  RigidEventKind kind = RigidEventKind::ContactBegan;
  /// The bodies; b is -1 - k for obstacle k, and has no meaning for Slept and Woke.
  int a = -1, b = -1;
};

namespace detail {

/// Returns an empty string, or that a number is not finite or not within bounds.
template <RealScalar Scalar>
std::string validate_within(const char* name, const Scalar& x, const Scalar& low,
                            const Scalar& high) {
  if (is_finite(x) && !(x < low) && !(high < x)) return {};
  return std::string("the ") + name + " " + number_text(x) + ", must be from " + number_text(low) +
         " to " + number_text(high);
}

}  // namespace detail

template <RealScalar Scalar>
std::string RigidBodySetup<Scalar>::validate() const {
  const Scalar zero = Scalar(0), most = Scalar(1e15);
  std::string bad = detail::validate_within<Scalar>("mass (kg)", mass, zero, most);
  if (bad.empty()) bad = detail::validate_within<Scalar>("density (kg/m³)", density, zero, most);
  if (bad.empty() && kind == BodyKind::Free && !(zero < mass) && !(zero < density))
    bad = "neither mass nor density";
  if (bad.empty()) bad = motion.validate();
  if (bad.empty()) bad = detail::validate_within<Scalar>("friction", friction, zero, Scalar(1e6));
  if (bad.empty())
    bad = detail::validate_within<Scalar>("restitution", restitution, zero, Scalar(1));
  return bad;
}

template <RealScalar Scalar>
std::string RigidBodiesSettings<Scalar>::validate() const {
  const Scalar zero = Scalar(0), most = Scalar(1e15), tiny = Scalar(1e-12);
  using detail::validate_within;
  std::string bad = detail::validate_point("gravity", gravity);
  if (bad.empty()) bad = validate_within<Scalar>("stiffness", stiffness, Scalar(1), most);
  if (bad.empty()) bad = validate_within<Scalar>("relaxation", relaxation, Scalar(1e-3), Scalar(1));
  if (bad.empty()) bad = validate_within<Scalar>("push speed", push_speed, zero, most);
  if (bad.empty()) bad = validate_within<Scalar>("bounce speed", bounce_speed, zero, most);
  if (bad.empty()) bad = validate_within<Scalar>("sleep speed", sleep_speed, zero, most);
  if (bad.empty()) bad = validate_within<Scalar>("sleep time", sleep_time, zero, most);
  if (bad.empty())
    bad = validate_within<Scalar>("velocity tolerance", velocity_tolerance, tiny, most);
  if (bad.empty() && (newton_contacts < 0 || newton_contacts > 200))
    bad = "room for " + std::to_string(newton_contacts) + " contacts; up to 200 are possible";
  if (bad.empty() && (sweeps < 1 || sweeps > 100000))
    bad = std::to_string(sweeps) + " sweeps; 1 to 100000 are possible";
  return bad;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
