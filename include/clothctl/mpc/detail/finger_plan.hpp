#pragma once

// The planned force of every finger on every vertex that it holds, frame by frame.

#include <vector>

#include "clothctl/mpc/detail/grip_basis.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The finger forces of a window.
template <RealScalar Scalar>
class FingerPlan {
 public:
  /// Sets the forces of all frames to zero and sets their indices of grip, finger and vertex.
  /// Allocates when a size changes.
  template <class Contact>
  void reset(const GripBasis<Scalar, Contact>& basis, Index horizon) {
    std::vector<FingerForce<Scalar>> none(static_cast<std::size_t>(basis.force_count()));
    for (const auto& columns : basis.fingers()) {
      for (std::size_t j = 0; j < columns.held_slots.size(); ++j) {
        FingerForce<Scalar>& f = none[static_cast<std::size_t>(columns.first_force) + j];
        f.grip = columns.grip;
        f.finger = columns.finger;
        f.vertex = basis.held().vertices()[static_cast<std::size_t>(columns.held_slots[j])];
      }
    }
    frames_.assign(static_cast<std::size_t>(horizon), none);
  }

  /// Goes on with the fingers of `basis`: force i becomes Σ_j weights(i, j) force j in each frame.
  /// Normals are those of the last update of `basis`. Allocates.
  template <class Contact>
  void carry(const GripBasis<Scalar, Contact>& basis, const MatrixX<Scalar>& weights) {
    std::vector<FingerForce<Scalar>> next(static_cast<std::size_t>(basis.force_count()));
    const VectorX<Scalar> none = VectorX<Scalar>::Zero(basis.unknowns());
    basis.finger_forces(none, next);  // names grip, finger, vertex and normal
    for (std::vector<FingerForce<Scalar>>& frame : frames_) {
      for (std::size_t i = 0; i < next.size(); ++i) {
        next[i].force.setZero();
        for (std::size_t j = 0; j < frame.size(); ++j)
          next[i].force += weights(static_cast<Index>(i), static_cast<Index>(j)) * frame[j].force;
      }
      frame = next;
    }
  }

  /// Writes the planned forces of the held vertices, the sums over their fingers, to `plan` (3·held
  /// × K, N). Never allocates.
  template <class Contact>
  void sum(const GripBasis<Scalar, Contact>& basis, MatrixX<Scalar>& plan) const {
    plan.setZero();
    for (std::size_t k = 0; k < frames_.size(); ++k) {
      for (const auto& columns : basis.fingers()) {
        for (std::size_t j = 0; j < columns.held_slots.size(); ++j) {
          plan.template block<3, 1>(3 * columns.held_slots[j], static_cast<Index>(k)) +=
              frames_[k][static_cast<std::size_t>(columns.first_force) + j].force;
        }
      }
    }
  }

  /// Moves the plan on by a frame and repeats the last frame. Never allocates.
  void shift() {
    for (std::size_t k = 0; k + 1 < frames_.size(); ++k) frames_[k].swap(frames_[k + 1]);
    if (frames_.size() > 1) frames_.back() = frames_[frames_.size() - 2];
  }

  /// The forces of frame `k`.
  std::vector<FingerForce<Scalar>>& frame(Index k) { return frames_[static_cast<std::size_t>(k)]; }

 private:
  std::vector<std::vector<FingerForce<Scalar>>> frames_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
