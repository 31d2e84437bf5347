#pragma once

// Tasks, settings and reports of inverse kinematics.
//
// Each task has a residual e (3 rows) and a Jacobian J. A step dq changes e by -J dq to first
// order, for rotations near their target. -Jᵀ e is the gradient of ½ |e|².
//
//   Position      e = target - x             J = J_v               x: a point fixed on a frame
//   Orientation   e = log(R_target Rᵀ)       J = J_ω               world axes, the shorter turn
//   Pointing      e = rotation vector of     J = (1 - a aᵀ) J_ω    a: an axis of the frame
//                     the turn from a to d                         d: a direction of the world

#include <cmath>
#include <string_view>
#include <vector>

#include "clothctl/concepts/articulated.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/math/rotation.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// What a task asks of a frame.
enum class IkKind {
  /// A point fixed on the frame shall be at the target point.
  Position,
  /// The frame shall have the target rotation.
  Orientation,
  /// An axis of the frame shall point along the target direction.
  Pointing
};

/// One task of inverse kinematics, with a residual of three rows.
template <RealScalar Scalar>
struct IkTask {
  /// Kind of the task.
  IkKind kind = IkKind::Position;
  /// Index of the frame. For a KinematicTree it is a link number.
  int frame = 0;
  /// Position: the point, in the frame (m). Pointing: the unit axis, in the frame.
  Vector3<Scalar> local = Vector3<Scalar>::Constant(Scalar(0));
  /// Position: the target point (m, world). Pointing: the unit target direction (world).
  Vector3<Scalar> target = Vector3<Scalar>::Constant(Scalar(0));
  /// Orientation: the target rotation, from the frame to the world.
  Matrix3<Scalar> rotation = Matrix3<Scalar>::Identity();
  /// Weight of the residual. For rotations it is the length (m) that one radian counts as.
  Scalar weight = Scalar(1);

  /// Returns the task: `point` of the frame (m) shall be at `target` (m, world).
  static IkTask position(int frame, const Vector3<Scalar>& point, const Vector3<Scalar>& target) {
    IkTask task;
    task.frame = frame;
    task.local = point;
    task.target = target;
    return task;
  }
  /// Returns the task: the frame shall have `rotation` (frame to world). One radian of error counts
  /// as `length` (m).
  static IkTask orientation(int frame, const Matrix3<Scalar>& rotation,
                            const Scalar& length = Scalar(0.1)) {
    IkTask task;
    task.kind = IkKind::Orientation;
    task.frame = frame;
    task.rotation = rotation;
    task.weight = length;
    return task;
  }
  /// Returns the task: the unit `axis` of the frame shall point along the unit `direction` of the
  /// world. One radian of error counts as `length` (m).
  static IkTask pointing(int frame, const Vector3<Scalar>& axis, const Vector3<Scalar>& direction,
                         const Scalar& length = Scalar(0.1)) {
    IkTask task;
    task.kind = IkKind::Pointing;
    task.frame = frame;
    task.local = axis;
    task.target = direction;
    task.weight = length;
    return task;
  }
};

/// Writes the weighted residual of a task to e (3; m), at the positions of the last
/// `forward_kinematics` of the workspace. The task's frame must exist. Never allocates.
template <class Model, RealScalar Scalar>
void task_residual(const Model& model,
                   const typename articulated_traits<Model>::workspace_type& work,
                   const IkTask<Scalar>& task, Eigen::Ref<Vector3<Scalar>> e) {
  Matrix3<Scalar> R;
  Vector3<Scalar> p;
  articulated_traits<Model>::frame_pose(model, work, task.frame, R, p);
  switch (task.kind) {
    case IkKind::Position: e = task.target - (p + R * task.local); break;
    case IkKind::Orientation: e = rotation_log<Scalar>(task.rotation * R.transpose()); break;
    case IkKind::Pointing: e = shortest_rotation<Scalar>(R * task.local, task.target); break;
  }
  e *= task.weight;
}

/// Writes the weighted Jacobian of a task to J (3 × nv), at the positions of the last
/// `forward_kinematics` of the workspace. The task's frame must exist. `twist` (6 × nv) is scratch
/// memory. Never allocates.
template <class Model, RealScalar Scalar>
void task_jacobian(const Model& model,
                   const typename articulated_traits<Model>::workspace_type& work,
                   const IkTask<Scalar>& task, MatrixX<Scalar>& twist,
                   Eigen::Ref<MatrixX<Scalar>> J) {
  Matrix3<Scalar> R;
  Vector3<Scalar> p;
  articulated_traits<Model>::frame_pose(model, work, task.frame, R, p);
  if (task.kind == IkKind::Position) {
    const Vector3<Scalar> x = p + R * task.local;
    if constexpr (requires {
                    articulated_traits<Model>::position_jacobian(model, work, task.frame, x,
                                                                 task.weight, J);
                  }) {
      articulated_traits<Model>::position_jacobian(model, work, task.frame, x, task.weight, J);
    } else {
      articulated_traits<Model>::point_jacobian(model, work, task.frame, x, twist);
      J = task.weight * twist.template topRows<3>();
    }
    return;
  }
  articulated_traits<Model>::point_jacobian(model, work, task.frame, p, twist);
  J = task.weight * twist.template bottomRows<3>();
  if (task.kind == IkKind::Orientation) return;
  const Vector3<Scalar> axis = R * task.local;
  for (Index k = 0; k < J.cols(); ++k) {
    const Scalar along = axis[0] * J(0, k) + axis[1] * J(1, k) + axis[2] * J(2, k);
    for (Index i = 0; i < 3; ++i) J(i, k) -= along * axis[i];
  }
}

/// Tolerances and iteration limit of inverse kinematics.
template <RealScalar Scalar>
struct IkSettings {
  /// A task counts as reached when its weighted residual is at most this (m).
  Scalar tolerance = Scalar(1e-4);
  /// q counts as a minimum when every entry |g_i| of the projected gradient is at most this times
  /// |J_i| |e| + |w (q_ref - q)_i|, the largest value that it could have.
  Scalar gradient_tolerance = default_gradient_tolerance();
  /// Weight w of the distance to the reference posture (m²/rad², beside residuals in m). With 0,
  /// only the damping determines the joints that the tasks leave free.
  Scalar posture_weight = Scalar(0);
  /// Initial damping μ of the damped least squares steps.
  Scalar damping = Scalar(1e-3);
  /// Largest number of steps in each attempt. The BFGS steps of InverseKinematics to targets out of
  /// reach may be 30 times as many.
  int max_iterations = 100;
  /// True to let InverseKinematics try its fallbacks and BFGS steps when targets were not reached.
  /// Targets out of reach then take several times as long.
  bool fallbacks = true;
  /// True to let PrioritisedIk go on, once all tasks are reached, for as long as the posture gets
  /// nearer to its reference. False to stop after one step: where targets move from frame to frame
  /// the posture follows over the frames.
  bool refine_posture = true;

  /// Returns 1e-6, or 4 √ε where that is larger (float).
  static Scalar default_gradient_tolerance() {
    using std::sqrt;
    const Scalar rounding = Scalar(4) * sqrt(scalar_traits<Scalar>::epsilon());
    const Scalar wished = Scalar(1e-6);
    return wished < rounding ? rounding : wished;
  }
  /// Returns an empty text when the settings are good, else what is wrong.
  std::string_view validate() const {
    const auto positive = [](const Scalar& v) { return is_finite(v) && v > Scalar(0); };
    if (!positive(tolerance)) return "tolerance is not a positive length";
    if (!positive(gradient_tolerance)) return "gradient_tolerance is not a positive number";
    if (!is_finite(posture_weight) || posture_weight < Scalar(0))
      return "posture_weight is negative or not finite";
    if (!positive(damping)) return "damping is not a positive number";
    if (max_iterations < 1) return "max_iterations is less than 1";
    return {};
  }
};

/// Which singular values of a task's Jacobian the pseudo-inverse damps. It replaces 1/σ by
/// σ / (σ² + λ²) for the singular value σ.
enum class PriorityDamping {
  /// λ² is damping² - σ² below σ = damping, and 0 above: well-conditioned tasks are met exactly.
  NearSingular,
  /// λ² is damping² for every σ: each task falls short by λ² / (σ² + λ²).
  Constant
};

/// Settings of prioritised inverse kinematics in addition to IkSettings: damping and rank.
template <RealScalar Scalar>
struct PrioritySettings {
  /// Damping of the pseudo-inverse, in the units of the Jacobians' entries (m for positions); 0
  /// switches it off.
  Scalar damping = Scalar(0.01);
  /// Which singular values are damped.
  PriorityDamping form = PriorityDamping::NearSingular;
  /// Rank threshold. A singular value below this share of the level's largest row length counts as
  /// zero: that direction neither moves the robot nor constrains later levels.
  Scalar rank_threshold = Scalar(1e-6);

  /// Returns an empty text when the settings are good, else what is wrong.
  std::string_view validate() const {
    if (!is_finite(damping) || damping < Scalar(0)) return "damping is negative or not finite";
    if (!is_finite(rank_threshold) || !(rank_threshold > Scalar(0)) ||
        !(rank_threshold < Scalar(1))) {
      return "rank_threshold is not between 0 and 1";
    }
    return {};
  }
};

/// Why inverse kinematics stopped.
enum class IkStatus {
  /// Every task is within the tolerance. Use q.
  Reached,
  /// q is a local minimum: the projected gradient is zero. The targets are out of reach, or another
  /// start may reach them.
  LocalMinimum,
  /// No step improves q although the gradient is not zero, because of rounding or of levels that
  /// contradict each other. Use q if `error` is small enough, else start elsewhere.
  Stalled,
  /// The iteration limit was reached; q is the best found. Allow more iterations, or start
  /// elsewhere.
  IterationLimit,
  /// A start, task, reference or setting was refused; `message` says which and why. q is unchanged,
  /// or only clamped to the limits. Correct the input.
  InvalidInput
};

/// Returns the name of a status.
constexpr std::string_view to_string(IkStatus status) {
  switch (status) {
    case IkStatus::Reached: return "reached";
    case IkStatus::LocalMinimum: return "local_minimum";
    case IkStatus::Stalled: return "stalled";
    case IkStatus::IterationLimit: return "iteration_limit";
    case IkStatus::InvalidInput: return "invalid_input";
  }
  return "unknown";
}

/// Result of inverse kinematics.
template <RealScalar Scalar>
struct IkReport {
  /// Why it stopped.
  IkStatus status = IkStatus::IterationLimit;
  /// Largest weighted residual of a task (m).
  Scalar error = scalar_traits<Scalar>::infinity();
  /// The minimised cost: half the sum of squared residuals, plus the posture's term (m²).
  Scalar cost = scalar_traits<Scalar>::infinity();
  /// Largest entry of the projected gradient, each divided by the largest value that this entry can
  /// have for the residual's length (see IkSettings::gradient_tolerance).
  Scalar gradient = scalar_traits<Scalar>::infinity();
  /// Number of steps tried in all attempts from all starts.
  int iterations = 0;
  /// Number of starts used.
  int starts = 1;
  /// With InvalidInput what was refused (a static text), else empty.
  std::string_view message;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
