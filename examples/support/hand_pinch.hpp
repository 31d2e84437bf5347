#pragma once

// How any hand pinches: a posture of two fingers whose pads face each other, and the pose of the
// hand in which they do so at a place.

#include <string>
#include <vector>

#include "support/hand_model.hpp"

namespace program {

/// A posture that pinches.
struct Pinch {
  /// Positions (nq).
  clothctl::VectorX<double> positions;
  /// In these positions, world: between the two pads, m; and the axes of the pinch: x from the
  /// first pad to the second, z to the palm.
  clothctl::Vector3<double> centre;
  clothctl::Matrix3<double> axes;
};

/// Whether a body moves both of the first two fingers.
std::vector<bool> find_carriers(const HandModel::Tree& tree,
                                const clothctl::HandGeometry<double>& geometry);

/// Makes the pinch of a posture (nq): its two fingers stay, the other joints of the hand stretch,
/// and what carries both fingers is at `home`.
Pinch make_pinch_of(const HandModel::Tree& tree, const clothctl::HandGeometry<double>& geometry,
                    const clothctl::VectorX<double>& posture,
                    const clothctl::VectorX<double>& home);

/// Searches for a pinch near `home` (nq) of a hand whose base or arm moves.
Pinch find_pinch(const HandModel::Tree& tree, const clothctl::HandGeometry<double>& geometry,
                 const clothctl::VectorX<double>& home);

/// Returns the axes of a pinch at a place.
clothctl::Matrix3<double> pinch_axes(const GraspPlace& at);

/// Returns positions (nq) that pinch at a place, or are as near as inverse kinematics finds: the
/// base, or the arm, moves from the pinch.
clothctl::VectorX<double> pinch_at(const HandModel::Tree& tree,
                                   const std::vector<clothctl::FingerPad<double>>& fingers,
                                   const Pinch& pinch, const GraspPlace& at);

/// Returns the largest share of an effort limit that it takes a hand to hold itself up where it
/// pinches at a place, or infinity where it cannot pinch there.
double pinch_effort(const HandModel& hand, const GraspPlace& at);

}  // namespace program
