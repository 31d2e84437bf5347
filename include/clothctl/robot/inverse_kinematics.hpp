#pragma once

// Inverse kinematics by Levenberg-Marquardt with joint limits:
//
//   min ½ |e(q)|² + ½ w |q - q_ref|²,   lower ≤ q ≤ upper
//   (JᵀJ + D) dq = Jᵀ e + w (q_ref - q),   D = w + μ (diag(JᵀJ) + 1e-3 s),   s the largest of diag(JᵀJ)
//
// A step that does not lower the cost is taken shorter, with a larger μ. Where that ends short of the targets it is tried again
// from the start: first with a weight that keeps it near there, then with targets that are led from where the frames are to
// where they are to be. What is out of reach is followed to its minimum by quasi-Newton steps (limited_bfgs.hpp). Reference:
// Levenberg (1944), Marquardt (1963).

#include <cmath>

#include "clothctl/robot/ik_problem.hpp"
#include "clothctl/robot/limited_bfgs.hpp"
#include "clothctl/robot/limited_step.hpp"

namespace clothctl::robot {

/// Inverse kinematics of one robot for up to so many tasks at once. All memory is made here.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedModel<Model, Scalar>
class InverseKinematics {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// Several tasks.
  using Tasks = std::span<const IkTask<Scalar>>;

  /// Makes room. Allocates.
  InverseKinematics(const Model& model, int most_tasks, IkSettings<Scalar> settings = {})
      : settings_(settings),
        problem_(model, most_tasks),
        limited_(3 * Index(most_tasks), Traits::velocities(model)),
        bfgs_(Traits::velocities(model)) {
    damping_.setZero(Traits::velocities(model));
    step_ = direction_ = gone_ = damping_;
    lead_.setZero(3 * Index(most_tasks));
    trial_.setZero(Traits::positions(model));
    start_ = begin_ = attempt_ = reference_ = posture_ = found_ = trial_;
  }

  /// The settings.
  const IkSettings<Scalar>& settings() const { return settings_; }

  /// Moves q to a minimum of the tasks' residuals within the limits, from q (moved into its limits first). `reference` (may be
  /// empty: q) is what the posture weight draws to. Never allocates. Complexity: O(rows² n + rows³) an iteration.
  IkReport<Scalar> solve(const Model& model, Tasks tasks, const View& reference, Eigen::Ref<VectorX<Scalar>> q) {
    IkReport<Scalar> report = solve_from(model, tasks, reference, {true, true}, q);
    settle(model, tasks, q, report);
    return report;
  }

  /// The same from q, and while that does not reach from up to `restarts` other starts, drawn evenly within the limits
  /// (unlimited coordinates keep q's); q becomes the best found. `uniform()` draws from [0, 1). Never allocates.
  template <class Uniform>
  IkReport<Scalar> solve(const Model& model, Tasks tasks, const View& reference, Eigen::Ref<VectorX<Scalar>> q, int restarts,
                         Uniform&& uniform) {
    const Ways quick{true, false}, slow{false, true};
    start_ = q;
    IkReport<Scalar> best = solve_from(model, tasks, reference, restarts > 0 ? quick : Ways{true, true}, q);
    if (best.status == IkStatus::InvalidInput) return best;
    posture_ = reference_;  // other starts have the first one's, or costs could not be compared
    found_ = q;
    for (int k = 1; k <= restarts && best.status != IkStatus::Reached; ++k) {
      q = start_;
      for (Index i = 0; i < q.size(); ++i) {
        if (problem_.limited(i)) q[i] = problem_.between(i, static_cast<Scalar>(uniform()));
      }
      if (keep_better(best, solve_from(model, tasks, posture_, quick, q))) found_ = q;
      best.starts = k + 1;
    }
    if (best.status != IkStatus::Reached && restarts > 0) {
      q = start_;
      if (keep_better(best, solve_from(model, tasks, posture_, slow, q))) found_ = q;
    }
    q = found_;
    settle(model, tasks, q, best);
    return best;
  }

 private:
  using Traits = articulated_traits<Model>;

  /// What to try where the first attempt does not reach.
  struct Ways {
    bool near, led;
  };

  /// Takes the better of two reports, with the iterations of both. Answers whether it is the second.
  static bool keep_better(IkReport<Scalar>& best, IkReport<Scalar> next) {
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

  IkReport<Scalar> solve_from(const Model& model, Tasks tasks, const View& reference, Ways ways,
                              Eigen::Ref<VectorX<Scalar>> q) {
    IkReport<Scalar> best;
    best.message = settings_.check();
    if (best.message.empty()) best.message = problem_.check(model, tasks, reference, q);
    if (!best.message.empty()) {
      best.status = IkStatus::InvalidInput;
      return best;
    }
    problem_.limit(q);
    begin_ = q;
    if (reference.size() > 0) {
      reference_ = reference;
    } else {
      reference_ = q;
    }
    problem_.start(tasks, reference_, settings_.posture_weight);
    descend(model, tasks, q, best);
    if (!is_finite(best.cost)) {
      best.status = IkStatus::InvalidInput;
      best.message = "q has no finite pose: a quaternion of zero, or numbers that overflow";
    }
    if (!settings_.fallbacks || best.status == IkStatus::InvalidInput) return best;
    const auto again = [&](auto&& approach) {
      if (best.status == IkStatus::Reached) return;
      IkReport<Scalar> next;
      attempt_ = begin_;
      approach(next);
      problem_.start(tasks, reference_, settings_.posture_weight);
      descend(model, tasks, attempt_, next);
      if (keep_better(best, next)) q = attempt_;
    };
    if (best.iterations == 0) again([&](IkReport<Scalar>&) { nudge(model); });
    if (ways.near) again([&](IkReport<Scalar>& next) { stay_near(model, tasks, next); });
    if (ways.led) again([&](IkReport<Scalar>& next) { follow(model, tasks, next); });
    return best;
  }

  /// With less than this, joints are thrown to their limits and back; it falls once the residual is a hundredth of the first.
  Scalar least_damping_at(const Scalar& error, const Scalar& first) const {
    const Scalar share = first > Scalar(0) ? Scalar(Scalar(100) * error / first) : Scalar(1);
    return (std::max)(scalar_traits<Scalar>::epsilon(), Scalar(Scalar(3e-4) * (std::min)(Scalar(1), share)));
  }

  /// Steps from q to a minimum of the problem as it was started.
  void descend(const Model& model, Tasks tasks, Eigen::Ref<VectorX<Scalar>> q, IkReport<Scalar>& report) {
    Scalar mu = settings_.damping;
    const int last = report.iterations + settings_.max_iterations;
    report.cost = problem_.place(model, tasks, q);
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
        problem_.limit(trial_);
        const Scalar cost = problem_.place(model, tasks, trial_);
        lower = cost < report.cost;
        if (lower) {
          q = trial_;
          report.cost = cost;
          mu = (std::max)(least_damping_at(report.error, first), Scalar(mu / Scalar(5)));
        } else {
          mu *= Scalar(4);
          if (!(mu < Scalar(1e12))) return;  // no step is short enough: rounding
        }
      }
    }
  }

  /// The damped step within the limits.
  void find_step(const Scalar& mu) {
    const VectorX<Scalar>& squares = problem_.squares();
    const Scalar steepest = squares.maxCoeff();
    const Scalar floor = steepest > Scalar(0) ? Scalar(0) : Scalar(1);
    damping_ = (problem_.weight() + floor + mu * (squares.array() + Scalar(1e-3) * steepest)).matrix();
    limited_.solve(problem_.jacobian(), problem_.residuals(), problem_.pull(), damping_, problem_.below(), problem_.above(),
                   step_);
  }

  /// Follows what was not reached to its minimum.
  void settle(const Model& model, Tasks tasks, Eigen::Ref<VectorX<Scalar>> q, IkReport<Scalar>& report) {
    using std::sqrt;
    const bool ended = report.status == IkStatus::Reached || report.status == IkStatus::InvalidInput;
    if (!settings_.fallbacks || ended || step_.size() == 0) return;
    if (report.gradient <= settings_.gradient_tolerance) return;
    const int last = report.iterations + 30 * settings_.max_iterations;
    report.cost = problem_.place(model, tasks, q);
    problem_.linearise(model, tasks, q);
    const auto start = [&] {
      const Scalar lever = sqrt(problem_.squares().mean()), length = sqrt(problem_.residuals().squaredNorm());
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
        problem_.place(model, tasks, q);
        if (fresh) return;  // no step is short enough: rounding
        start();
        fresh = true;
      }
    }
  }

  /// Goes along the step, or a part of it, moved into the limits; the step becomes what was gone. Answers whether that lowered
  /// the cost.
  bool search(const Model& model, Tasks tasks, Eigen::Ref<VectorX<Scalar>> q, IkReport<Scalar>& report) {
    for (int halving = 0; halving < 40; ++halving) {
      ++report.iterations;
      Traits::advance(model, q, step_, trial_);
      problem_.limit(trial_);
      Traits::difference(model, q, trial_, gone_);
      const Scalar cost = problem_.place(model, tasks, trial_);
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

  /// Leaves a place where the gradient is zero for want of a side to go to: a stretched arm whose target lies in its own line.
  void nudge(const Model& model) {
    for (Index i = 0; i < step_.size(); ++i) step_[i] = i % 2 == 0 ? Scalar(0.01) : Scalar(-0.02);
    Traits::advance(model, begin_, step_, attempt_);
    problem_.limit(attempt_);
  }

  /// Steps with a posture weight that draws to the start.
  void stay_near(const Model& model, Tasks tasks, IkReport<Scalar>& report) {
    problem_.start(tasks, begin_, (std::max)(settings_.posture_weight, Scalar(1e-3)));
    descend(model, tasks, attempt_, report);
  }

  /// Steps with targets that go from where the frames are to where they are to be.
  void follow(const Model& model, Tasks tasks, IkReport<Scalar>& report) {
    constexpr int kStages = 16;
    problem_.start(tasks, reference_, settings_.posture_weight);
    problem_.place(model, tasks, begin_);
    const Index rows = problem_.rows();
    lead_.head(rows) = problem_.placed_residuals();
    for (int stage = 1; stage < kStages; ++stage) {
      problem_.lead(lead_.head(rows), Scalar(float(kStages - stage)) / Scalar(float(kStages)));
      descend(model, tasks, attempt_, report);
      if (report.error > Scalar(100) * settings_.tolerance) return;  // off the way
    }
  }

  IkSettings<Scalar> settings_;
  IkProblem<Model, Scalar> problem_;
  LimitedStep<Scalar> limited_;
  LimitedBfgs<Scalar> bfgs_;
  VectorX<Scalar> damping_, step_, direction_, gone_, lead_;
  VectorX<Scalar> trial_, start_, begin_, attempt_, reference_, posture_, found_;
};

}  // namespace clothctl::robot
