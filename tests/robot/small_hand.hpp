#pragma once

// A hand of 26 joints with limits, and targets for its fingertips.

#include <random>
#include <string>
#include <vector>

#include "clothctl/robot/forward_kinematics.hpp"
#include "clothctl/robot/ik_task.hpp"
#include "clothctl/robot/kinematic_tree_builder.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"

namespace clothctl_test {

using clothctl::Index;
using clothctl::Matrix3;
using clothctl::MatrixX;
using clothctl::Vector3;
using clothctl::VectorX;
using namespace clothctl;

/// A palm on six joints, and five fingers of four joints. The limits are about one radian.
inline KinematicTree<double> small_hand() {
  KinematicTreeBuilder<double> builder;
  builder.add_link("world");
  const auto add = [&](const std::string& parent, const std::string& child, JointType type,
                       int axis, Vector3<double> place) {
    Joint<double> joint;
    joint.name = "to_" + child;
    joint.type = type;
    joint.parent = parent;
    joint.child = child;
    joint.axis = Vector3<double>::Unit(axis);
    joint.origin.p = place;
    joint.limits.lower = type == JointType::Prismatic ? -0.5 : -1.0;
    joint.limits.upper = type == JointType::Prismatic ? 0.5 : 1.2;
    builder.add_link(child).add_joint(joint);
  };
  const Vector3<double> none = Vector3<double>::Zero();
  std::string last = "world";
  for (int k = 0; k < 6; ++k) {
    const std::string name = "palm" + std::to_string(k);
    add(last, name, k < 3 ? JointType::Prismatic : JointType::Revolute, k % 3, none);
    last = name;
  }
  for (int f = 0; f < 5; ++f) {
    std::string parent = last;
    for (int k = 0; k < 4; ++k) {
      const std::string name = "finger" + std::to_string(f) + std::to_string(k);
      const Vector3<double> place =
          k == 0 ? Vector3<double>(0.08, 0.02 * (f - 2), 0.0) : Vector3<double>(0.035, 0.0, 0.0);
      add(parent, name, JointType::Revolute, k == 0 ? 2 : 1, place);
      parent = name;
    }
  }
  return builder.build().value();
}

/// The hand, random configurations, and tasks that put the tips where they are in such a
/// configuration.
struct Reach {
  KinematicTree<double> tree = small_hand();
  BodyPoses<double> body_poses{tree};
  std::mt19937 random{17};
  std::vector<IkTask<double>> tasks;

  double uniform() { return std::uniform_real_distribution<double>(0.0, 1.0)(random); }
  VectorX<double> anywhere() {
    VectorX<double> q(tree.nq());
    for (Index i = 0; i < q.size(); ++i)
      q[i] = tree.lower()[i] + uniform() * (tree.upper()[i] - tree.lower()[i]);
    return q;
  }
  void aim_at(const VectorX<double>& q) {
    tasks.clear();
    forward_kinematics<double>(tree, q, body_poses);
    for (int f = 0; f < 5; ++f) {
      const int tip = tree.find_link("finger" + std::to_string(f) + "3");
      const Vector3<double> pad(0.02, 0.0, -0.005);
      tasks.push_back(IkTask<double>::position(tip, pad, link_pose(tree, body_poses, tip) * pad));
    }
  }
  bool within_limits(const VectorX<double>& q) const {
    return (q.array() >= tree.lower().array()).all() && (q.array() <= tree.upper().array()).all();
  }
};

}  // namespace clothctl_test
