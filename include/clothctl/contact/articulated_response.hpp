#pragma once

// How a hand, or any robot with ArticulatedDynamics, answers to impulses at points of its links
// (concept ImpulseResponse). With the mass matrix M, a diagonal d of the joints and the Jacobians J
// of the points:
//
//   H = M + diag d,     W = J H⁻¹ Jᵀ,     q̇⁺ = q̇ + H⁻¹ Jᵀ p
//
// With d = h kd + h² kp (PdForm::Implicit of stable PD) or d = h kd (PdForm::Stable), H is the
// matrix of the controller's step, and q̇ = q̇_start + h q̈ of that step the velocities without
// contact. A joint whose torque is held at its limit has d = 0.
//
// Column k of H⁻¹ Jᵀ is one pass of forward dynamics, H⁻¹ (Jᵀe_k - g) + H⁻¹ g at rest, so the cost
// is O(n nv) for n points.

#include <cassert>
#include <cstddef>
#include <span>
#include <string_view>

#include "clothctl/concepts/articulated.hpp"
#include "clothctl/concepts/impulse_response.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How an update of an ArticulatedResponse ended.
enum class ArticulatedStatus {
  /// The response belongs to the new pose, points and velocities. Use it.
  Updated,
  /// A number is not finite, or an entry of the diagonal is negative. The response has no points
  /// now. Correct the input.
  InvalidInput,
  /// A vector is not of length nv, there are more points than there is room for, or a frame does
  /// not exist, or numbers of frames and points differ; nothing was changed. Correct the call.
  WrongSize,
  /// The workspace was made for another robot; nothing was changed. Make one for this robot.
  OtherWorkspace,
  /// Some joint moves nothing that has inertia. The response has no points now. Give the joint a
  /// diagonal.
  NoInertia
};

/// Returns the name of a status.
constexpr std::string_view to_string(ArticulatedStatus status) {
  switch (status) {
    case ArticulatedStatus::Updated: return "updated";
    case ArticulatedStatus::InvalidInput: return "invalid_input";
    case ArticulatedStatus::WrongSize: return "wrong_size";
    case ArticulatedStatus::OtherWorkspace: return "other_workspace";
    case ArticulatedStatus::NoInertia: return "no_inertia";
  }
  return "unknown";
}

/// The answer of a robot to impulses at points of its links. Models ImpulseResponse.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedDynamics<Model, Scalar>
class ArticulatedResponse {
 public:
  /// The robot's workspace.
  using Workspace = typename articulated_traits<Model>::workspace_type;
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;

  /// Makes a response without points for `model`, with room for up to `capacity` points. Allocates.
  ArticulatedResponse(const Model& model, Index capacity);

  /// Takes a state. Never allocates. Complexity: 3n + 1 passes of forward dynamics for n points.
  /// Fails when: see ArticulatedStatus.
  ///
  /// * `work`: after forward kinematics at the robot's positions
  /// * `velocities` (nv): q̇ at the end of the step without contact
  /// * `diagonal` (nv): d, at least 0
  /// * `frames`, `points` (3×n, m, world): the points, each fixed on its frame
  [[nodiscard]] ArticulatedStatus update(const Model& model, Workspace& work,
                                         const View& velocities, const View& diagonal,
                                         std::span<const int> frames,
                                         const PointsView<Scalar>& points);

  /// The velocities q̇ (nv) of the joints; `apply` changes them.
  const VectorX<Scalar>& joint_velocities() const { return qd_; }

  /// Returns the number of points.
  Index point_count() const { return count_; }
  /// Writes the velocities (3n, m/s) of the points.
  void velocities(Eigen::Ref<VectorX<Scalar>> u) const {
    assert(u.size() == 3 * count_);
    for (Index k = 0; k < 3 * count_; ++k) u[k] = Jt_.col(k).dot(qd_);
  }
  /// Adds the mobility to `W` (3n×3n, 1/kg).
  void add_mobility(Eigen::Ref<MatrixX<Scalar>> W) const {
    assert(W.rows() == 3 * count_ && W.cols() == 3 * count_);
    for (Index j = 0; j < 3 * count_; ++j) {
      for (Index i = 0; i < j; ++i) {
        const Scalar mobility =
            Scalar(0.5) * (Jt_.col(i).dot(Z_.col(j)) + Jt_.col(j).dot(Z_.col(i)));
        W(i, j) += mobility;
        W(j, i) += mobility;
      }
      W(j, j) += Jt_.col(j).dot(Z_.col(j));
    }
  }
  /// Changes the velocities of the joints by the impulses p (3n, N s).
  void apply(const Eigen::Ref<const VectorX<Scalar>>& p) {
    assert(p.size() == 3 * count_);
    for (Index k = 0; k < 3 * count_; ++k) qd_ += p[k] * Z_.col(k);
  }

 private:
  /// Writes H⁻¹ (torque_ - g) to push_. Returns false where a joint has no inertia.
  bool push(const Model& model, const View& diagonal, Workspace& work) {
    const Index missing = static_cast<Index>(
        articulated_traits<Model>::forward_dynamics(model, rest_, torque_, diagonal, work, push_));
    return missing < 0 && all_finite(push_);
  }

  MatrixX<Scalar> J_, Jt_, Z_;  // 6×nv of one point; nv×3n: Jᵀ, H⁻¹ Jᵀ
  VectorX<Scalar> qd_, rest_, torque_, push_, free_;
  Index count_ = 0;
};

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> ArticulatedResponse<Model, Scalar>::ArticulatedResponse(
    const Model& model, Index capacity) {
  const Index nv = static_cast<Index>(articulated_traits<Model>::nv(model));
  J_.setConstant(6, nv, Scalar(0));
  Jt_.setConstant(nv, 3 * capacity, Scalar(0));
  Z_.setConstant(nv, 3 * capacity, Scalar(0));
  for (VectorX<Scalar>* v : {&qd_, &rest_, &torque_, &push_, &free_}) v->setConstant(nv, Scalar(0));
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> ArticulatedStatus
ArticulatedResponse<Model, Scalar>::update(const Model& model, Workspace& work,
                                           const View& velocities, const View& diagonal,
                                           std::span<const int> frames,
                                           const PointsView<Scalar>& points) {
  using Traits = articulated_traits<Model>;
  const Index nv = qd_.size(), n = points.cols();
  if (static_cast<Index>(Traits::nv(model)) != nv || velocities.size() != nv ||
      diagonal.size() != nv || static_cast<Index>(frames.size()) != n || 3 * n > Jt_.cols())
    return ArticulatedStatus::WrongSize;
  if (!detail::workspace_fits(model, work)) return ArticulatedStatus::OtherWorkspace;
  for (const int frame : frames) {
    if (!detail::has_frame(model, frame)) return ArticulatedStatus::WrongSize;
  }
  count_ = 0;
  bool good = all_finite(velocities) && all_finite(diagonal) && all_finite(points);
  for (Index i = 0; i < nv && good; ++i) good = !(diagonal[i] < Scalar(0));
  if (!good) return ArticulatedStatus::InvalidInput;
  torque_.setConstant(Scalar(0));
  if (!push(model, diagonal, work)) return ArticulatedStatus::NoInertia;
  free_ = push_;
  for (Index i = 0; i < n; ++i) {
    const Vector3<Scalar> x = points.col(i);
    Traits::point_jacobian(model, work, frames[static_cast<std::size_t>(i)], x, J_);
    if (!all_finite(J_)) return ArticulatedStatus::InvalidInput;
    for (Index k = 0; k < 3; ++k) {
      torque_ = J_.row(k).transpose();
      if (!push(model, diagonal, work)) return ArticulatedStatus::NoInertia;
      Jt_.col(3 * i + k) = torque_;
      Z_.col(3 * i + k) = push_ - free_;
    }
  }
  qd_ = velocities;
  count_ = n;
  return ArticulatedStatus::Updated;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
