#pragma once

// Joint velocities for tasks on levels of priority: each level is met as well as possible without
// disturbing the levels before it. With the damped pseudo-inverse A⁺ and the null-space projector
// N:
//
//   A_k = J_k N_(k-1),   q̇ += A_k⁺ (ẋ_k - J_k q̇),   N_k = N_(k-1) - A_k⁺ A_k,   N_0 = 1
//
// N = 1 - V Vᵀ is stored as an orthonormal basis V of all directions that levels use, so N is a
// projector up to rounding. Only A_k⁺ is damped. A projector made of a damped pseudo-inverse would
// let later levels disturb earlier ones. Singular values and vectors come from one-sided Jacobi
// rotations (math/symmetric_eigen.hpp):
//
//   A_kᵀ W = U diag(σ),   A_k⁺ = U diag(σ / (σ² + λ²)) Wᵀ
//
// Reference: [Toh 2011], eq. 3.3 and 3.5, corrected (docs/robot.md); Siciliano, Slotine, ICAR
// (1991); Maciejewski, Klein, Int. J. Robotics Research 8 (1989) for damping only near
// singularities.

#include <algorithm>
#include <cassert>
#include <cmath>

#include "clothctl/core/types.hpp"
#include "clothctl/math/symmetric_eigen.hpp"
#include "clothctl/robot/ik_task.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Result of adding a level.
template <RealScalar Scalar>
struct PriorityReport {
  /// True when J and ẋ are finite and of the right sizes and the settings are valid. Otherwise
  /// nothing changed.
  bool accepted = false;
  /// Number of directions that the level constrains.
  Index rank = 0;
  /// |ẋ - J q̇| after the level.
  Scalar residual = Scalar(0);
};

/// Builds the velocities level by level; owns the memory.
template <RealScalar Scalar>
class TaskPriority {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// A read-only view of a matrix.
  using MatrixView = Eigen::Ref<const MatrixX<Scalar>, 0, Eigen::OuterStride<>>;

  /// Makes room for n velocities and levels of up to `most_rows` rows. Allocates.
  TaskPriority(Index n, Index most_rows, PrioritySettings<Scalar> settings = {})
      : settings_(settings), n_(n) {
    V_.setZero(n, n);
    const Index longer = (std::max)(n, most_rows), side = (std::min)(n, most_rows);
    A_.setZero(longer, side);
    W_.setZero(n, n);
    share_.setZero(n);
    velocity_.setZero(n);
    left_.setZero(most_rows);
    sigma_.setZero(side);
  }

  /// Returns the settings.
  const PrioritySettings<Scalar>& settings() const { return settings_; }

  /// Removes all levels: q̇ = 0, all directions free.
  void start() {
    taken_ = 0;
    velocity_.setConstant(Scalar(0));
  }

  /// Fixes the velocity of coordinate i. Call it before any level is added, for instance for a
  /// joint at its limit.
  void hold(Index i, const Scalar& value) {
    assert(i >= 0 && i < n_ && taken_ < n_);
    V_.col(taken_).setConstant(Scalar(0));
    V_(i, taken_++) = Scalar(1);
    velocity_[i] = value;
  }

  /// Adds the next level, J q̇ = ẋ with J rows × n. Never allocates. Complexity: O(rows² n) for
  /// each sweep of rotations, about six sweeps.
  PriorityReport<Scalar> add(const MatrixView& J, const View& velocity) {
    using std::sqrt;
    PriorityReport<Scalar> report;
    const Index m = J.rows();
    if (!settings_.validate().empty() || J.cols() != n_ || velocity.size() != m || m > left_.size())
      return report;
    if (!all_finite(J) || !all_finite(velocity)) return report;
    report.accepted = true;
    auto left = left_.head(m);
    left = velocity;
    left.noalias() -= J * velocity_;
    Scalar size(0);
    for (Index i = 0; i < m; ++i) size = (std::max)(size, Scalar(J.row(i).squaredNorm()));
    const Scalar floor = settings_.rank_threshold * sqrt(size);
    if (m <= n_) {
      add_by_rows(J, floor, report);
    } else {
      add_by_columns(J, floor, report);
    }
    left = velocity;
    left.noalias() -= J * velocity_;
    report.residual = sqrt(left.squaredNorm());
    return report;
  }

  /// Adds the posture as the last level: q̇ = z where the other levels leave q̇ free, i.e.
  /// q̇ += N (z - q̇). Never allocates.
  void add_posture(const View& z) {
    assert(z.size() == n_);
    share_ = z - velocity_;
    project(share_);
    velocity_ += share_;
  }

  /// Projects z (n) on the directions that no level uses: z = N z. Never allocates.
  void project(Eigen::Ref<VectorX<Scalar>> z) const {
    for (int pass = 0; pass < 2; ++pass) {
      for (Index k = 0; k < taken_; ++k) z -= V_.col(k).dot(z) * V_.col(k);
    }
  }

  /// Returns the velocities q̇ of the levels so far.
  const VectorX<Scalar>& velocity() const { return velocity_; }
  /// Returns the number of directions that are still free.
  Index freedom() const { return n_ - taken_; }

 private:
  /// Returns σ / (σ² + λ²).
  Scalar inverse(const Scalar& sigma) const {
    const Scalar& bound = settings_.damping;
    Scalar damping(0);
    if (settings_.form == PriorityDamping::Constant) {
      damping = bound * bound;
    } else if (sigma < bound) {
      damping = bound * bound - sigma * sigma;
    }
    return sigma / (sigma * sigma + damping);
  }

  /// Adds the direction u (unit length up to rounding) to the basis V, and to the velocity u times
  /// `amount` times the damped inverse of the singular value `sigma`.
  void add_direction(Eigen::Ref<VectorX<Scalar>> u, const Scalar& sigma, const Scalar& amount,
                     PriorityReport<Scalar>& report) {
    using std::sqrt;
    if (taken_ == n_) return;
    project(u);  // division by a small singular value enlarged its rounding
    const Scalar length = sqrt(u.squaredNorm());
    if (!(length > Scalar(0.5))) return;
    V_.col(taken_) = u / length;
    velocity_ += (inverse(sigma) * amount) * V_.col(taken_);
    ++taken_;
    ++report.rank;
  }

  /// For few rows: rotates the columns of Aᵀ (n × rows), and the residual alike.
  void add_by_rows(const MatrixView& J, const Scalar& floor, PriorityReport<Scalar>& report) {
    using std::sqrt;
    const Index m = J.rows();
    auto A = A_.topLeftCorner(n_, m);
    for (Index i = 0; i < m; ++i) {
      share_ = J.row(i).transpose();
      project(share_);
      A.col(i) = share_;
    }
    rotate(m, n_, [this](Index i, Index j, const Scalar& c, const Scalar& s) {
      const Scalar x = left_[i], y = left_[j];
      left_[i] = c * x - s * y;
      left_[j] = s * x + c * y;
    });
    for (Index i = 0; i < m; ++i) {
      if (!(sigma_[i] > floor)) continue;
      share_ = A.col(i) / sigma_[i];
      add_direction(share_, sigma_[i], left_[i], report);
    }
  }

  /// For many rows: rotates the columns of A (rows × n), and of the unit matrix alike.
  void add_by_columns(const MatrixView& J, const Scalar& floor, PriorityReport<Scalar>& report) {
    const Index m = J.rows();
    auto A = A_.topLeftCorner(m, n_);
    for (Index i = 0; i < m; ++i) {
      share_ = J.row(i).transpose();
      project(share_);
      A.row(i) = share_.transpose();
    }
    W_.setIdentity();
    rotate(n_, m, [this](Index i, Index j, const Scalar& c, const Scalar& s) {
      rotate_columns(W_, n_, i, j, c, s);
    });
    for (Index i = 0; i < n_; ++i) {
      if (!(sigma_[i] > floor)) continue;
      share_ = W_.col(i);
      add_direction(share_, sigma_[i], A.col(i).dot(left_.head(m)) / sigma_[i], report);
    }
  }

  static void rotate_columns(MatrixX<Scalar>& M, Index rows, Index i, Index j, const Scalar& c,
                             const Scalar& s) {
    for (Index k = 0; k < rows; ++k) {
      const Scalar x = M(k, i), y = M(k, j);
      M(k, i) = c * x - s * y;
      M(k, j) = s * x + c * y;
    }
  }

  /// Rotates the first `count` columns of A_ (`rows` rows) until they are orthogonal, and writes
  /// their lengths to sigma_. `also(i, j, c, s)` is called for each rotation.
  template <class Also>
  void rotate(Index count, Index rows, Also&& also) {
    using std::abs;
    using std::sqrt;
    const Scalar eps = scalar_traits<Scalar>::epsilon();
    for (int sweep = 0; sweep < 30; ++sweep) {
      bool turned = false;
      for (Index i = 0; i + 1 < count; ++i) {
        for (Index j = i + 1; j < count; ++j) {
          const auto a = A_.col(i).head(rows);
          const auto b = A_.col(j).head(rows);
          const Scalar alpha = a.squaredNorm(), beta = b.squaredNorm(), gamma = a.dot(b);
          if (!(abs(gamma) > Scalar(4) * eps * sqrt(alpha) * sqrt(beta))) continue;
          turned = true;
          const auto [c, s] = jacobi_rotation<Scalar>(alpha, beta, gamma);
          rotate_columns(A_, rows, i, j, c, s);
          also(i, j, c, s);
        }
      }
      if (!turned) break;
    }
    for (Index i = 0; i < count; ++i) sigma_[i] = sqrt(A_.col(i).head(rows).squaredNorm());
  }

  PrioritySettings<Scalar> settings_;
  MatrixX<Scalar> V_, A_, W_;
  VectorX<Scalar> share_, velocity_, left_, sigma_;
  Index n_, taken_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
