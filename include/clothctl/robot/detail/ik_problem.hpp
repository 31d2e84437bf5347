#pragma once

// Inverse kinematics as a nonlinear least-squares problem: residuals e, Jacobian J, gradient and
// distances to the limits at the robot's current positions.
//
//   cost = ½ |e(q)|² + ½ w |q_ref - q|²,   descent direction g = Jᵀ e + w (q_ref - q)

#include <algorithm>
#include <cmath>
#include <span>
#include <string_view>

#include "clothctl/math/rotation.hpp"
#include "clothctl/robot/ik_task.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Residuals of several tasks and their derivatives; owns the memory.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedModel<Model, Scalar>
class IkProblem {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// Several tasks.
  using Tasks = std::span<const IkTask<Scalar>>;

  /// The message for a start at which `evaluate` returns a cost that is not finite.
  static constexpr std::string_view kNoPose =
      "q has no finite pose: a zero quaternion, numbers that overflow, or a frame that does not "
      "exist";

  /// Makes room for a robot and `most_tasks` tasks; a negative number counts as 0. Allocates.
  IkProblem(const Model& model, int most_tasks)
      : work_(Traits::make_workspace(model)),
        lower_(Traits::lower(model)),
        upper_(Traits::upper(model)),
        n_(Traits::nv(model)),
        most_tasks_((std::max)(most_tasks, 0)) {
    const Index most_rows = 3 * most_tasks_;
    twist_.setZero(6, n_);
    J_.setZero(most_rows, n_);
    for (VectorX<Scalar>* v : {&e_, &current_, &lead_}) v->setZero(most_rows);
    for (VectorX<Scalar>* v : {&direction_, &squares_, &pull_, &below_, &above_}) v->setZero(n_);
    beyond_limit_.setZero(Traits::nq(model));
    reference_ = beyond_limit_;
    for (Index i = 0; i < lower_.size(); ++i) {
      if (is_unbounded(lower_[i])) lower_[i] = Scalar(-kUnlimited);
    }
    for (Index i = 0; i < upper_.size(); ++i) {
      if (is_unbounded(upper_[i])) upper_[i] = Scalar(kUnlimited);
    }
  }

  /// Returns an empty text when start q, tasks and reference (which may be empty) are good, else
  /// what is wrong.
  std::string_view validate(const Model& model, const Tasks& tasks, const View& reference,
                            const View& q) const {
    const Index positions = Traits::nq(model);
    if (lower_.size() != upper_.size()) return "the robot's limits differ in their sizes";
    if (positions != lower_.size() || Traits::nv(model) != n_ || !workspace_fits(model, work_))
      return "the robot is not the one that memory was made for";
    if (q.size() != positions) return "q is not of the robot's size";
    if (!all_finite(q)) return "q holds NaN or an infinity";
    if (static_cast<Index>(tasks.size()) > most_tasks_)
      return "there are more tasks than memory was made for";
    if (reference.size() > 0 && reference.size() != positions)
      return "the reference is not of the robot's size";
    if (!all_finite(reference)) return "the reference holds NaN or an infinity";
    if (!reasonable(q) || !reasonable(reference))
      return "q or the reference holds a value beyond 1e15";
    for (const IkTask<Scalar>& task : tasks) {
      if (const std::string_view fault = task_fault(model, task); !fault.empty()) return fault;
    }
    return {};
  }

  /// Starts a problem with these tasks, a reference posture and its weight w (m²/rad²).
  void start(const Tasks& tasks, const View& reference, const Scalar& weight) {
    rows_ = 3 * static_cast<Index>(tasks.size());
    reference_ = reference;
    weight_ = weight;
    lead_.setConstant(Scalar(0));
  }
  /// Moves the targets towards the robot: `share` times `residuals` is subtracted from the
  /// residuals.
  void lead(const View& residuals, const Scalar& share) { lead_.head(rows_) = share * residuals; }
  /// Returns the length of the residuals.
  Index rows() const { return rows_; }

  /// Clamps q to the joint limits.
  void clamp(Eigen::Ref<VectorX<Scalar>> q) const { q = q.cwiseMax(lower_).cwiseMin(upper_); }
  /// Returns true when position i has a lower and an upper limit.
  bool has_limits(Index i) const {
    return lower_[i] > Scalar(-kUnlimited) && upper_[i] < Scalar(kUnlimited);
  }
  /// Returns a value between the limits of position i: the lower one for `share` 0, the upper one
  /// for `share` 1.
  Scalar between(Index i, const Scalar& share) const {
    return lower_[i] + share * (upper_[i] - lower_[i]);
  }

  /// Moves the robot to q and returns the cost there. The linearisation does not change.
  Scalar evaluate(const Model& model, const Tasks& tasks, const View& q) {
    Traits::forward_kinematics(model, q, work_);
    Index row = 0;
    for (const IkTask<Scalar>& task : tasks) {
      task_residual<Model, Scalar>(model, work_, task, current_.template segment<3>(row));
      row += 3;
    }
    current_.head(rows_) -= lead_.head(rows_);
    Scalar cost = Scalar(0.5) * current_.head(rows_).squaredNorm();
    if (weight_ > Scalar(0)) {
      Traits::difference(model, q, reference_, pull_);
      cost += Scalar(0.5) * weight_ * pull_.squaredNorm();
    }
    return cost;
  }

  /// Computes residuals, Jacobian, descent direction and distances to the limits at q, where the
  /// last `evaluate` was.
  void linearise(const Model& model, const Tasks& tasks, const View& q) {
    e_.head(rows_) = current_.head(rows_);
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
    way_to_limits<Model, Scalar>(model, q, lower_, Scalar(-1), beyond_limit_, below_);
    way_to_limits<Model, Scalar>(model, q, upper_, Scalar(1), beyond_limit_, above_);
  }

  /// Returns the residuals of the last `evaluate`.
  auto current_residuals() const { return current_.head(rows_); }
  /// Returns the residuals e of the last `linearise`.
  auto residuals() const { return e_.head(rows_); }
  /// Returns the Jacobian J (rows × nv).
  auto jacobian() const { return J_.topRows(rows_); }
  /// Returns the descent direction g = Jᵀ e + w (q_ref - q).
  const VectorX<Scalar>& direction() const { return direction_; }
  /// Returns the squared norms of the columns of J.
  const VectorX<Scalar>& squares() const { return squares_; }
  /// Returns w (q_ref - q).
  const VectorX<Scalar>& pull() const { return pull_; }
  /// Returns the weight w.
  const Scalar& weight() const { return weight_; }
  /// Returns the distance of each coordinate to its lower limit, as a step (≤ 0).
  const VectorX<Scalar>& below() const { return below_; }
  /// Returns the distance of each coordinate to its upper limit, as a step (≥ 0).
  const VectorX<Scalar>& above() const { return above_; }
  /// Returns the robot's workspace after the last `evaluate`.
  const typename articulated_traits<Model>::workspace_type& workspace() const { return work_; }

  /// Returns the largest residual of a task in the last `evaluate`; NaN if one is NaN.
  Scalar largest_residual() const { return largest_residual(0, rows_); }
  /// Returns the largest residual of the tasks in `count` rows from row `first` on.
  Scalar largest_residual(Index first, Index count) const {
    using std::sqrt;
    Scalar worst(0);
    for (Index row = first; row < first + count; row += 3) {
      const Scalar square = current_.template segment<3>(row).squaredNorm();
      if (!(square <= worst)) worst = square;  // NaN stays
    }
    return sqrt(worst);
  }

  /// Returns the largest entry |g_i| of the projected gradient, relative to
  /// |J_i| |e| + |w (q_ref - q)_i|, the largest value that it could have. Entries that push against
  /// a limit count as zero. The result is 0 at a minimum.
  Scalar projected_gradient() const {
    using std::abs;
    using std::sqrt;
    const Scalar length = sqrt(e_.head(rows_).squaredNorm());
    const bool pulled = weight_ > Scalar(0);
    // The ratio of each gradient entry to its terms is not computed: ratios are compared by
    // products of squares, since a root and a division for each entry would cost more than all else
    // here.
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
  static constexpr float kUnlimited = 1e30f;

  /// Returns true when all magnitudes are below 1e15. Squares of larger ones overflow in float, or
  /// leave no digits for the joints.
  template <class Derived>
  static bool reasonable(const Eigen::MatrixBase<Derived>& v) {
    return v.size() == 0 || v.cwiseAbs().maxCoeff() < Scalar(1e15f);
  }

  static std::string_view task_fault(const Model& model, const IkTask<Scalar>& task) {
    using std::abs;
    if (!has_frame(model, task.frame)) return "a task's frame does not exist";
    if (!all_finite(task.local) || !all_finite(task.target) || !all_finite(task.rotation)) {
      return "a task's point, target or rotation holds NaN or an infinity";
    }
    if (!is_finite(task.weight) || task.weight < Scalar(0))
      return "a task's weight is negative or not finite";
    if (!reasonable(task.local) || !reasonable(task.target))
      return "a task's point or target holds a value beyond 1e15";
    const Scalar loose(1e-3f);
    if (task.kind == IkKind::Pointing) {
      for (const Vector3<Scalar>* v : {&task.local, &task.target}) {
        if (!(abs(v->squaredNorm() - Scalar(1)) < loose))
          return "a pointing task's axis or direction is not a unit vector";
      }
    }
    if (task.kind == IkKind::Orientation && !is_rotation<Scalar>(task.rotation, loose))
      return "an orientation task's target is not a rotation matrix";
    return {};
  }

  typename articulated_traits<Model>::workspace_type work_;
  VectorX<Scalar> lower_, upper_;
  MatrixX<Scalar> twist_, J_;
  VectorX<Scalar> e_, current_, lead_, direction_, squares_, pull_, below_, above_, beyond_limit_,
      reference_;
  Scalar weight_ = Scalar(0);
  Index n_ = 0, rows_ = 0;
  Index most_tasks_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
