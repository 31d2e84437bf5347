#pragma once

// What a robot is made of, as its builder takes it: links with inertia, joints between them. Units: m, rad, kg, kg m², N, N m.
//
//   T_parent_child = Trans(origin.p) R(origin.R) (Rot(axis, q) or Trans(axis q))

#include <string>
#include <string_view>

#include "clothctl/core/types.hpp"

namespace clothctl::robot {

/// Place and turn of a frame in another: x_outer = R x_inner + p.
template <RealScalar Scalar>
struct Pose {
  /// Rotation, from the inner frame to the outer one.
  Matrix3<Scalar> R = Matrix3<Scalar>::Identity();
  /// Origin of the inner frame in the outer one (m).
  Vector3<Scalar> p = Vector3<Scalar>::Constant(Scalar(0));

  /// The pose of a frame whose pose in the inner frame is `inner`.
  Pose operator*(const Pose& inner) const { return {R * inner.R, R * inner.p + p}; }
  /// A point of the inner frame in the outer one.
  Vector3<Scalar> operator*(const Vector3<Scalar>& x) const { return R * x + p; }
  /// The pose of the outer frame in the inner one.
  Pose inverse() const { return {R.transpose(), -(R.transpose() * p)}; }
};

/// Mass, centre and tensor of a body, in its frame.
template <RealScalar Scalar>
struct Inertia {
  /// Mass (kg).
  Scalar mass = Scalar(0);
  /// Centre of mass (m).
  Vector3<Scalar> com = Vector3<Scalar>::Constant(Scalar(0));
  /// Inertia tensor about the centre of mass, axes of the frame (kg m²).
  Matrix3<Scalar> about_com = Matrix3<Scalar>::Constant(Scalar(0));
};

/// How a child link moves in its parent.
enum class JointType {
  /// Turns about the axis.
  Revolute,
  /// Slides along the axis.
  Prismatic,
  /// Does not move: the links are one body.
  Fixed,
  /// Moves and turns freely: position (3), unit quaternion (w, x, y, z); velocity is the child origin's linear velocity (3) and
  /// the angular velocity (3), both in the axes of the joint's origin frame.
  Free
};

/// Names a joint type.
constexpr std::string_view to_string(JointType type) {
  switch (type) {
    case JointType::Revolute: return "revolute";
    case JointType::Prismatic: return "prismatic";
    case JointType::Fixed: return "fixed";
    case JointType::Free: return "free";
  }
  return "unknown";
}

/// Range, speed and effort of a joint; what is not given is unlimited.
template <RealScalar Scalar>
struct JointLimits {
  /// Least position (m or rad).
  Scalar lower = -scalar_traits<Scalar>::infinity();
  /// Largest position.
  Scalar upper = scalar_traits<Scalar>::infinity();
  /// Largest speed (m/s or rad/s).
  Scalar velocity = scalar_traits<Scalar>::infinity();
  /// Largest force or torque (N or N m).
  Scalar effort = scalar_traits<Scalar>::infinity();
};

/// A joint between two links, by name.
template <RealScalar Scalar>
struct Joint {
  /// Its name; no other joint has it.
  std::string name;
  /// How it moves.
  JointType type = JointType::Revolute;
  /// The link that it hangs on.
  std::string parent;
  /// The link that it moves.
  std::string child;
  /// The joint frame in the parent link's frame.
  Pose<Scalar> origin;
  /// Axis of a revolute or prismatic joint in the joint frame; any length but zero.
  Vector3<Scalar> axis = Vector3<Scalar>(Scalar(1), Scalar(0), Scalar(0));
  /// Its limits. Of a coupled joint only the position's count: they narrow the leader's.
  JointLimits<Scalar> limits;
  /// Name of the joint that leads this one, or empty: q = ratio · q_leader + offset, and it has no coordinate of its own.
  std::string leader;
  /// Ratio to the leader.
  Scalar ratio = Scalar(1);
  /// Offset to the leader (m or rad).
  Scalar offset = Scalar(0);
};

}  // namespace clothctl::robot
