#pragma once

// Limits on how hands change their motion: the velocity of a grip's centroid by at most a h in a
// frame along each axis, its angular velocity by at most α h about each, from those that the
// measured velocities of its vertices imply. Frame k = 0, 1 … of a window is bounded by what can be
// reached in k + 1 frames; what is sent, the first frame, is limited for certain.

#include <algorithm>

#include "clothctl/mpc/detail/pose_basis.hpp"
#include "clothctl/mpc/detail/rigid_motion.hpp"
#include "clothctl/mpc/detail/window_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Limits three coordinates of a velocity: to `largest` in size, then to what a change of `now` by
/// at most `most` can make; zero means any. The change comes first where both cannot be.
template <RealScalar Scalar, class Velocity>
void limit_velocity(const Vector3<Scalar>& now, const Scalar& most, const Scalar& largest,
                    Velocity&& velocity) {
  for (Index i = 0; i < 3; ++i) {
    if (Scalar(0) < largest)
      velocity[i] = std::clamp<Scalar>(velocity[i], Scalar(0) - largest, largest);
    if (Scalar(0) < most)
      velocity[i] = std::clamp<Scalar>(velocity[i], now[i] - most, now[i] + most);
  }
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
      const Scalar most = settings.max_acceleration * time,
                   turn = settings.max_turn_acceleration * time;
      for (VectorX<Scalar>* bound : {&lower, &upper}) {
        limit_velocity(now.linear, most, Scalar(0), bound->template segment<3>(row));
        if (count == 3) continue;
        limit_velocity(now.angular, turn, settings.max_turn_rate,
                       bound->template segment<3>(row + 3));
      }
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
