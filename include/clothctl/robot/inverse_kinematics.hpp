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

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/robot/kinematic_tree_model.hpp"  // what is compiled once
#endif

namespace clothctl::inline CLOTHCTL_ABI {

/// Inverse kinematics of one robot for several tasks at once, by damped least squares. The
/// constructor allocates all memory.
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

  /// Solves from q. If that does not reach the targets, tries up to `restarts` random starts and
  /// stops at the first that reaches them. Starts are uniform within the limits; a coordinate
  /// without limits starts at its value in q. q becomes the best result. `uniform()` returns random
  /// numbers from [0, 1). Never allocates.
  template <class Uniform>
  IkReport<Scalar> solve(const Model& model, Tasks tasks, const View& reference,
                         Eigen::Ref<VectorX<Scalar>> q, int restarts, Uniform&& uniform);

 private:
  using Traits = articulated_traits<Model>;

  /// What to try when the first attempt does not reach the targets.
  struct Fallbacks {
    bool posture, stages;
  };

  /// Stores the better of `best` and `next` in `best`, with the sum of their iterations. Returns
  /// true when `next` was better.
  static bool keep_better(IkReport<Scalar>& best, IkReport<Scalar> next);

  IkReport<Scalar> solve_from(const Model& model, Tasks tasks, const View& reference,
                              Fallbacks fallbacks, Eigen::Ref<VectorX<Scalar>> q);

  /// Returns the lower bound of the damping μ: 3e-4, and proportionally less once the residual
  /// `error` is below a hundredth of the initial one, `first`. With less damping, joints jump
  /// between their limits.
  Scalar least_damping_at(const Scalar& error, const Scalar& first) const {
    const Scalar share = first > Scalar(0) ? Scalar(Scalar(100) * error / first) : Scalar(1);
    return (std::max)(scalar_traits<Scalar>::epsilon(),
                      Scalar(Scalar(3e-4) * (std::min)(Scalar(1), share)));
  }

  /// Iterates damped least squares from q to a minimum of the problem that `problem_` was started
  /// with.
  void descend(const Model& model, Tasks tasks, Eigen::Ref<VectorX<Scalar>> q,
               IkReport<Scalar>& report);

  /// Computes the damped step within the limits.
  void find_step(const Scalar& mu);

  /// Moves q to the local minimum by projected BFGS when the targets were not reached.
  void minimise(const Model& model, Tasks tasks, Eigen::Ref<VectorX<Scalar>> q,
                IkReport<Scalar>& report);

  /// Line search along step_, clamped to the limits. Returns true when it lowered the cost; step_
  /// is then the motion that q made.
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

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar> InverseKinematics<Model, Scalar>::InverseKinematics(
    const Model& model, int most_tasks, IkSettings<Scalar> settings)
    : settings_(settings),
      problem_(model, most_tasks),
      least_squares_(3 * Index((std::max)(most_tasks, 0)), Traits::nv(model)),
      bfgs_(Traits::nv(model)) {
  damping_.setZero(Traits::nv(model));
  step_ = direction_ = gone_ = damping_;
  lead_.setZero(3 * Index((std::max)(most_tasks, 0)));
  trial_.setZero(Traits::nq(model));
  start_ = begin_ = attempt_ = found_ = reference_ = trial_;
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
auto InverseKinematics<Model, Scalar>::solve(const Model& model, Tasks tasks, const View& reference,
                                             Eigen::Ref<VectorX<Scalar>> q) -> IkReport<Scalar> {
  IkReport<Scalar> report = solve_from(model, tasks, reference, {true, true}, q);
  minimise(model, tasks, q, report);
  return report;
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
template <class Uniform>
auto InverseKinematics<Model, Scalar>::solve(const Model& model, Tasks tasks, const View& reference,
                                             Eigen::Ref<VectorX<Scalar>> q, int restarts,
                                             Uniform&& uniform) -> IkReport<Scalar> {
  const Fallbacks quick{true, false}, slow{false, true};
  start_ = q;
  IkReport<Scalar> best =
      solve_from(model, tasks, reference, restarts > 0 ? quick : Fallbacks{true, true}, q);
  if (best.status == IkStatus::InvalidInput) return best;
  problem_.clamp(start_);
  // All starts have the same reference, else their costs could not be compared.
  const View drawn = reference_;
  found_ = q;
  for (int k = 1; k <= restarts && best.status != IkStatus::Reached; ++k) {
    q = start_;
    for (Index i = 0; i < q.size(); ++i) {
      if (problem_.has_limits(i)) q[i] = problem_.between(i, static_cast<Scalar>(uniform()));
    }
    if (keep_better(best, solve_from(model, tasks, drawn, quick, q))) found_ = q;
    best.starts = k + 1;
  }
  if (best.status != IkStatus::Reached && restarts > 0) {
    q = start_;
    if (keep_better(best, solve_from(model, tasks, drawn, slow, q))) found_ = q;
  }
  q = found_;
  minimise(model, tasks, q, best);
  return best;
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
bool InverseKinematics<Model, Scalar>::keep_better(IkReport<Scalar>& best, IkReport<Scalar> next) {
  next.iterations += best.iterations;
  next.starts = best.starts;
  const bool better = next.status == IkStatus::Reached || next.cost < best.cost;
  if (better) {
    best = next;
  } else {
    best.iterations = next.iterations;
  }
  return better;
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
auto InverseKinematics<Model, Scalar>::solve_from(const Model& model, Tasks tasks,
                                                  const View& reference, Fallbacks fallbacks,
                                                  Eigen::Ref<VectorX<Scalar>> q)
    -> IkReport<Scalar> {
  IkReport<Scalar> best;
  best.message = settings_.validate();
  if (best.message.empty()) best.message = problem_.validate(model, tasks, reference, q);
  if (!best.message.empty()) {
    best.status = IkStatus::InvalidInput;
    return best;
  }
  if (reference.size() > 0) reference_ = reference;  // a copy: the caller's may be q itself
  problem_.clamp(q);
  begin_ = q;
  if (reference.size() == 0) reference_ = begin_;
  const View drawn = reference_;
  problem_.start(tasks, drawn, settings_.posture_weight);
  descend(model, tasks, q, best);
  if (!is_finite(best.cost)) {
    best.status = IkStatus::InvalidInput;
    best.message = problem_.kNoPose;
  }
  if (!settings_.fallbacks || best.status == IkStatus::InvalidInput) return best;
  const auto again = [&](auto&& approach) {
    if (best.status == IkStatus::Reached) return;
    IkReport<Scalar> next;
    attempt_ = begin_;
    approach(next);
    problem_.start(tasks, drawn, settings_.posture_weight);
    descend(model, tasks, attempt_, next);
    if (keep_better(best, next)) q = attempt_;
  };
  if (best.iterations == 0) again([&](IkReport<Scalar>&) { leave_stationary_point(model); });
  if (fallbacks.posture)
    again([&](IkReport<Scalar>& next) { solve_with_posture(model, tasks, next); });
  if (fallbacks.stages)
    again([&](IkReport<Scalar>& next) { solve_in_stages(model, tasks, drawn, next); });
  return best;
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
void InverseKinematics<Model, Scalar>::descend(const Model& model, Tasks tasks,
                                               Eigen::Ref<VectorX<Scalar>> q,
                                               IkReport<Scalar>& report) {
  Scalar mu = settings_.damping;
  const int last = report.iterations + settings_.max_iterations;
  report.cost = problem_.evaluate(model, tasks, q);
  if (!is_finite(report.cost)) return;
  const Scalar first = problem_.largest_residual();
  for (;;) {
    report.error = problem_.largest_residual();
    const bool reached = report.error <= settings_.tolerance;
    report.status = reached ? IkStatus::Reached : IkStatus::LocalMinimum;
    if (reached && !(problem_.weight() > Scalar(0))) return;
    problem_.linearise(model, tasks, q);
    report.gradient = problem_.projected_gradient();
    if (report.gradient <= settings_.gradient_tolerance) return;
    if (!reached) report.status = IkStatus::Stalled;  // until a step helps
    for (bool lower = false; !lower;) {
      if (report.iterations == last) {
        if (!reached) report.status = IkStatus::IterationLimit;
        return;
      }
      ++report.iterations;
      find_step(mu);
      Traits::advance(model, q, step_, trial_);
      problem_.clamp(trial_);
      const Scalar cost = problem_.evaluate(model, tasks, trial_);
      lower = cost < report.cost;
      if (lower) {
        q = trial_;
        report.cost = cost;
        mu = (std::max)(least_damping_at(report.error, first), Scalar(mu / Scalar(5)));
      } else {
        mu *= Scalar(4);
        if (!(mu < Scalar(1e12))) return;  // rounding: no step lowers the cost
      }
    }
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
void InverseKinematics<Model, Scalar>::find_step(const Scalar& mu) {
  const VectorX<Scalar>& squares = problem_.squares();
  const Scalar steepest = squares.maxCoeff();
  const Scalar floor = steepest > Scalar(0) ? Scalar(0) : Scalar(1);
  damping_ =
      (problem_.weight() + floor + mu * (squares.array() + Scalar(1e-3) * steepest)).matrix();
  least_squares_.solve(problem_.jacobian(), problem_.residuals(), problem_.pull(), damping_,
                       problem_.below(), problem_.above(), step_);
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
void InverseKinematics<Model, Scalar>::minimise(const Model& model, Tasks tasks,
                                                Eigen::Ref<VectorX<Scalar>> q,
                                                IkReport<Scalar>& report) {
  using std::sqrt;
  const bool ended = report.status == IkStatus::Reached || report.status == IkStatus::InvalidInput;
  if (!settings_.fallbacks || ended || step_.size() == 0) return;
  if (report.gradient <= settings_.gradient_tolerance) return;
  const int last = report.iterations + 30 * settings_.max_iterations;
  report.cost = problem_.evaluate(model, tasks, q);
  problem_.linearise(model, tasks, q);
  const auto start = [&] {
    const Scalar lever = sqrt(problem_.squares().mean()),
                 length = sqrt(problem_.residuals().squaredNorm());
    bfgs_.start(problem_.jacobian(), lever * (lever + length) + scalar_traits<Scalar>::epsilon());
  };
  start();
  for (bool fresh = true;;) {
    report.error = problem_.largest_residual();
    report.gradient = problem_.projected_gradient();
    const bool reached = report.error <= settings_.tolerance;
    report.status = reached ? IkStatus::Reached : IkStatus::LocalMinimum;
    if (reached || report.gradient <= settings_.gradient_tolerance) return;
    report.status = IkStatus::Stalled;  // until a step helps
    if (report.iterations >= last) {
      report.status = IkStatus::IterationLimit;
      return;
    }
    direction_ = problem_.direction();
    bfgs_.find_step(direction_, problem_.below(), problem_.above(), step_);
    if (search(model, tasks, q, report)) {
      direction_ -= problem_.direction();
      bfgs_.update(step_, direction_);
      fresh = false;
    } else {
      problem_.evaluate(model, tasks, q);
      if (fresh) return;  // rounding: no step lowers the cost
      start();
      fresh = true;
    }
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
bool InverseKinematics<Model, Scalar>::search(const Model& model, Tasks tasks,
                                              Eigen::Ref<VectorX<Scalar>> q,
                                              IkReport<Scalar>& report) {
  for (int halving = 0; halving < 40; ++halving) {
    ++report.iterations;
    Traits::advance(model, q, step_, trial_);
    problem_.clamp(trial_);
    Traits::difference(model, q, trial_, gone_);
    const Scalar cost = problem_.evaluate(model, tasks, trial_);
    if (cost < report.cost - Scalar(1e-4) * direction_.dot(gone_)) {
      q = trial_;
      report.cost = cost;
      problem_.linearise(model, tasks, q);
      step_ = gone_;
      return true;
    }
    step_ *= Scalar(0.5);
  }
  return false;
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
void InverseKinematics<Model, Scalar>::leave_stationary_point(const Model& model) {
  for (Index i = 0; i < step_.size(); ++i) step_[i] = i % 2 == 0 ? Scalar(0.01) : Scalar(-0.02);
  Traits::advance(model, begin_, step_, attempt_);
  problem_.clamp(attempt_);
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
void InverseKinematics<Model, Scalar>::solve_in_stages(const Model& model, Tasks tasks,
                                                       const View& drawn,
                                                       IkReport<Scalar>& report) {
  constexpr int kStages = 16;
  problem_.start(tasks, drawn, settings_.posture_weight);
  problem_.evaluate(model, tasks, begin_);
  const Index rows = problem_.rows();
  lead_.head(rows) = problem_.current_residuals();
  for (int stage = 1; stage < kStages; ++stage) {
    problem_.lead(lead_.head(rows), Scalar(float(kStages - stage)) / Scalar(float(kStages)));
    descend(model, tasks, attempt_, report);
    if (report.error > Scalar(100) * settings_.tolerance) return;  // a stage was not reached
  }
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class InverseKinematics<KinematicTree<double>, double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
