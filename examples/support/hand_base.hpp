#pragma once

// A floating base for hands without an arm: it slides along x, y and z, and turns about z, y and x.
// The joints are named as those of hand34, so that hand34_place_base places it.

#include <array>
#include <string>

#include "clothctl/robot/kinematic_tree_builder.hpp"

namespace program {

/// A joint of the floating base.
struct BaseJoint {
  const char* name;
  clothctl::JointType type;
  int axis;
  double limit;   ///< m or rad, both ways
  double effort;  ///< N or N m
};

inline constexpr std::array<BaseJoint, 6> kBaseJoints{
    {{"base_tx", clothctl::JointType::Prismatic, 0, 2, 250},
     {"base_ty", clothctl::JointType::Prismatic, 1, 2, 250},
     {"base_tz", clothctl::JointType::Prismatic, 2, 2, 250},
     {"base_rz", clothctl::JointType::Revolute, 2, 3.1, 40},
     {"base_ry", clothctl::JointType::Revolute, 1, 1.45, 40},
     {"base_rx", clothctl::JointType::Revolute, 0, 3.1, 40}}};

/// Mass of each link of the base, kg, and its moments of inertia, kg m².
inline constexpr double kBaseMass = 0.03, kBaseMoment = 2e-5;

/// Adds the base, whose root is the link "ground", and fixes `child` to it. `origin`: of the child
/// on the base.
void add_base(clothctl::KinematicTreeBuilder<double>& builder, const std::string& child,
              const clothctl::Pose<double>& origin = {});

/// Returns the same as URDF: elements to be put into a robot whose root is `child`. Without `moves`
/// the child is fixed to the ground.
std::string base_urdf(const std::string& child, const clothctl::Pose<double>& origin, bool moves);

}  // namespace program
