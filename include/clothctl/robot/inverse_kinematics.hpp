#pragma once

// Inverse kinematics by Levenberg-Marquardt with joint limits:
//
//   min ½ |e(q)|² + ½ w |q - q_ref|²,   lower ≤ q ≤ upper
//   (JᵀJ + D) dq = Jᵀ e + w (q_ref - q),   D = w + μ (diag(JᵀJ) + 1e-3 s),   s the largest of diag(JᵀJ)
//
// by rows: dq = D⁻¹ (Jᵀ λ + r), (1 + J D⁻¹ Jᵀ) λ = e - J D⁻¹ r, r = w (q_ref - q): the matrix is as large as the residual, not
// as the robot. Limits: joints that a step would take beyond are put to their limit, their share leaves the residual, e -= J_i
// dq_i, and the others are solved again ("lock, limit, redistribute"); with few rows that is a rank-one change. A step that
// does not lower the cost is taken shorter, with a larger μ. Reference: Levenberg (1944), Marquardt (1963); Baerlocher, Boulic,
// The Visual Computer 20 (2004) for limits.

#include <algorithm>
#include <cassert>
#include <cmath>
#include <span>
#include <string_view>
#include <vector>

#include "clothctl/math/small_cholesky.hpp"
#include "clothctl/robot/ik_task.hpp"

namespace clothctl::robot {

/// Tolerances and budget of inverse kinematics.
template <RealScalar Scalar>
struct IkSettings {
  /// Largest weighted residual of a task that counts as reached (m).
  Scalar tolerance = Scalar(1e-4);
  /// Largest entry of the projected gradient, relative to its terms, that counts as a minimum.
  Scalar gradient_tolerance = Scalar(1e-6);
  /// Weight w of the posture (m²/rad², beside residuals in m): 0 leaves it to the damping.
  Scalar posture_weight = Scalar(0);
  /// First damping μ.
  Scalar damping = Scalar(1e-3);
  /// Steps that may be tried.
  int max_iterations = 100;

  /// Names what is wrong, or "".
  std::string_view check() const {
    const auto positive = [](const Scalar& v) { return is_finite(v) && v > Scalar(0); };
    if (!positive(tolerance)) return "tolerance is not a positive length";
    if (!positive(gradient_tolerance)) return "gradient_tolerance is not a positive number";
    if (!is_finite(posture_weight) || posture_weight < Scalar(0)) return "posture_weight is negative or not finite";
    if (!positive(damping)) return "damping is not a positive number";
    if (max_iterations < 1) return "max_iterations is less than 1";
    return {};
  }
};

/// Why inverse kinematics stopped.
enum class IkStatus {
  /// Every task is within the tolerance. Use q.
  Reached,
  /// q is a local minimum: the projected gradient is zero, and no small step helps. Out of reach, or start elsewhere.
  LocalMinimum,
  /// The steps ran out; q is the best met. Allow more, or start elsewhere.
  IterationLimit,
  /// A start, target, reference or setting is not finite or of a wrong size; q was left as it was. Mend the input.
  InvalidInput
};

/// Names a status.
constexpr std::string_view to_string(IkStatus status) {
  switch (status) {
    case IkStatus::Reached: return "reached";
    case IkStatus::LocalMinimum: return "local_minimum";
    case IkStatus::IterationLimit: return "iteration_limit";
    case IkStatus::InvalidInput: return "invalid_input";
  }
  return "unknown";
}

/// What inverse kinematics answers.
template <RealScalar Scalar>
struct IkReport {
  /// Why it stopped.
  IkStatus status = IkStatus::IterationLimit;
  /// Largest weighted residual of a task (m).
  Scalar error = scalar_traits<Scalar>::infinity();
  /// Largest entry of the projected gradient over its terms.
  Scalar gradient = scalar_traits<Scalar>::infinity();
  /// Steps tried, of all starts.
  int iterations = 0;
  /// Starts used.
  int starts = 1;
};

/// Inverse kinematics of one robot for up to so many tasks at once. All memory is made here.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedModel<Model, Scalar>
class InverseKinematics {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// What is known of the robot at a position.
  using Workspace = typename articulated_traits<Model>::workspace_type;

  /// Makes room. Allocates.
  InverseKinematics(const Model& model, int most_tasks, IkSettings<Scalar> settings = {})
      : settings_(settings), work_(Traits::make_workspace(model)), lower_(Traits::lower(model)), upper_(Traits::upper(model)) {
    const Index n = n_ = Traits::velocities(model), rows = 3 * most_tasks;
    most_tasks_ = most_tasks;
    twist_.setZero(6, n);
    J_.setZero(rows, n);
    const Index side = (std::min)(rows, n);
    S_.setZero(side, side);
    L_.setZero(side, side);
    for (VectorX<Scalar>* v : {&e_, &trial_e_, &left_}) v->setZero(rows);
    right_.setZero(side);
    for (VectorX<Scalar>* v : {&gradient_, &squares_, &damping_, &pull_, &step_, &below_, &above_}) v->setZero(n);
    for (VectorX<Scalar>* v : {&trial_, &reference_, &start_, &found_}) v->setZero(Traits::positions(model));
    free_.assign(static_cast<std::size_t>(n), 0);
    for (Index i = 0; i < lower_.size(); ++i) {
      if (is_unbounded(lower_[i])) lower_[i] = Scalar(-kFar);
      if (is_unbounded(upper_[i])) upper_[i] = Scalar(kFar);
    }
  }

  /// The settings.
  const IkSettings<Scalar>& settings() const { return settings_; }

  /// Moves q to a minimum of the tasks' residuals within the limits, from q (moved into its limits first). `reference` (may be
  /// empty: q) is what the posture weight draws to. Never allocates. Complexity: O(rows² n + rows³) an iteration.
  IkReport<Scalar> solve(const Model& model, std::span<const IkTask<Scalar>> tasks, const View& reference,
                         Eigen::Ref<VectorX<Scalar>> q) {
    IkReport<Scalar> report;
    if (!accepts(model, tasks, reference, q)) {
      report.status = IkStatus::InvalidInput;
      return report;
    }
    rows_ = 3 * static_cast<Index>(tasks.size());
    q = q.cwiseMax(lower_).cwiseMin(upper_);
    if (reference.size() > 0) {
      reference_ = reference;
    } else {
      reference_ = q;
    }
    Scalar mu = settings_.damping;
    Scalar cost = place(model, tasks, q, e_);
    for (;;) {
      report.error = largest();
      if (report.error <= settings_.tolerance && !(settings_.posture_weight > Scalar(0))) {
        report.status = IkStatus::Reached;
        return report;
      }
      linearise(model, tasks, q);
      report.gradient = projected_gradient();
      if (report.gradient <= settings_.gradient_tolerance) {
        report.status = report.error <= settings_.tolerance ? IkStatus::Reached : IkStatus::LocalMinimum;
        return report;
      }
      for (;;) {
        if (report.iterations == settings_.max_iterations) {
          report.status = report.error <= settings_.tolerance ? IkStatus::Reached : IkStatus::IterationLimit;
          return report;
        }
        ++report.iterations;
        find_step(mu);
        Traits::advance(model, q, step_, trial_);
        trial_ = trial_.cwiseMax(lower_).cwiseMin(upper_);
        const Scalar next = place(model, tasks, trial_, trial_e_);
        if (next < cost) {
          q = trial_;
          e_.head(rows_) = trial_e_.head(rows_);
          cost = next;
          mu = (std::max)(scalar_traits<Scalar>::epsilon(), Scalar(mu / Scalar(5)));
          break;
        }
        mu *= Scalar(4);
        if (!(mu < Scalar(1e12))) {  // no step is short enough: rounding
          report.status = report.error <= settings_.tolerance ? IkStatus::Reached : IkStatus::LocalMinimum;
          return report;
        }
      }
    }
  }

  /// The same from q, and while that does not reach from up to `restarts` other starts, drawn evenly within the limits
  /// (unlimited coordinates keep q's); q becomes the best found. `uniform()` draws from [0, 1). Never allocates.
  template <class Uniform>
  IkReport<Scalar> solve(const Model& model, std::span<const IkTask<Scalar>> tasks, const View& reference,
                         Eigen::Ref<VectorX<Scalar>> q, int restarts, Uniform&& uniform) {
    start_ = q;
    IkReport<Scalar> best = solve(model, tasks, reference, q);
    if (best.status == IkStatus::InvalidInput) return best;
    IkReport<Scalar> total = best;
    found_ = q;
    for (int k = 0; k < restarts && best.status != IkStatus::Reached; ++k) {
      q = start_;
      for (Index i = 0; i < q.size(); ++i) {
        if (!(lower_[i] > Scalar(-kFar)) || !(upper_[i] < Scalar(kFar))) continue;
        q[i] = lower_[i] + static_cast<Scalar>(uniform()) * (upper_[i] - lower_[i]);
      }
      const IkReport<Scalar> next = solve(model, tasks, reference, q);
      total.iterations += next.iterations;
      ++total.starts;
      if (!(next.error < best.error)) continue;
      best = next;
      found_ = q;
    }
    q = found_;
    best.iterations = total.iterations;
    best.starts = total.starts;
    return best;
  }

 private:
  using Traits = articulated_traits<Model>;
  static constexpr float kFar = 1e30f;

  bool accepts(const Model& model, std::span<const IkTask<Scalar>> tasks, const View& reference, const View& q) const {
    const Index positions = Traits::positions(model);
    if (!settings_.check().empty() || q.size() != positions || !all_finite(q) || static_cast<int>(tasks.size()) > most_tasks_) {
      return false;
    }
    if (reference.size() > 0 && (reference.size() != positions || !all_finite(reference))) return false;
    for (const IkTask<Scalar>& task : tasks) {
      if (!all_finite(task.local) || !all_finite(task.target) || !all_finite(task.rotation) || !is_finite(task.weight))
        return false;
    }
    return true;
  }

  /// Puts the robot to q. Returns the cost there, and writes the residuals.
  Scalar place(const Model& model, std::span<const IkTask<Scalar>> tasks, const View& q, VectorX<Scalar>& e) {
    Traits::place(model, q, work_);
    Index row = 0;
    for (const IkTask<Scalar>& task : tasks) {
      task_residual<Model, Scalar>(model, work_, task, e.template segment<3>(row));
      row += 3;
    }
    Scalar cost = Scalar(0.5) * e.head(rows_).squaredNorm();
    if (settings_.posture_weight > Scalar(0)) {
      Traits::difference(model, q, reference_, pull_);
      cost += Scalar(0.5) * settings_.posture_weight * pull_.squaredNorm();
    }
    return cost;
  }

  Scalar largest() const {
    using std::sqrt;
    Scalar worst(0);
    for (Index row = 0; row < rows_; row += 3) worst = (std::max)(worst, Scalar(e_.template segment<3>(row).squaredNorm()));
    return sqrt(worst);
  }

  /// Jacobian, gradient, pull of the posture, and the room to the limits, where the robot stands.
  void linearise(const Model& model, std::span<const IkTask<Scalar>> tasks, const View& q) {
    Index row = 0;
    for (const IkTask<Scalar>& task : tasks) {
      task_jacobian<Model, Scalar>(model, work_, task, twist_, J_.middleRows(row, 3));
      row += 3;
    }
    if (settings_.posture_weight > Scalar(0)) {
      Traits::difference(model, q, reference_, pull_);
      pull_ *= settings_.posture_weight;
    }
    for (Index i = 0; i < n_; ++i) {
      squares_[i] = J_.col(i).head(rows_).squaredNorm();
      gradient_[i] = J_.col(i).head(rows_).dot(e_.head(rows_)) + pull_[i];
    }
    room_to(model, q, lower_, Scalar(-1), below_);
    room_to(model, q, upper_, Scalar(1), above_);
  }

  /// How far each coordinate may go to a limit, down (sign -1) or up. A mark of one beyond it tells limited coordinates from
  /// others, whatever entries of q they have.
  void room_to(const Model& model, const View& q, const VectorX<Scalar>& limit, const Scalar& sign, VectorX<Scalar>& room) {
    using std::abs;
    for (Index i = 0; i < limit.size(); ++i) trial_[i] = abs(limit[i]) < Scalar(kFar) ? Scalar(limit[i] + sign) : q[i];
    Traits::difference(model, q, trial_, room);
    for (Index i = 0; i < n_; ++i)
      room[i] = sign * room[i] > Scalar(0.5) ? Scalar(room[i] - sign) : Scalar(sign * Scalar(kFar));
  }

  /// Largest entry of the gradient that the limits do not hold, over what its terms can be.
  Scalar projected_gradient() const {
    using std::abs;
    using std::sqrt;
    const Scalar length = sqrt(e_.head(rows_).squaredNorm());
    Scalar worst(0);
    for (Index i = 0; i < n_; ++i) {
      const Scalar edge = gradient_[i] > Scalar(0) ? above_[i] : below_[i];
      if (!(abs(edge) > Scalar(64) * scalar_traits<Scalar>::epsilon())) continue;
      const Scalar terms = sqrt(squares_[i]) * length + abs(pull_[i]);
      if (terms > Scalar(0)) worst = (std::max)(worst, Scalar(abs(gradient_[i]) / terms));
    }
    return worst;
  }

  /// The damped step within the limits.
  void find_step(const Scalar& mu) {
    const Scalar steepest = squares_.maxCoeff();
    const Scalar floor = steepest > Scalar(0) ? Scalar(0) : Scalar(1);
    damping_ = (settings_.posture_weight + floor + mu * (squares_.array() + Scalar(1e-3) * steepest)).matrix();
    left_.head(rows_) = e_.head(rows_);
    std::fill(free_.begin(), free_.end(), char(1));
    const bool by_rows = rows_ <= n_;
    if (by_rows) sum_rows();
    for (Index round = 0; round <= n_; ++round) {
      if (by_rows) {
        solve_by_rows();
      } else {
        solve_by_columns();
      }
      bool beyond = false;
      for (Index i = 0; i < n_; ++i) {
        if (free_[static_cast<std::size_t>(i)] == 0) continue;
        const Scalar within = (std::min)((std::max)(step_[i], below_[i]), above_[i]);
        if (!(step_[i] < within) && !(step_[i] > within)) continue;
        beyond = true;
        step_[i] = within;
        free_[static_cast<std::size_t>(i)] = 0;
        const auto column = J_.col(i).head(rows_);
        left_.head(rows_) -= within * column;
        if (by_rows) add_column(i, Scalar(-1) / damping_[i]);
      }
      if (!beyond) return;
    }
  }

  /// S = 1 + J D⁻¹ Jᵀ, lower triangle.
  void sum_rows() {
    auto S = S_.topLeftCorner(rows_, rows_);
    S.setIdentity();
    for (Index i = 0; i < n_; ++i) {
      if (squares_[i] > Scalar(0)) add_column(i, Scalar(1) / damping_[i]);
    }
  }
  /// S += weight · J_i J_iᵀ; a joint moves few tasks, so most entries are zero.
  void add_column(Index i, const Scalar& weight) {
    for (Index k = 0; k < rows_; ++k) {
      const Scalar share = weight * J_(k, i);
      if (share < Scalar(0) || share > Scalar(0)) {
        S_.col(k).segment(k, rows_ - k) += share * J_.col(i).segment(k, rows_ - k);
      }
    }
  }

  void solve_by_rows() {
    right_.head(rows_) = left_.head(rows_);
    for (Index i = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] == 0) continue;
      if (pull_[i] < Scalar(0) || pull_[i] > Scalar(0)) right_.head(rows_) -= (pull_[i] / damping_[i]) * J_.col(i).head(rows_);
    }
    L_.topLeftCorner(rows_, rows_) = S_.topLeftCorner(rows_, rows_);
    clothctl::detail::factor_small<Scalar>(L_.topLeftCorner(rows_, rows_));  // S ≥ 1
    clothctl::detail::solve_small<Scalar>(L_.topLeftCorner(rows_, rows_), right_.head(rows_));
    for (Index i = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] == 0) continue;
      step_[i] = (J_.col(i).head(rows_).dot(right_.head(rows_)) + pull_[i]) / damping_[i];
    }
  }

  /// The same from (JᵀJ + D) dq = Jᵀ e + r on the free coordinates: fewer than rows.
  void solve_by_columns() {
    Index count = 0;
    for (Index i = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] == 0) continue;
      Index row = count;
      for (Index k = i; k < n_; ++k) {
        if (free_[static_cast<std::size_t>(k)] == 0) continue;
        L_(row++, count) = J_.col(i).head(rows_).dot(J_.col(k).head(rows_)) + (k == i ? damping_[i] : Scalar(0));
      }
      right_[count++] = J_.col(i).head(rows_).dot(left_.head(rows_)) + pull_[i];
    }
    clothctl::detail::factor_small<Scalar>(L_.topLeftCorner(count, count));
    clothctl::detail::solve_small<Scalar>(L_.topLeftCorner(count, count), right_.head(count));
    for (Index i = 0, k = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] != 0) step_[i] = right_[k++];
    }
  }

  IkSettings<Scalar> settings_;
  Workspace work_;
  VectorX<Scalar> lower_, upper_;
  MatrixX<Scalar> twist_, J_, S_, L_;
  VectorX<Scalar> e_, trial_e_, left_, right_;
  VectorX<Scalar> gradient_, squares_, damping_, pull_, step_, below_, above_;
  VectorX<Scalar> trial_, reference_, start_, found_;
  std::vector<char> free_;
  Index n_ = 0, rows_ = 0;
  int most_tasks_ = 0;
};

}  // namespace clothctl::robot
