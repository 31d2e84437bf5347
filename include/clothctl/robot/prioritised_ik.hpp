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
  /// `level_error`
  ///   tells which level falls short. `InverseKinematics` moves on to the minimum in such cases.
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

  /// Returns true when the trial is better than q at the first level whose cost differs. Levels
  /// that both meet to the tolerance do not differ.
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

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/robot/detail/prioritised_ik_impl.hpp"
