#pragma once

// A robot joins ArticulatedModel by one specialisation of articulated_traits: a planar arm that
// uses degrees and centimetres and stores its own joint angles. clothctl uses radians and metres.
// The arm moves in the plane y = 0.

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <Eigen/Geometry>

#include "clothctl/concepts/articulated.hpp"

namespace workshop {

/// A point (cm) and a direction (degrees) in the arm's plane.
struct Mark {
  double x = 0, z = 0, heading = 0;
};

/// Rods, each of which rotates about the end of the previous one.
struct Arm {
  std::vector<double> rods = {40, 30, 20};  // cm
  std::vector<double> degrees = {0, 0, 0};  // relative to the previous rod

  /// Returns the end of a rod; rod -1 ends at the shoulder.
  Mark end_of(int rod) const {
    Mark mark;
    for (int k = 0; k <= rod; ++k) {
      const std::size_t i = static_cast<std::size_t>(k);
      mark.heading += degrees[i];
      mark.x += rods[i] * std::cos(mark.heading * std::numbers::pi / 180);
      mark.z += rods[i] * std::sin(mark.heading * std::numbers::pi / 180);
    }
    return mark;
  }
};

}  // namespace workshop

/// Everything that inverse kinematics needs. Frame k is the end of rod k. What depends on the
/// joints is in the workspace, here a second arm.
template <>
struct clothctl::articulated_traits<workshop::Arm> {
  using scalar_type = double;
  using workspace_type = workshop::Arm;
  using Arm = workshop::Arm;
  using View = Eigen::Ref<const VectorX<double>>;
  using Out = Eigen::Ref<VectorX<double>>;

  static Arm make_workspace(const Arm& arm) { return arm; }
  /// Numbers of positions q and of velocities; they differ if a joint has a quaternion.
  static Index nq(const Arm& arm) { return static_cast<Index>(arm.rods.size()); }
  static Index nv(const Arm& arm) { return nq(arm); }
  static VectorX<double> lower(const Arm& arm) { return VectorX<double>::Constant(nq(arm), -2.5); }
  static VectorX<double> upper(const Arm& arm) { return VectorX<double>::Constant(nq(arm), 2.5); }
  /// q advanced by a step, and the step between two q.
  static void advance(const Arm&, const View& q, const View& step, Out out) { out = q + step; }
  static void difference(const Arm&, const View& from, const View& to, Out out) { out = to - from; }
  static void forward_kinematics(const Arm&, const View& q, Arm& work) {
    for (Index k = 0; k < q.size(); ++k)
      work.degrees[static_cast<std::size_t>(k)] = q[k] * 180 / std::numbers::pi;
  }
  /// Rotation and origin of a frame in the world.
  static void frame_pose(const Arm&, const Arm& work, int frame, Matrix3<double>& R,
                         Vector3<double>& p) {
    const workshop::Mark end = work.end_of(frame);
    R = Eigen::AngleAxisd(-end.heading * std::numbers::pi / 180, Vector3<double>::UnitY())
            .toRotationMatrix();
    p << end.x / 100, 0, end.z / 100;
  }
  /// Returns the Jacobian (6 × nv, linear rows first, world axes) of the world point x fixed to a
  /// frame. The joints rotate about -y.
  static void point_jacobian(const Arm&, const Arm& work, int frame, const Vector3<double>& x,
                             Eigen::Ref<MatrixX<double>> J) {
    J.setZero();
    for (int k = 0; k <= frame; ++k) {
      const workshop::Mark joint = work.end_of(k - 1);
      J(0, k) = -(x[2] - joint.z / 100);
      J(2, k) = x[0] - joint.x / 100;
      J(4, k) = -1;
    }
  }
};
