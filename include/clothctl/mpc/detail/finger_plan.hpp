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
