#pragma once

// Inverse kinematics as a problem of least squares: residuals e, Jacobian J, gradient and room to the limits, where a robot
// stands.
//
//   cost = ½ |e(q)|² + ½ w |q_ref - q|²,   descent direction g = Jᵀ e + w (q_ref - q)

#include <algorithm>
#include <cmath>
#include <span>
#include <string_view>

#include "clothctl/robot/ik_report.hpp"
#include "clothctl/robot/ik_task.hpp"

namespace clothctl::robot {

/// Residuals of several tasks and their derivatives, and all memory for them.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedModel<Model, Scalar>
class IkProblem {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// Several tasks.
  using Tasks = std::span<const IkTask<Scalar>>;

  /// Makes room for a robot and so many tasks. Allocates.
  IkProblem(const Model& model, int most_tasks)
      : work_(Traits::make_workspace(model)),
        lower_(Traits::lower(model)),
        upper_(Traits::upper(model)),
        n_(Traits::velocities(model)),
        most_tasks_(most_tasks) {
    const Index most_rows = 3 * static_cast<Index>(most_tasks);
    twist_.setZero(6, n_);
    J_.setZero(most_rows, n_);
    for (VectorX<Scalar>* v : {&e_, &placed_, &lead_}) v->setZero(most_rows);
    for (VectorX<Scalar>* v : {&direction_, &squares_, &pull_, &below_, &above_}) v->setZero(n_);
    marks_.setZero(Traits::positions(model));
    reference_ = marks_;
    for (Index i = 0; i < lower_.size(); ++i) {
      if (is_unbounded(lower_[i])) lower_[i] = Scalar(-kFar);
      if (is_unbounded(upper_[i])) upper_[i] = Scalar(kFar);
    }
  }

  /// Names what is wrong with a start, targets or a reference (which may be empty), or "".
  std::string_view check(const Model& model, const Tasks& tasks, const View& reference, const View& q) const {
    const Index positions = Traits::positions(model);
    if (positions != lower_.size()) return "the robot is not the one that memory was made for";
    if (q.size() != positions) return "q is not of the robot's size";
    if (!all_finite(q)) return "q holds NaN or an infinity";
    if (static_cast<Index>(tasks.size()) > most_tasks_) return "there are more tasks than memory was made for";
    if (reference.size() > 0 && reference.size() != positions) return "the reference is not of the robot's size";
    if (!all_finite(reference)) return "the reference holds NaN or an infinity";
    if (!reasonable(q) || !reasonable(reference)) return "q or the reference holds a value beyond 1e15";
    if (!reasonable(q) || !reasonable(reference)) return "q or the reference holds a value beyond 1e20";
    for (const IkTask<Scalar>& task : tasks) {
      if (const std::string_view fault = check_task(model, task); !fault.empty()) return fault;
    }
    return {};
  }

  /// Whether a frame of that number exists, as far as the model can tell: its trait may offer `frames`, how many there are.
  static bool has_frame(const Model& model, int frame) {
    if constexpr (requires { Traits::frames(model); }) {
      return frame >= 0 && frame < static_cast<int>(Traits::frames(model));
    } else {
      return frame >= 0;
    }
  }

  /// Takes tasks, a reference for the posture and its weight w (m²/rad²).
  void start(const Tasks& tasks, const View& reference, const Scalar& weight) {
    rows_ = 3 * static_cast<Index>(tasks.size());
    reference_ = reference;
    weight_ = weight;
    lead_.setConstant(Scalar(0));
  }
  /// Leads the targets: `share` of `residuals` is taken off the residuals.
  void lead(const View& residuals, const Scalar& share) { lead_.head(rows_) = share * residuals; }
  /// Length of the residuals.
  Index rows() const { return rows_; }

  /// Moves q into its limits.
  void limit(Eigen::Ref<VectorX<Scalar>> q) const { q = q.cwiseMax(lower_).cwiseMin(upper_); }
  /// Whether coordinate i of the positions has both limits.
  bool limited(Index i) const { return lower_[i] > Scalar(-kFar) && upper_[i] < Scalar(kFar); }
  /// A position between the limits of coordinate i: `share` is 0 at the lower one and 1 at the upper one.
  Scalar between(Index i, const Scalar& share) const { return lower_[i] + share * (upper_[i] - lower_[i]); }

  /// Puts the robot to q. Answers the cost there; the linearisation stays what it was.
  Scalar place(const Model& model, const Tasks& tasks, const View& q) {
    Traits::place(model, q, work_);
    Index row = 0;
    for (const IkTask<Scalar>& task : tasks) {
      task_residual<Model, Scalar>(model, work_, task, placed_.template segment<3>(row));
      row += 3;
    }
    placed_.head(rows_) -= lead_.head(rows_);
    Scalar cost = Scalar(0.5) * placed_.head(rows_).squaredNorm();
    if (weight_ > Scalar(0)) {
      Traits::difference(model, q, reference_, pull_);
      cost += Scalar(0.5) * weight_ * pull_.squaredNorm();
    }
    return cost;
  }

  /// Residuals, Jacobian, direction and room to the limits at q, to which the robot was put last.
  void linearise(const Model& model, const Tasks& tasks, const View& q) {
    e_.head(rows_) = placed_.head(rows_);
    Index row = 0;
    for (const IkTask<Scalar>& task : tasks) {
      task_jacobian<Model, Scalar>(model, work_, task, twist_, J_.middleRows(row, 3));
      row += 3;
    }
    pull_.setConstant(Scalar(0));
    if (weight_ > Scalar(0)) {
      Traits::difference(model, q, reference_, pull_);
      pull_ *= weight_;
    }
    for (Index i = 0; i < n_; ++i) {
      const Scalar* const column = J_.col(i).data();
      Scalar square(0), along(0);
      for (Index k = 0; k < rows_; ++k) {
        square += column[k] * column[k];
        along += column[k] * e_[k];
      }
      squares_[i] = square;
      direction_[i] = along + pull_[i];
    }
    room_to(model, q, lower_, Scalar(-1), below_);
    room_to(model, q, upper_, Scalar(1), above_);
  }

  /// The residuals where the robot was put last.
  auto placed_residuals() const { return placed_.head(rows_); }
  /// The residuals e of the linearisation.
  auto residuals() const { return e_.head(rows_); }
  /// The Jacobian J, rows × velocities.
  auto jacobian() const { return J_.topRows(rows_); }
  /// g = Jᵀ e + w (q_ref - q).
  const VectorX<Scalar>& direction() const { return direction_; }
  /// The squares of J's columns.
  const VectorX<Scalar>& squares() const { return squares_; }
  /// w (q_ref - q).
  const VectorX<Scalar>& pull() const { return pull_; }
  /// The weight w.
  const Scalar& weight() const { return weight_; }
  /// The largest step down (≤ 0) of each coordinate.
  const VectorX<Scalar>& below() const { return below_; }
  /// The largest step up (≥ 0) of each coordinate.
  const VectorX<Scalar>& above() const { return above_; }
  /// What is known of the robot where it was put last.
  const typename articulated_traits<Model>::workspace_type& workspace() const { return work_; }

  /// The largest residual of a task where the robot was put last.
  Scalar largest_residual() const {
    using std::sqrt;
    Scalar worst(0);
    for (Index row = 0; row < rows_; row += 3) {
      const Scalar square = placed_.template segment<3>(row).squaredNorm();
      if (!(square <= worst)) worst = square;  // NaN stays
    }
    return sqrt(worst);
  }

  /// Largest entry of `direction` that the limits do not hold, over what its terms can be: 0 at a minimum.
  Scalar projected_gradient() const {
    using std::abs;
    using std::sqrt;
    const Scalar length = sqrt(e_.head(rows_).squaredNorm());
    const bool pulled = weight_ > Scalar(0);
    // Squares of both, over the residual's: roots and quotients of each entry would cost more than all the rest.
    Scalar most(0), terms_of_most(1);
    const Scalar scale = length > Scalar(0) ? Scalar(Scalar(1) / length) : Scalar(1);
    for (Index i = 0; i < n_; ++i) {
      const Scalar edge = direction_[i] > Scalar(0) ? above_[i] : below_[i];
      if (!(abs(edge) > Scalar(64) * scalar_traits<Scalar>::epsilon())) continue;
      Scalar terms = squares_[i];
      if (pulled) {
        const Scalar sum = sqrt(squares_[i]) * length * scale + abs(pull_[i]) * scale;
        terms = sum * sum;
      }
      const Scalar part = direction_[i] * scale, own = part * part;
      if (!(own * terms_of_most > most * terms)) continue;
      most = own;
      terms_of_most = terms;
    }
    return sqrt(most / terms_of_most);
  }

 private:
  using Traits = articulated_traits<Model>;
  static constexpr float kFar = 1e30f;

  /// Squares of what is larger overflow, or leave no digits for joints.
  template <class Derived>
  static bool reasonable(const Eigen::MatrixBase<Derived>& v) {
    return v.size() == 0 || v.cwiseAbs().maxCoeff() < Scalar(1e15f);
  }

  static std::string_view check_task(const Model& model, const IkTask<Scalar>& task) {
    using std::abs;
    if (!has_frame(model, task.frame)) return "a task's frame does not exist";
    if (!all_finite(task.local) || !all_finite(task.target) || !all_finite(task.rotation)) {
      return "a task's point, target or rotation holds NaN or an infinity";
    }
    if (!is_finite(task.weight) || task.weight < Scalar(0)) return "a task's weight is negative or not finite";
    if (!reasonable(task.local) || !reasonable(task.target)) return "a task's point or target holds a value beyond 1e15";
    const Scalar loose(1e-3f);
    if (task.kind == IkKind::Pointing) {
      for (const Vector3<Scalar>* v : {&task.local, &task.target}) {
        if (!(abs(v->squaredNorm() - Scalar(1)) < loose)) return "a pointing task's axis or direction is not a unit vector";
      }
    }
    if (task.kind == IkKind::Orientation) {
      const Matrix3<Scalar> square = task.rotation.transpose() * task.rotation - Matrix3<Scalar>::Identity();
      if (!(square.cwiseAbs().maxCoeff() < loose) || !(task.rotation.determinant() > Scalar(0))) {
        return "an orientation task's rotation is none";
      }
    }
    return {};
  }

  /// How far each coordinate may go to a limit, down (sign -1) or up. A mark of one beyond it tells limited coordinates from
  /// others, whatever entries of q they have.
  void room_to(const Model& model, const View& q, const VectorX<Scalar>& limit, const Scalar& sign, VectorX<Scalar>& room) {
    using std::abs;
    for (Index i = 0; i < limit.size(); ++i) marks_[i] = abs(limit[i]) < Scalar(kFar) ? Scalar(limit[i] + sign) : q[i];
    Traits::difference(model, q, marks_, room);
    for (Index i = 0; i < n_; ++i)
      room[i] = sign * room[i] > Scalar(0.5) ? Scalar(room[i] - sign) : Scalar(sign * Scalar(kFar));
  }

  typename articulated_traits<Model>::workspace_type work_;
  VectorX<Scalar> lower_, upper_;
  MatrixX<Scalar> twist_, J_;
  VectorX<Scalar> e_, placed_, lead_, direction_, squares_, pull_, below_, above_, marks_, reference_;
  Scalar weight_ = Scalar(0);
  Index n_ = 0, rows_ = 0;
  Index most_tasks_ = 0;
};

}  // namespace clothctl::robot
