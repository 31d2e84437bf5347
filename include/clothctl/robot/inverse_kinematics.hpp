#pragma once

// Inverse kinematics for several tasks with joint limits, by damped least squares (Levenberg-
// Marquardt; its step is the damped pseudo-inverse of the Jacobian):
//
//   min ½ |e(q)|² + ½ w |q - q_ref|²,   lower ≤ q ≤ upper
//   (JᵀJ + D) dq = Jᵀ e + w (q_ref - q),   D = w + μ (diag(JᵀJ) + 1e-3 s),   s = max diag(JᵀJ)
//
// When a step does not lower the cost, μ grows and the step is computed again. When the targets are
// not reached, two fallbacks try again from the start: one adds a posture weight that keeps q near
// the start, the other moves the targets in 16 stages from the frames' poses to the real targets.
// Targets out of reach are approached to their local minimum by projected BFGS steps.
//
// Reference: Levenberg (1944); Marquardt (1963); Wampler (1986) and Nakamura, Hanafusa (1986) for
// robots.

#include <algorithm>
#include <cmath>

#include "clothctl/robot/detail/damped_least_squares.hpp"
#include "clothctl/robot/detail/ik_problem.hpp"
#include "clothctl/robot/detail/projected_bfgs.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Inverse kinematics of one robot for several tasks at once, by damped least squares. The
/// constructor makes all memory.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedModel<Model, Scalar>
class InverseKinematics {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// Several tasks.
  using Tasks = std::span<const IkTask<Scalar>>;

  /// Makes room for `most_tasks` tasks; a negative number counts as 0. Allocates.
  InverseKinematics(const Model& model, int most_tasks, IkSettings<Scalar> settings = {});

  /// Returns the settings.
  const IkSettings<Scalar>& settings() const { return settings_; }

  /// Moves q (nq) from its value, clamped to the limits, to a minimum of the tasks' residuals
  /// within the limits. `reference` (nq, or empty for the start) is the posture that the posture
  /// weight prefers. Never allocates. Complexity: O(rows² nv + rows³) for each iteration. Fails
  /// when: see IkStatus.
  IkReport<Scalar> solve(const Model& model, Tasks tasks, const View& reference,
                         Eigen::Ref<VectorX<Scalar>> q);

  /// Solves from q. If that does not reach the targets, tries up to `restarts` random starts, and
  /// ends at the first that does. Starts are uniform within the limits; a coordinate without limits
  /// starts at its value in q. q becomes the best result. `uniform()` returns random numbers from
  /// [0, 1). Never allocates.
  template <class Uniform>
  IkReport<Scalar> solve(const Model& model, Tasks tasks, const View& reference,
                         Eigen::Ref<VectorX<Scalar>> q, int restarts, Uniform&& uniform);

 private:
  using Traits = articulated_traits<Model>;

  /// What to try when the first attempt does not reach the targets.
  struct Fallbacks {
    bool posture, stages;
  };

  /// Keeps the better of two reports in `best`, with the iterations of both. Returns true when it
  /// is the second.
  static bool keep_better(IkReport<Scalar>& best, IkReport<Scalar> next);

  IkReport<Scalar> solve_from(const Model& model, Tasks tasks, const View& reference,
                              Fallbacks fallbacks, Eigen::Ref<VectorX<Scalar>> q);

  /// Returns the least damping. Less of it makes joints jump between their limits. It falls once
  /// the residual is below a hundredth of the first one.
  Scalar least_damping_at(const Scalar& error, const Scalar& first) const {
    const Scalar share = first > Scalar(0) ? Scalar(Scalar(100) * error / first) : Scalar(1);
    return (std::max)(scalar_traits<Scalar>::epsilon(),
                      Scalar(Scalar(3e-4) * (std::min)(Scalar(1), share)));
  }

  /// Iterates damped least squares from q to a minimum of the problem as it was started.
  void descend(const Model& model, Tasks tasks, Eigen::Ref<VectorX<Scalar>> q,
               IkReport<Scalar>& report);

  /// Computes the damped step within the limits.
  void find_step(const Scalar& mu);

  /// Moves q to the local minimum by projected BFGS when the targets were not reached.
  void minimise(const Model& model, Tasks tasks, Eigen::Ref<VectorX<Scalar>> q,
                IkReport<Scalar>& report);

  /// Line search along the step, clamped to the limits. The step becomes the motion that was made.
  /// Returns true when it lowered the cost.
  bool search(const Model& model, Tasks tasks, Eigen::Ref<VectorX<Scalar>> q,
              IkReport<Scalar>& report);

  /// Moves the start of the next attempt away from a stationary point: the gradient of a stretched
  /// arm is zero when its target lies on the arm's own line.
  void leave_stationary_point(const Model& model);

  /// Fallback: iterates with a posture weight that keeps q near the start.
  void solve_with_posture(const Model& model, Tasks tasks, IkReport<Scalar>& report) {
    problem_.start(tasks, begin_, (std::max)(settings_.posture_weight, Scalar(1e-3)));
    descend(model, tasks, attempt_, report);
  }

  /// Fallback: iterates while the targets move in stages from the frames' poses to the real
  /// targets.
  void solve_in_stages(const Model& model, Tasks tasks, const View& drawn,
                       IkReport<Scalar>& report);

  IkSettings<Scalar> settings_;
  detail::IkProblem<Model, Scalar> problem_;
  detail::DampedLeastSquares<Scalar> least_squares_;
  detail::ProjectedBfgs<Scalar> bfgs_;
  VectorX<Scalar> damping_, step_, direction_, gone_, lead_;
  VectorX<Scalar> trial_, start_, begin_, attempt_, found_, reference_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/robot/detail/inverse_kinematics_impl.hpp"
