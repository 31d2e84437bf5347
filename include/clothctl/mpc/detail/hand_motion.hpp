#pragma once

// Limits on how hands change their motion: the velocity of a grip's centroid by at most a h in a
// frame along each axis, its angular velocity by at most α h about each, from those that the
// measured velocities of its vertices imply. Frame k = 0, 1 … of a window is bounded by what can be
// reached in k + 1 frames; what is sent, the first frame, is limited for certain.

#include "clothctl/mpc/detail/pose_basis.hpp"
#include "clothctl/mpc/detail/rigid_motion.hpp"
#include "clothctl/mpc/detail/window_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns `value`, or the nearest number from `lower` to `upper`.
template <RealScalar Scalar>
Scalar clamped(const Scalar& value, const Scalar& lower, const Scalar& upper) {
  if (value < lower) return lower;
  return upper < value ? upper : value;
}

/// Limits a velocity to what `most` changes can make of the velocity `now`, where `most` is not
/// zero.
template <RealScalar Scalar>
void limit_change(const Vector3<Scalar>& now, const Scalar& most, Vector3<Scalar>& velocity) {
  if (!(Scalar(0) < most)) return;
  for (Index i = 0; i < 3; ++i) velocity[i] = clamped(velocity[i], now[i] - most, now[i] + most);
}

/// Returns the measured rigid motion of grip `g`. Never allocates.
template <RealScalar Scalar, class Contact>
RigidVelocity<Scalar> measured_motion(const WindowProblem<Scalar, Contact>& problem,
                                      std::size_t g) {
  const HeldVertices<Scalar>& held = problem.basis.held();
  const Index begin = static_cast<Index>(held.grip_begin(g)),
              count = static_cast<Index>(held.grip_begin(g + 1)) - begin;
  return fit_rigid_velocity<Scalar>(problem.motion.position.middleCols(begin, count),
                                    problem.motion.velocity.middleCols(begin, count));
}

/// Narrows three bounds to the changes of `now` by at most `most`, and to `largest` in size; zero
/// means any. A change that is too small to come back within the bounds counts before them.
template <RealScalar Scalar, class Lower, class Upper>
void narrow(const Vector3<Scalar>& now, const Scalar& most, const Scalar& largest, Lower&& lower,
            Upper&& upper) {
  for (Index i = 0; i < 3; ++i) {
    if (Scalar(0) < largest) {
      lower[i] = clamped<Scalar>(lower[i], -largest, largest);
      upper[i] = clamped<Scalar>(upper[i], -largest, largest);
    }
    if (!(Scalar(0) < most)) continue;
    lower[i] = clamped<Scalar>(lower[i], now[i] - most, now[i] + most);
    upper[i] = clamped<Scalar>(upper[i], now[i] - most, now[i] + most);
  }
}

/// Narrows the bounds of the unknowns of planned poses in all frames of the window. Never
/// allocates.
template <RealScalar Scalar, class Contact>
void narrow_pose_bounds(const WindowProblem<Scalar, Contact>& problem, VectorX<Scalar>& lower,
                        VectorX<Scalar>& upper) {
  const PlannerSettings<Scalar>& settings = problem.settings;
  for (std::size_t g = 0; g < problem.basis.grips().size(); ++g) {
    const auto [first, count] = PoseBasis<Scalar>::columns(problem.basis.held(), g);
    const RigidVelocity<Scalar> now = measured_motion(problem, g);
    for (Index k = 0; k < settings.horizon; ++k) {
      const Scalar time = Scalar(static_cast<double>(k + 1)) * settings.dt;
      const Index row = k * problem.basis.unknowns() + first;
      narrow(now.linear, settings.max_acceleration * time, Scalar(0),
             lower.template segment<3>(row), upper.template segment<3>(row));
      if (count == 3) continue;
      narrow(now.angular, settings.max_turn_acceleration * time, settings.max_turn_rate,
             lower.template segment<3>(row + 3), upper.template segment<3>(row + 3));
    }
  }
}

/// Returns true when there is a limit that `narrow_pose_bounds` applies.
template <RealScalar Scalar>
bool limits_pose_changes(const PlannerSettings<Scalar>& settings) {
  return settings.input == GripInput::Pose &&
         (Scalar(0) < settings.max_acceleration || Scalar(0) < settings.max_turn_rate ||
          Scalar(0) < settings.max_turn_acceleration);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
