#pragma once

// Random robots with every kind of joint, for laws that hold for all robots.

#include <cmath>
#include <random>
#include <string>

#include <Eigen/Geometry>

#include "clothctl/robot/kinematic_tree_builder.hpp"

namespace clothctl_test {

using clothctl::Index;
using clothctl::Matrix3;
using clothctl::Vector3;
using clothctl::VectorX;
using namespace clothctl;

/// Draws numbers, vectors, robots and states.
class RobotDraws {
 public:
  explicit RobotDraws(unsigned seed) : random_(seed) {}

  double normal() { return normal_(random_); }
  int below(int n) { return static_cast<int>(random_() % static_cast<unsigned>(n)); }
  Vector3<double> vector() { return {normal(), normal(), normal()}; }
  Matrix3<double> rotation() {
    return Eigen::AngleAxisd(3.0 * normal(), vector().normalized()).toRotationMatrix();
  }

  /// Draws an inertia that a real body can have.
  template <class S>
  Inertia<S> inertia() {
    Inertia<S> part;
    Matrix3<double> G;
    for (int k = 0; k < 3; ++k) G.col(k) = vector();
    const Matrix3<double> spread = 0.01 * G * G.transpose();
    part.mass = static_cast<S>(0.1 + std::abs(normal()));
    part.com = (0.1 * vector()).cast<S>();
    part.about_com = (spread.trace() * Matrix3<double>::Identity() - spread).cast<S>();
    return part;
  }

  /// Draws a robot with the given number of joints. With `free`, the first and the sixth are free
  /// joints; with `coupled`, two follow the third.
  template <class S>
  KinematicTree<S> tree(int joints, bool free, bool coupled) {
    KinematicTreeBuilder<S> builder;
    builder.add_link("world");
    for (int k = 0; k < joints; ++k) {
      builder.add_link("link" + std::to_string(k), inertia<S>());
      Joint<S> joint;
      joint.name = "joint" + std::to_string(k);
      joint.type = free && (k == 0 || k == 5) ? JointType::Free
                   : k % 3 == 1               ? JointType::Prismatic
                   : k % 7 == 6               ? JointType::Fixed
                                              : JointType::Revolute;
      const int parent = k == 0 ? -1 : below(k + 1) - 1;
      joint.parent = parent < 0 ? "world" : "link" + std::to_string(parent);
      joint.child = "link" + std::to_string(k);
      joint.axis = vector().cast<S>();
      joint.origin.p = (0.3 * vector()).cast<S>();
      joint.origin.R = rotation().cast<S>();
      if (coupled && (k == 4 || k == 9)) {
        joint.leader = "joint2";
        joint.ratio = static_cast<S>(k == 4 ? 0.75 : -1.5);
        joint.offset = S(0.125);
      }
      builder.add_joint(joint);
    }
    return builder.build().value();
  }

  /// Draws velocities, torques and the like.
  template <class S>
  VectorX<S> entries(Index n, double scale = 1.0) {
    VectorX<S> v(n);
    for (Index k = 0; k < n; ++k) v[k] = static_cast<S>(scale * normal());
    return v;
  }

  /// Draws positions with unit quaternions.
  template <class S>
  VectorX<S> positions(const KinematicTree<S>& tree) {
    VectorX<S> q = entries<S>(tree.nq());
    for (const Body<S>& body : tree.bodies()) {
      if (body.type == JointType::Free) q.template segment<4>(body.position + 3).normalize();
    }
    return q;
  }

 private:
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
};

}  // namespace clothctl_test
