#pragma once

// A hand, or any robot with ArticulatedDynamics, in a world (world.hpp). Stable PD control drives
// it (robot/stable_pd.hpp). With its torques, the velocities at the end of a step of length h
// without contact are q̇ + h q̈; impulses of contact change them through the matrix of that step,
// M + h Kd (+ h² Kp), so hand and controller are one implicit side of every contact. A joint whose
// torque is at its limit has no part of Kd and Kp there: it presses with that torque. Limits are
// those of the motion without contact; what contact adds to a torque may take it beyond.

#include "clothctl/core/types.hpp"
#include "clothctl/robot/stable_pd.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// With what a hand starts.
template <RealScalar Scalar>
struct HandSetup {
  /// Positions (nq; m or rad).
  VectorX<Scalar> positions;
  /// Velocities (nv; m/s or rad/s), or empty for zero.
  VectorX<Scalar> velocities = {};
  /// Gains and options of its controller. Its `dt` does not matter: a world sets it.
  StablePdSettings<Scalar> control = {};
};

/// Positions and velocities of a hand.
template <RealScalar Scalar>
struct HandState {
  /// Positions (nq; m or rad).
  VectorX<Scalar> positions;
  /// Velocities (nv; m/s or rad/s).
  VectorX<Scalar> velocities;
};

/// What a hand is to do in the steps to come; change it at will, but not the sizes.
template <RealScalar Scalar>
struct HandDrive {
  /// Positions (nq) to be at at the end of the step. At first those of the set-up.
  VectorX<Scalar> target;
  /// Velocities (nv) of the target there. At first zero.
  VectorX<Scalar> target_velocity;
  /// Further torques (nv; N or N m) of the motors, beside spring and damper of the controller; the
  /// limits hold for all together. At first zero.
  VectorX<Scalar> torque;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
