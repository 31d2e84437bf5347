#pragma once

// Forward kinematics and Jacobians of a tree. All vectors are in world axes; a twist has its linear
// part first.
//
//   revolute:    R_i = R_parent R_placement Rot(z, q),   p_i = p_parent + R_parent p_placement
//   prismatic:   R_i = R_parent R_placement,   p_i = p_parent + R_parent p_placement + R_i z q
//
// The Jacobian of a point x on a body has one column for each joint between body and world, with
// the joint's axis a = R_i z:
//
//   [a × (x - p_i); a]   revolute,      [a; 0]   prismatic
//
// Joints that are coupled to one q share its column: the sum of their columns, each times the ratio
// of its coupling.
//
// Reference: Featherstone, Rigid Body Dynamics Algorithms (2008) ch. 4; Siciliano et al., Robotics
// (2009) §3.1.

#include <cmath>
#include <string_view>
#include <vector>

#include "clothctl/config.hpp"
#include "clothctl/robot/kinematic_tree.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// Pose of a body in the world.
template <RealScalar Scalar>
struct BodyPose {
  /// Rotation from the body's frame to the world. The third column is the joint's axis.
  Matrix3<Scalar> R;
  /// Origin of the body's frame in the world (m).
  Vector3<Scalar> p;
  /// Vector from the parent body's origin to this one, in world axes (m).
  Vector3<Scalar> from_parent;
};

/// Poses of all bodies of a tree.
template <RealScalar Scalar>
struct BodyPoses {
  /// One pose for each body, in the order of the tree.
  std::vector<BodyPose<Scalar>> poses;

  /// Makes room for the bodies of `tree`. Allocates.
  explicit BodyPoses(const KinematicTree<Scalar>& tree) : poses(tree.bodies().size()) {}
};

/// How a function on a tree ended.
enum class TreeStatus {
  /// The result was written. Use it.
  Done,
  /// A vector or matrix does not have the size that the tree asks for; nothing was written. Correct
  /// the call.
  WrongSize,
  /// Poses were made for a tree with another number of bodies, or the workspace for another tree;
  /// nothing was written. Make them for this one.
  OtherTree,
  /// The link number is negative or beyond the tree's links; nothing was written. Correct the call.
  NoLink
};

/// Returns the name of a status.
constexpr std::string_view to_string(TreeStatus status) {
  switch (status) {
    case TreeStatus::Done: return "done";
    case TreeStatus::WrongSize: return "wrong_size";
    case TreeStatus::OtherTree: return "other_tree";
    case TreeStatus::NoLink: return "no_link";
  }
  return "unknown";
}

namespace detail {

/// Moves `place` along the joint of `body`: on entry it holds the pose of the joint frame at q = 0
/// (rotation, and origin from the parent), on return that of the body.
template <RealScalar Scalar>
void apply_joint(const Body<Scalar>& body, const Eigen::Ref<const VectorX<Scalar>>& q,
                 BodyPose<Scalar>& place) {
  using std::cos;
  using std::sin;
  const Index at = body.position;
  if (body.type == JointType::Free) {
    place.from_parent += place.R * q.template segment<3>(at);
    place.R *= rotation_from_quaternion<Scalar>(q[at + 3], q[at + 4], q[at + 5], q[at + 6]);
    return;
  }
  const Scalar value = body.ratio * q[at] + body.offset;
  if (body.type == JointType::Prismatic) {
    place.from_parent += value * place.R.col(2);
    return;
  }
  const Scalar c = cos(value), s = sin(value);
  const Vector3<Scalar> x = place.R.col(0);
  place.R.col(0) = c * x + s * place.R.col(1);
  place.R.col(1) = c * place.R.col(1) - s * x;
}

/// Returns true when `body_poses` has room for the bodies of `tree`.
template <RealScalar Scalar>
bool poses_fit(const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses) {
  return body_poses.poses.size() == tree.bodies().size();
}

/// Returns true when `tree` has a link of that number.
template <RealScalar Scalar>
bool has_link(const KinematicTree<Scalar>& tree, int link) {
  return link >= 0 && static_cast<std::size_t>(link) < tree.links().size();
}

/// Returns Done when the arguments of a Jacobian fit the tree.
template <RealScalar Scalar>
TreeStatus check_jacobian(const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
                          int link, Index rows, const Eigen::Ref<MatrixX<Scalar>>& J) {
  if (!poses_fit(tree, body_poses)) return TreeStatus::OtherTree;
  if (!has_link(tree, link)) return TreeStatus::NoLink;
  return J.rows() == rows && J.cols() == tree.nv() ? TreeStatus::Done : TreeStatus::WrongSize;
}

/// Returns the axes (columns, world) in which a free joint's velocities are given: those of its
/// origin frame.
template <RealScalar Scalar>
Matrix3<Scalar> free_joint_axes(const BodyPoses<Scalar>& body_poses, const Body<Scalar>& body) {
  if (body.parent < 0) return body.placement.R;
  return body_poses.poses[static_cast<std::size_t>(body.parent)].R * body.placement.R;
}

}  // namespace detail

/// Computes the poses of all bodies at positions q (nq). A NaN in q gives NaN poses of the bodies
/// that it moves. Never allocates. Complexity: O(bodies). Fails when (WrongSize, OtherTree): q or
/// `body_poses` are not of the tree's size.
template <RealScalar Scalar>
TreeStatus forward_kinematics(const KinematicTree<Scalar>& tree,
                              const typename KinematicTree<Scalar>::VectorView& q,
                              BodyPoses<Scalar>& body_poses) {
  if (q.size() != tree.nq()) return TreeStatus::WrongSize;
  if (!detail::poses_fit(tree, body_poses)) return TreeStatus::OtherTree;
  BodyPose<Scalar>* const poses = body_poses.poses.data();
  int i = 0;
  for (const Body<Scalar>& body : tree.bodies()) {
    BodyPose<Scalar>& place = poses[i++];
    if (body.parent < 0) {
      place.R = body.placement.R;
      place.from_parent = body.placement.p;
      detail::apply_joint<Scalar>(body, q, place);
      place.p = place.from_parent;
    } else {
      const BodyPose<Scalar>& parent = poses[body.parent];
      place.R.noalias() = parent.R * body.placement.R;
      place.from_parent.noalias() = parent.R * body.placement.p;
      detail::apply_joint<Scalar>(body, q, place);
      place.p = parent.p + place.from_parent;
    }
  }
  return TreeStatus::Done;
}

/// Returns the pose of link number `link` in the world. All entries are infinite where the tree
/// has no such link or `body_poses` belong to another tree.
template <RealScalar Scalar>
Pose<Scalar> link_pose(const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
                       int link) {
  if (!detail::has_link(tree, link) || !detail::poses_fit(tree, body_poses)) {
    const Scalar none = scalar_traits<Scalar>::infinity();
    return {Matrix3<Scalar>::Constant(none), Vector3<Scalar>::Constant(none)};
  }
  const Link<Scalar>& frame = tree.links()[static_cast<std::size_t>(link)];
  if (frame.body < 0) return frame.placement;
  const BodyPose<Scalar>& place = body_poses.poses[static_cast<std::size_t>(frame.body)];
  return Pose<Scalar>{place.R, place.p} * frame.placement;
}

/// Writes to J (6 × nv) the Jacobian of the point `x` (m, world) that is fixed on link number
/// `link`: J q̇ is the point's velocity (rows 0 to 2, m/s) and the link's angular velocity (rows 3
/// to 5, rad/s). Never allocates. Complexity: O(nv + depth). Fails when: see TreeStatus.
template <RealScalar Scalar>
TreeStatus point_jacobian(const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
                          int link, const Vector3<Scalar>& x, Eigen::Ref<MatrixX<Scalar>> J) {
  const TreeStatus status = detail::check_jacobian<Scalar>(tree, body_poses, link, 6, J);
  if (status != TreeStatus::Done) return status;
  J.setConstant(Scalar(0));
  for (int b = tree.links()[static_cast<std::size_t>(link)].body; b >= 0;) {
    const Body<Scalar>& body = tree.bodies()[static_cast<std::size_t>(b)];
    const BodyPose<Scalar>& place = body_poses.poses[static_cast<std::size_t>(b)];
    const Vector3<Scalar> arm = x - place.p, axis = place.R.col(2);
    if (body.type == JointType::Revolute) {
      J.template block<3, 1>(0, body.velocity) += body.ratio * axis.cross(arm);
      J.template block<3, 1>(3, body.velocity) += body.ratio * axis;
    } else if (body.type == JointType::Prismatic) {
      J.template block<3, 1>(0, body.velocity) += body.ratio * axis;
    } else {
      const Matrix3<Scalar> frame = detail::free_joint_axes(body_poses, body);
      for (int k = 0; k < 3; ++k) {
        J.template block<3, 1>(0, body.velocity + k) = frame.col(k);
        J.template block<3, 1>(0, body.velocity + 3 + k) = frame.col(k).cross(arm);
        J.template block<3, 1>(3, body.velocity + 3 + k) = frame.col(k);
      }
    }
    b = body.parent;
  }
  return TreeStatus::Done;
}

/// Writes to J (3 × nv) the linear rows of `point_jacobian`, times `factor`. Never allocates.
/// Complexity: O(nv + depth). Fails when: see TreeStatus.
template <RealScalar Scalar>
TreeStatus position_jacobian(const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
                             int link, const Vector3<Scalar>& x, const Scalar& factor,
                             Eigen::Ref<MatrixX<Scalar>> J) {
  const TreeStatus status = detail::check_jacobian<Scalar>(tree, body_poses, link, 3, J);
  if (status != TreeStatus::Done) return status;
  J.setConstant(Scalar(0));
  for (int b = tree.links()[static_cast<std::size_t>(link)].body; b >= 0;) {
    const Body<Scalar>& body = tree.bodies()[static_cast<std::size_t>(b)];
    const BodyPose<Scalar>& place = body_poses.poses[static_cast<std::size_t>(b)];
    const Scalar share = factor * body.ratio;
    if (body.type == JointType::Revolute) {
      const Vector3<Scalar> arm = x - place.p, axis = place.R.col(2);
      J.template block<3, 1>(0, body.velocity) += share * axis.cross(arm);
    } else if (body.type == JointType::Prismatic) {
      J.template block<3, 1>(0, body.velocity) += share * place.R.col(2);
    } else {
      const Vector3<Scalar> arm = x - place.p;
      const Matrix3<Scalar> frame = detail::free_joint_axes(body_poses, body);
      for (int k = 0; k < 3; ++k) {
        J.template block<3, 1>(0, body.velocity + k) = factor * frame.col(k);
        J.template block<3, 1>(0, body.velocity + 3 + k) = factor * frame.col(k).cross(arm);
      }
    }
    b = body.parent;
  }
  return TreeStatus::Done;
}

/// Writes to J (6 × nv) the Jacobian of a link's origin; see `point_jacobian`.
template <RealScalar Scalar>
TreeStatus link_jacobian(const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
                         int link, Eigen::Ref<MatrixX<Scalar>> J) {
  return point_jacobian<Scalar>(tree, body_poses, link, link_pose(tree, body_poses, link).p, J);
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(TreeStatus forward_kinematics<double>(const KinematicTree<double>&,
                                                           const KinematicTree<double>::VectorView&,
                                                           BodyPoses<double>&));
CLOTHCTL_INSTANTIATE(Pose<double> link_pose<double>(const KinematicTree<double>&,
                                                    const BodyPoses<double>&, int));

}  // namespace clothctl::inline CLOTHCTL_ABI
