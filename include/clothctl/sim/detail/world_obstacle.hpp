#pragma once

// An obstacle of a world: a moving collider whose shape is not known.

#include <string>
#include <utility>

#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/sim/rigid_setup.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// An obstacle.
template <RealScalar Scalar>
class WorldObstacle {
 public:
  virtual ~WorldObstacle() = default;
  virtual const RigidMotion<Scalar>& motion() const = 0;
  virtual std::string set_motion(const RigidMotion<Scalar>& motion) = 0;
  virtual ColliderRef<Scalar> collider() const = 0;

  /// Whether its pose changes in a step.
  bool moves() const {
    const RigidMotion<Scalar>& now = motion();
    return Scalar(0) < now.velocity.squaredNorm() + now.angular_velocity.squaredNorm();
  }
  /// Moves it on by `dt` s.
  void move(const Scalar& dt) {
    if (!moves()) return;
    RigidMotion<Scalar> next = motion();
    next.position += dt * next.velocity;
    next.R_world_body =
        rotation_exp<Scalar>(Vector3<Scalar>(dt * next.angular_velocity)) * next.R_world_body;
    (void)set_motion(next);
  }

  CollisionGroups groups;
  /// The hand that carries it and the frame there, or -1.
  int hand = -1, frame = -1;
};

/// An obstacle of a shape.
template <RealScalar Scalar, class C>
class WorldObstacleOf : public WorldObstacle<Scalar> {
 public:
  explicit WorldObstacleOf(MovingCollider<Scalar, C> collider) : moving_(std::move(collider)) {}

  const RigidMotion<Scalar>& motion() const override { return moving_.motion(); }
  std::string set_motion(const RigidMotion<Scalar>& motion) override {
    return moving_.set_motion(motion);
  }
  ColliderRef<Scalar> collider() const override { return ColliderRef<Scalar>(moving_); }

 private:
  MovingCollider<Scalar, C> moving_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
