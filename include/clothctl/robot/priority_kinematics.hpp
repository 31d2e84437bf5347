#pragma once

// Inverse kinematics by rank: poses that serve a first level of tasks as well as can be, then a second as far as the first
// allows, and so on, with the reference posture last:
//
//   dq = Σ_k A_k⁺ (e_k - J_k dq_(k-1)) + N (q_ref - q),   A_k = J_k N_(k-1)
//
// Joints that a step would take beyond a limit are bound to it before the first level, and the step is found again. A step is
// taken if it is better by rank: at the first level where it makes a difference. If not, later levels are left out of it, and
// then it is shortened.

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "clothctl/robot/ik_problem.hpp"
#include "clothctl/robot/task_priority.hpp"

namespace clothctl::robot {

/// Inverse kinematics of one robot for up to so many tasks on so many levels. All memory is made here.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedModel<Model, Scalar>
class PriorityKinematics {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// Several tasks.
  using Tasks = std::span<const IkTask<Scalar>>;

  /// Makes room. Allocates.
  PriorityKinematics(const Model& model, int most_tasks, int most_levels, IkSettings<Scalar> settings = {},
                     PrioritySettings<Scalar> priority = {})
      : settings_(settings),
        problem_(model, most_tasks),
        priority_(Traits::velocities(model), 3 * Index(most_tasks), priority) {
    const auto levels = static_cast<std::size_t>(most_levels);
    for (std::vector<Scalar>* costs : {&costs_, &trial_costs_}) costs->assign(levels, Scalar(0));
    errors_.assign(levels, Scalar(0));
    held_.assign(static_cast<std::size_t>(Traits::velocities(model)), 0);
    step_.setZero(Traits::velocities(model));
    pull_ = step_;
    trial_.setZero(Traits::positions(model));
    reference_ = trial_;
  }

  /// Moves q to a pose that serves `tasks` by rank: the first `levels[0]` of them are the first level, the next `levels[1]` the
  /// second … `reference` (may be empty) is the posture that what is left free draws to. Reached: every task of every level is.
  /// LocalMinimum: the gradient of all residuals is zero. Stalled: no step was found that is better by rank; `level_error`
  /// tells which level falls short. Tasks out of reach mostly end so: `InverseKinematics` follows those to their minimum. Never
  /// allocates.
  IkReport<Scalar> solve(const Model& model, Tasks tasks, std::span<const int> levels, const View& reference,
                         Eigen::Ref<VectorX<Scalar>> q) {
    IkReport<Scalar> report;
    report.message = check(model, tasks, levels, reference, q);
    if (!report.message.empty()) {
      report.status = IkStatus::InvalidInput;
      return report;
    }
    problem_.limit(q);
    problem_.start(tasks, q, Scalar(0));
    posture_ = reference.size() > 0;
    if (posture_) reference_ = reference;
    report.cost = problem_.place(model, tasks, q);
    if (!is_finite(report.cost)) {
      report.status = IkStatus::InvalidInput;
      report.message = "q has no finite pose: a quaternion of zero, or numbers that overflow";
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
      bool moved = false;
      Scalar share(1);
      for (int halving = 0; halving < 10 && !moved; ++halving) {
        std::size_t served = levels.size();
        do {
          find_step(model, levels.first(served), served == levels.size(), q);
          step_ *= share;
          moved = take_step(model, tasks, levels, q, report);
        } while (!moved && served > 0 && --served > 0);
        share *= Scalar(0.5);
      }
      if (!moved) {
        problem_.place(model, tasks, q);
        measure(levels, costs_);
        const bool still = report.gradient <= settings_.gradient_tolerance;
        if (report.status == IkStatus::Stalled && still) report.status = IkStatus::LocalMinimum;
        return report;
      }
    }
  }

  /// The largest weighted residual of level k after a solve (m).
  Scalar level_error(std::size_t k) const { return errors_[k]; }

 private:
  using Traits = articulated_traits<Model>;

  std::string_view check(const Model& model, Tasks tasks, std::span<const int> levels, const View& reference,
                         const View& q) const {
    if (const std::string_view fault = settings_.check(); !fault.empty()) return fault;
    if (const std::string_view fault = priority_.settings().check(); !fault.empty()) return fault;
    if (levels.size() > costs_.size()) return "there are more levels than memory was made for";
    std::size_t sum = 0;
    for (const int count : levels) {
      if (count < 1) return "a level has no task";
      sum += static_cast<std::size_t>(count);
    }
    if (sum != tasks.size()) return "the levels' counts do not add up to the number of tasks";
    return problem_.check(model, tasks, reference, q);
  }

  /// Writes half the squares of each level's residuals where the robot was put last, and its largest residual.
  void measure(std::span<const int> levels, std::vector<Scalar>& costs) {
    using std::sqrt;
    Index row = 0;
    for (std::size_t k = 0; k < levels.size(); ++k) {
      const Index rows = 3 * Index(levels[k]);
      costs[k] = Scalar(0.5) * problem_.placed_residuals().segment(row, rows).squaredNorm();
      errors_[k] = Scalar(0);
      for (Index i = row; i < row + rows; i += 3) {
        errors_[k] = (std::max)(errors_[k], Scalar(sqrt(problem_.placed_residuals().template segment<3>(i).squaredNorm())));
      }
      row += rows;
    }
  }

  void find_step(const Model& model, std::span<const int> levels, bool with_posture, const View& q) {
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
        priority_.add(problem_.jacobian().middleRows(row, rows), problem_.residuals().segment(row, rows));
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

  /// Takes the step if it is better. Answers whether it moved.
  bool take_step(const Model& model, Tasks tasks, std::span<const int> levels, Eigen::Ref<VectorX<Scalar>> q,
                 IkReport<Scalar>& report) {
    const Scalar still = Scalar(16) * scalar_traits<Scalar>::epsilon();
    if (!(step_.cwiseAbs().maxCoeff() > still)) return false;
    Traits::advance(model, q, step_, trial_);
    problem_.limit(trial_);
    const Scalar cost = problem_.place(model, tasks, trial_);
    measure(levels, trial_costs_);
    if (!better(model, levels, q)) return false;
    q = trial_;
    report.cost = cost;
    std::swap(costs_, trial_costs_);
    return true;
  }

  /// Whether the trial is better by rank: at the first level where the two differ. Levels that are met by both do not differ.
  bool better(const Model& model, std::span<const int> levels, const View& q) {
    const Scalar met = Scalar(0.5) * settings_.tolerance * settings_.tolerance, small = settings_.gradient_tolerance;
    for (std::size_t k = 0; k < levels.size(); ++k) {
      const Scalar now = (std::max)(costs_[k], met), next = (std::max)(trial_costs_[k], met);
      if (next < now * (Scalar(1) - small)) return true;
      if (next > now * (Scalar(1) + small)) return false;
    }
    if (!posture_) return false;
    Traits::difference(model, q, reference_, pull_);
    const Scalar now = pull_.squaredNorm();
    Traits::difference(model, trial_, reference_, pull_);
    return pull_.squaredNorm() < now * (Scalar(1) - small);
  }

  IkSettings<Scalar> settings_;
  IkProblem<Model, Scalar> problem_;
  TaskPriority<Scalar> priority_;
  std::vector<Scalar> costs_, trial_costs_, errors_;
  std::vector<char> held_;
  VectorX<Scalar> step_, pull_, trial_, reference_;
  bool posture_ = false;
};

}  // namespace clothctl::robot
