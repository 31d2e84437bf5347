#pragma once

// Members of PrioritisedIk (clothctl/robot/prioritised_ik.hpp).

#include "clothctl/robot/prioritised_ik.hpp"

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/robot/kinematic_tree_model.hpp"
#endif

namespace clothctl::inline CLOTHCTL_ABI {

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
    if (report.status == IkStatus::Reached && !posture_) return report;
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
