#pragma once

// Prioritised inverse kinematics: tasks on levels. The first level is met as well as possible, the
// second as well as the first allows, and so on. The reference posture is the last level. A step is
//
//   dq = Σ_k A_k⁺ (e_k - J_k dq_(k-1)) + N (q_ref - q),   A_k = J_k N_(k-1)
//
// with the damped pseudo-inverse A⁺ and the projector N on the directions that no level uses
// (detail/task_priority.hpp). When a step would move joints beyond their limits, those joints are
// fixed at their limits and the step is computed again. A step is accepted when it is better at the
// first level whose cost it changes. Otherwise the step is computed again without the last levels,
// and then it is halved.
//
// Reference: Siciliano, Slotine, ICAR (1991); [Toh 2011], ch. 3.

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "clothctl/robot/detail/ik_problem.hpp"
#include "clothctl/robot/detail/task_priority.hpp"

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/robot/kinematic_tree_model.hpp"  // what is compiled once
#endif

namespace clothctl::inline CLOTHCTL_ABI {

/// Inverse kinematics of one robot for tasks on levels of priority. The constructor makes all
/// memory. Damping and rank are set by PrioritySettings (ik_task.hpp).
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedModel<Model, Scalar>
class PrioritisedIk {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// Several tasks.
  using Tasks = std::span<const IkTask<Scalar>>;

  /// Makes room for `most_tasks` tasks on `most_levels` levels; a negative number counts as 0.
  /// Allocates.
  PrioritisedIk(const Model& model, int most_tasks, int most_levels,
                IkSettings<Scalar> settings = {}, PrioritySettings<Scalar> priority = {});

  /// Moves q (nq) to positions that meet `tasks` by priority. The first `levels[0]` tasks are the
  /// first level, the next `levels[1]` tasks the second, and so on. `reference` (nq, or empty for
  /// none) is the posture that directions free of tasks go to. The status means
  ///
  /// * Reached: every task of every level is reached.
  /// * LocalMinimum: the gradient of all residuals is zero.
  /// * Stalled: no step is better by priority. Tasks out of reach mostly end like this;
  ///   `level_error` tells which level falls short. `InverseKinematics` moves on to the minimum in
  ///   such cases.
  ///
  /// Never allocates. Fails when: see IkStatus.
  IkReport<Scalar> solve(const Model& model, Tasks tasks, std::span<const int> levels,
                         const View& reference, Eigen::Ref<VectorX<Scalar>> q);

  /// Returns the largest weighted residual of level k after a solve (m), infinite where there is no
  /// such level.
  Scalar level_error(std::size_t k) const {
    return k < errors_.size() ? errors_[k] : scalar_traits<Scalar>::infinity();
  }

 private:
  using Traits = articulated_traits<Model>;

  std::string_view validate(const Model& model, Tasks tasks, std::span<const int> levels,
                            const View& reference, const View& q) const;

  /// Writes each level's cost, half the sum of its squared residuals, after the last `evaluate`,
  /// and its largest residual.
  void measure(std::span<const int> levels, std::vector<Scalar>& costs);

  /// Takes the first step that is better, in the order: all levels, fewer levels, all levels at
  /// half the length, and so on. Returns true when there was one.
  bool find_better(const Model& model, Tasks tasks, std::span<const int> levels,
                   Eigen::Ref<VectorX<Scalar>> q, IkReport<Scalar>& report);

  void find_step(const Model& model, std::span<const int> levels, bool with_posture, const View& q);

  /// Takes the step if it is better. Returns true when q moved.
  bool take_step(const Model& model, Tasks tasks, std::span<const int> levels,
                 Eigen::Ref<VectorX<Scalar>> q, IkReport<Scalar>& report);

  /// Returns true when the step goes towards the reference posture, to first order. Where the
  /// tasks are met nothing else makes a trial better.
  bool nears_posture(const Model& model, const View& q) {
    if (!posture_) return false;
    Traits::difference(model, q, reference_, pull_);
    const Scalar change = Scalar(2) * pull_.dot(step_) - step_.squaredNorm();
    return change > settings_.gradient_tolerance * pull_.squaredNorm();
  }

  /// Returns true when the trial is better than q at the first level whose cost differs. Levels
  /// that both meet to the tolerance do not differ. If no level differs, the reference posture
  /// decides.
  bool better(const Model& model, std::span<const int> levels, const View& q);

  IkSettings<Scalar> settings_;
  detail::IkProblem<Model, Scalar> problem_;
  detail::TaskPriority<Scalar> priority_;
  std::vector<Scalar> costs_, trial_costs_, errors_;
  std::vector<char> held_;
  MatrixX<Scalar> steps_;  // column k: the step of the first k levels
  VectorX<Scalar> step_, pull_, trial_, reference_;
  bool posture_ = false;
};

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar> PrioritisedIk<Model, Scalar>::PrioritisedIk(
    const Model& model, int most_tasks, int most_levels, IkSettings<Scalar> settings,
    PrioritySettings<Scalar> priority)
    : settings_(settings),
      problem_(model, most_tasks),
      priority_(Traits::nv(model), 3 * Index((std::max)(most_tasks, 0)), priority) {
  const auto levels = static_cast<std::size_t>((std::max)(most_levels, 0));
  for (std::vector<Scalar>* costs : {&costs_, &trial_costs_}) costs->assign(levels, Scalar(0));
  errors_.assign(levels, Scalar(0));
  held_.assign(static_cast<std::size_t>(Traits::nv(model)), 0);
  step_.setZero(Traits::nv(model));
  steps_.setZero(step_.size(), static_cast<Index>(levels) + 1);
  pull_ = step_;
  trial_.setZero(Traits::nq(model));
  reference_ = trial_;
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
auto PrioritisedIk<Model, Scalar>::solve(const Model& model, Tasks tasks,
                                         std::span<const int> levels, const View& reference,
                                         Eigen::Ref<VectorX<Scalar>> q) -> IkReport<Scalar> {
  IkReport<Scalar> report;
  report.message = validate(model, tasks, levels, reference, q);
  if (!report.message.empty()) {
    report.status = IkStatus::InvalidInput;
    return report;
  }
  problem_.clamp(q);
  problem_.start(tasks, q, Scalar(0));
  posture_ = reference.size() > 0;
  if (posture_) reference_ = reference;
  report.cost = problem_.evaluate(model, tasks, q);
  if (!is_finite(report.cost)) {
    report.status = IkStatus::InvalidInput;
    report.message = problem_.kNoPose;
    return report;
  }
  measure(levels, costs_);
  for (;;) {
    report.error = problem_.largest_residual();
    report.status = report.error <= settings_.tolerance ? IkStatus::Reached : IkStatus::Stalled;
    const bool go_on = posture_ && (settings_.refine_posture || report.iterations == 0);
    if (report.status == IkStatus::Reached && !go_on) return report;
    if (step_.size() == 0) return report;
    if (report.iterations == settings_.max_iterations) {
      if (report.status != IkStatus::Reached) report.status = IkStatus::IterationLimit;
      return report;
    }
    problem_.linearise(model, tasks, q);
    report.gradient = problem_.projected_gradient();
    ++report.iterations;
    if (!find_better(model, tasks, levels, q, report)) {
      problem_.evaluate(model, tasks, q);
      measure(levels, costs_);
      const bool still = report.gradient <= settings_.gradient_tolerance;
      if (report.status == IkStatus::Stalled && still) report.status = IkStatus::LocalMinimum;
      return report;
    }
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar> std::string_view PrioritisedIk<Model, Scalar>::validate(
    const Model& model, Tasks tasks, std::span<const int> levels, const View& reference,
    const View& q)
const {
  if (const std::string_view fault = settings_.validate(); !fault.empty()) return fault;
  if (const std::string_view fault = priority_.settings().validate(); !fault.empty()) return fault;
  if (levels.size() > costs_.size()) return "there are more levels than memory was made for";
  std::size_t sum = 0;
  for (const int count : levels) {
    if (count < 1) return "a level has no task";
    sum += static_cast<std::size_t>(count);
  }
  if (sum != tasks.size()) return "the levels' counts do not add up to the number of tasks";
  return problem_.validate(model, tasks, reference, q);
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
void PrioritisedIk<Model, Scalar>::measure(std::span<const int> levels,
                                           std::vector<Scalar>& costs) {
  Index row = 0;
  for (std::size_t k = 0; k < levels.size(); ++k) {
    const Index rows = 3 * Index(levels[k]);
    costs[k] = Scalar(0.5) * problem_.current_residuals().segment(row, rows).squaredNorm();
    errors_[k] = problem_.largest_residual(row, rows);
    row += rows;
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
bool PrioritisedIk<Model, Scalar>::find_better(const Model& model, Tasks tasks,
                                               std::span<const int> levels,
                                               Eigen::Ref<VectorX<Scalar>> q,
                                               IkReport<Scalar>& report) {
  const std::size_t least = levels.empty() ? 0 : 1;  // without levels only the posture moves q
  Scalar share(1);
  for (int halving = 0; halving < 10; ++halving) {
    for (std::size_t served = levels.size() + 1; served-- > least;) {
      const Index column = static_cast<Index>(served);
      if (halving == 0) {
        find_step(model, levels.first(served), served == levels.size(), q);
        steps_.col(column) = step_;
      }
      step_ = share * steps_.col(column);
      if (report.status == IkStatus::Reached && !nears_posture(model, q)) continue;
      if (take_step(model, tasks, levels, q, report)) return true;
    }
    share *= Scalar(0.5);
  }
  return false;
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
void PrioritisedIk<Model, Scalar>::find_step(const Model& model, std::span<const int> levels,
                                             bool with_posture, const View& q) {
  std::fill(held_.begin(), held_.end(), char(0));
  const Index n = step_.size();
  with_posture = with_posture && posture_;
  if (with_posture) Traits::difference(model, q, reference_, pull_);
  for (Index round = 0; round <= n; ++round) {
    priority_.start();
    for (Index i = 0; i < n; ++i) {
      if (held_[static_cast<std::size_t>(i)] != 0) priority_.hold(i, step_[i]);
    }
    Index row = 0;
    for (const int count : levels) {
      const Index rows = 3 * Index(count);
      priority_.add(problem_.jacobian().middleRows(row, rows),
                    problem_.residuals().segment(row, rows));
      row += rows;
    }
    if (with_posture) priority_.add_posture(pull_);
    bool beyond = false;
    for (Index i = 0; i < n; ++i) {
      if (held_[static_cast<std::size_t>(i)] != 0) continue;
      const Scalar wish = priority_.velocity()[i];
      step_[i] = (std::min)((std::max)(wish, problem_.below()[i]), problem_.above()[i]);
      if (!(step_[i] < wish) && !(step_[i] > wish)) continue;
      beyond = true;
      held_[static_cast<std::size_t>(i)] = 1;
    }
    if (!beyond) break;
  }
  const Scalar largest = step_.cwiseAbs().maxCoeff(), most(0.5);
  if (largest > most) step_ *= most / largest;
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
bool PrioritisedIk<Model, Scalar>::take_step(const Model& model, Tasks tasks,
                                             std::span<const int> levels,
                                             Eigen::Ref<VectorX<Scalar>> q,
                                             IkReport<Scalar>& report) {
  const Scalar still = Scalar(16) * scalar_traits<Scalar>::epsilon();
  if (!(step_.cwiseAbs().maxCoeff() > still)) return false;
  Traits::advance(model, q, step_, trial_);
  problem_.clamp(trial_);
  const Scalar cost = problem_.evaluate(model, tasks, trial_);
  measure(levels, trial_costs_);
  if (!is_finite(cost) || !better(model, levels, q)) return false;
  q = trial_;
  report.cost = cost;
  std::swap(costs_, trial_costs_);
  return true;
}

template <class Model, RealScalar Scalar>
requires ArticulatedModel<Model, Scalar>
bool PrioritisedIk<Model, Scalar>::better(const Model& model, std::span<const int> levels,
                                          const View& q) {
  const Scalar met = Scalar(0.5) * settings_.tolerance * settings_.tolerance,
               margin = settings_.gradient_tolerance;
  for (std::size_t k = 0; k < levels.size(); ++k) {
    const Scalar now = (std::max)(costs_[k], met), next = (std::max)(trial_costs_[k], met);
    if (next < now * (Scalar(1) - margin)) return true;
    if (next > now * (Scalar(1) + margin)) return false;
  }
  if (!posture_) return false;
  Traits::difference(model, q, reference_, pull_);
  const Scalar now = pull_.squaredNorm();
  Traits::difference(model, trial_, reference_, pull_);
  return pull_.squaredNorm() < now * (Scalar(1) - margin);
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class PrioritisedIk<KinematicTree<double>, double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
