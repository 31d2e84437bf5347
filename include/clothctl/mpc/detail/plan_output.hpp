#pragma once

// What a frame of planning answers: the sizes of a result, and the input that the plant receives,
// which is the first frame of the plan as forces, as positions after that frame, or as a rigid
// motion of each grip.

#include <vector>

#include "clothctl/mpc/detail/hand_motion.hpp"
#include "clothctl/mpc/detail/window_problem.hpp"
#include "clothctl/mpc/plan_types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns true when the plant receives forces, false when it receives positions.
template <RealScalar Scalar>
bool sends_forces(const PlannerSettings<Scalar>& settings) {
  return settings.input == GripInput::Force && settings.command == PlantCommand::Force;
}

/// Makes a result with room for every frame. Allocates.
template <RealScalar Scalar, class Contact>
PlanResult<Scalar> make_plan_result(const WindowProblem<Scalar, Contact>& problem) {
  PlanResult<Scalar> result;
  const Index held_count = static_cast<Index>(problem.request.held.size());
  const bool forces = sends_forces(problem.settings);
  (forces ? result.input.force_vertices : result.input.driven_vertices) = problem.request.held;
  result.input.forces.setZero(3, forces ? held_count : 0);
  result.input.driven_positions.setZero(3, forces ? 0 : held_count);
  result.finger_forces.resize(static_cast<std::size_t>(problem.basis.force_count()));
  result.plan.setZero(problem.basis.inputs(), problem.settings.horizon);
  result.predicted.setZero(3 * problem.feature_count, problem.settings.horizon);
  return result;
}

/// Returns true when a result has the sizes and the vertices that `make_plan_result` gives it.
template <RealScalar Scalar, class Contact>
bool fits(const WindowProblem<Scalar, Contact>& problem, const PlanResult<Scalar>& result) {
  const Index held_count = static_cast<Index>(problem.request.held.size());
  const bool forces = sends_forces(problem.settings);
  const Index sent = forces ? result.input.forces.cols() : result.input.driven_positions.cols();
  const std::vector<int>& vertices =
      forces ? result.input.force_vertices : result.input.driven_vertices;
  return result.finger_forces.size() == static_cast<std::size_t>(problem.basis.force_count()) &&
         result.plan.rows() == problem.basis.inputs() &&
         result.plan.cols() == problem.settings.horizon &&
         result.predicted.rows() == 3 * problem.feature_count &&
         result.predicted.cols() == problem.settings.horizon && sent == held_count &&
         vertices == problem.request.held;
}

/// Stores the velocities of the held vertices that the outputs predicted under the plan
/// (problem.response.free_response) imply, as the path of the request. Never allocates.
template <RealScalar Scalar, class Contact>
void take_path(WindowProblem<Scalar, Contact>& problem) {
  for (std::size_t j = 0; j < problem.request.held.size(); ++j) {
    const Index row = 3 * (problem.feature_count + static_cast<Index>(j));
    Vector3<Scalar> before = problem.motion.position.col(static_cast<Index>(j));
    for (Index k = 0; k < problem.settings.horizon; ++k) {
      const Vector3<Scalar> after = problem.response.free_response.template block<3, 1>(row, k);
      problem.request.path.template block<3, 1>(3 * static_cast<Index>(j), k) =
          (after - before) / problem.settings.dt;
      before = after;
    }
  }
  problem.request.has_path = true;
}

/// Returns the largest coordinate of a non-affine mode of a patch in
/// problem.response.free_response, m. `point`: scratch. Allocates only when `point` grows.
template <RealScalar Scalar, class Contact>
Scalar largest_non_affine(const WindowProblem<Scalar, Contact>& problem,
                          std::vector<OutputTerm<Scalar>>& point) {
  Scalar largest = Scalar(0);
  for (const HeldPatch<Scalar>& patch : problem.patches) {
    for (Index i = 0; i < patch.affine.non_affine_count(); ++i) {
      take_non_affine(patch, i, problem.feature_count, point);
      for (Index k = 0; k < problem.settings.horizon; ++k) {
        Vector3<Scalar> sum = Vector3<Scalar>::Zero();
        for (const OutputTerm<Scalar>& t : point)
          sum += t.weight * problem.response.free_response.template block<3, 1>(3 * t.output, k);
        const Scalar size = sum.cwiseAbs().maxCoeff();
        if (largest < size) largest = size;
      }
    }
  }
  return largest;
}

/// Writes finger forces to the result. If the plant receives forces, that of a vertex is the sum
/// over its fingers. Never allocates.
template <RealScalar Scalar, class Contact>
void send_forces(const WindowProblem<Scalar, Contact>& problem,
                 const std::vector<FingerForce<Scalar>>& forces, PlanResult<Scalar>& result) {
  result.finger_forces = forces;
  result.input.forces.setZero();
  if (!sends_forces(problem.settings)) return;
  for (const auto& columns : problem.basis.fingers()) {
    for (std::size_t j = 0; j < columns.held_slots.size(); ++j) {
      result.input.forces.col(columns.held_slots[j]) +=
          result.finger_forces[static_cast<std::size_t>(columns.first_force) + j].force;
    }
  }
}

/// Sends the positions of the held vertices after the first frame of the path, at most max_step
/// from the measured ones along each axis, then moved with their grip so that its centroid is
/// within max_acceleration, which comes first. Never allocates.
template <RealScalar Scalar, class Contact>
void send_path(const WindowProblem<Scalar, Contact>& problem, PlanResult<Scalar>& result) {
  const PlannerSettings<Scalar>& settings = problem.settings;
  Points<Scalar>& sent = result.input.driven_positions;
  if (sent.cols() == 0) return;
  const HeldVertices<Scalar>& held = problem.basis.held();
  for (std::size_t g = 0; g < problem.basis.grips().size(); ++g) {
    const Index begin = static_cast<Index>(held.grip_begin(g)),
                end = static_cast<Index>(held.grip_begin(g + 1));
    Vector3<Scalar> mean = Vector3<Scalar>::Zero();
    for (Index j = begin; j < end; ++j) {
      Vector3<Scalar> step = Vector3<Scalar>::Zero();
      if (problem.request.has_path)
        step = settings.dt * problem.request.path.template block<3, 1>(3 * j, 0);
      limit_velocity<Scalar>(step, Scalar(0), settings.max_step, step);
      sent.col(j) = problem.motion.position.col(j) + step;
      mean += held.vertex_share(j) * step;
    }
    Vector3<Scalar> limited = mean;
    const Vector3<Scalar> now = settings.dt * measured_motion(problem, g).linear;
    limit_velocity<Scalar>(now, settings.max_acceleration * settings.dt * settings.dt, Scalar(0),
                           limited);
    sent.middleCols(begin, end - begin).colwise() += limited - mean;
  }
}

/// Sends the first frame of result.plan (velocities, m/s) as a rigid motion of each grip within the
/// limits of its changes. Never allocates.
template <RealScalar Scalar, class Contact>
void send_poses(const WindowProblem<Scalar, Contact>& problem, PlanResult<Scalar>& result) {
  const PlannerSettings<Scalar>& settings = problem.settings;
  const HeldVertices<Scalar>& held = problem.basis.held();
  const Eigen::Map<const Points<Scalar>> velocity(result.plan.data(), 3,
                                                  problem.motion.position.cols());
  for (std::size_t g = 0; g < problem.basis.grips().size(); ++g) {
    const Index begin = static_cast<Index>(held.grip_begin(g)),
                count = static_cast<Index>(held.grip_begin(g + 1)) - begin;
    const auto points = problem.motion.position.middleCols(begin, count);
    RigidVelocity<Scalar> motion =
        fit_rigid_velocity<Scalar>(points, velocity.middleCols(begin, count));
    if (limits_pose_changes(settings)) {
      const RigidVelocity<Scalar> now = measured_motion(problem, g);
      limit_velocity<Scalar>(now.linear, settings.max_acceleration * settings.dt, Scalar(0),
                             motion.linear);
      limit_velocity<Scalar>(now.angular, settings.max_turn_acceleration * settings.dt,
                             settings.max_turn_rate, motion.angular);
    }
    move_rigidly<Scalar>(points, motion, settings.dt,
                         result.input.driven_positions.middleCols(begin, count));
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
