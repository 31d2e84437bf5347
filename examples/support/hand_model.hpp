#pragma once

// Hands that the programs grasp with: the library's own, a parallel gripper, and what is told of
// any other.

#include <functional>
#include <string>

#include "clothctl/grasp/hand_geometry.hpp"
#include "clothctl/robot/stable_pd.hpp"

namespace program {

/// Where a hand grasps a sheet.
struct GraspPlace {
  clothctl::Vector3<double> place;     ///< m
  clothctl::Vector3<double> press;     ///< of the thumb, into the sheet
  clothctl::Vector3<double> approach;  ///< where the palm faces, along the sheet
};

/// A hand for one place.
struct HandModel {
  using Tree = clothctl::KinematicTree<double>;
  using Vector = clothctl::VectorX<double>;

  Tree tree;
  /// Its shape. The first two fingers pinch.
  clothctl::HandGeometry<double> geometry;
  /// Positions (nq) in which parts that touch are neighbours, or made to.
  Vector home;
  clothctl::StablePdSettings<double> control;
  /// Largest speed of a joint on the way to the sheet, m/s or rad/s.
  double approach_speed = 2;
  /// Returns positions (nq) of its tree near those that pinch at a place.
  std::function<Vector(const Tree&, const GraspPlace&)> pinch_at;
};

/// Makes a hand for a place; where it stands on an arm, the base of the arm is beside the place.
using HandMaker = std::function<HandModel(const GraspPlace&)>;

/// The library's own hand.
HandModel make_hand34();

/// A gripper with two jaws that one motor moves.
HandModel make_gripper();

}  // namespace program
