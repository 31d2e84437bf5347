#pragma once

// A robot as a tree of rigid bodies: the parts that describe it (links, joints, inertias, limits)
// and the tree that KinematicTreeBuilder makes of them. Units: m, rad, kg, kg m², N, N m.
//
// A joint with position q places its child link in its parent link:
//
//   T_parent_child = Trans(origin.p) R(origin.R) Rot(axis, q)      revolute
//                    Trans(origin.p) R(origin.R) Trans(axis q)     prismatic
//
// The tree merges links that fixed joints connect into one body. A body has one joint to its parent
// body. Its frame has its origin at the joint and its z axis along the joint's axis:
//
//   T_parent_body = placement · Rot(z, q)   or   placement · Trans(z q)
//
// Bodies are in depth-first order: a parent comes before its children, and the bodies below body i
// are i + 1 … subtree_end(i) - 1. A coordinate usually drives one joint. A joint that follows
// another shares the coordinate of its leader: q_joint = ratio · q + offset.

#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/core/types.hpp"
#include "clothctl/math/rotation.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Position and rotation of an inner frame in an outer one: x_outer = R x_inner + p.
template <RealScalar Scalar>
struct Pose {
  /// Rotation, from the inner frame to the outer one.
  Matrix3<Scalar> R = Matrix3<Scalar>::Identity();
  /// Origin of the inner frame in the outer one (m).
  Vector3<Scalar> p = Vector3<Scalar>::Constant(Scalar(0));

  /// Returns the pose in the outer frame of a frame whose pose in the inner frame is `inner`.
  Pose operator*(const Pose& inner) const { return {R * inner.R, R * inner.p + p}; }
  /// Returns, in the outer frame, the point `x` of the inner frame (m).
  Vector3<Scalar> operator*(const Vector3<Scalar>& x) const { return R * x + p; }
  /// Returns the pose of the outer frame in the inner one.
  Pose inverse() const { return {R.transpose(), -(R.transpose() * p)}; }
};

/// Mass, centre of mass and inertia tensor of a body, in the body's frame.
template <RealScalar Scalar>
struct Inertia {
  /// Mass (kg).
  Scalar mass = Scalar(0);
  /// Centre of mass (m).
  Vector3<Scalar> com = Vector3<Scalar>::Constant(Scalar(0));
  /// Inertia tensor about the centre of mass, along the frame's axes (kg m²).
  Matrix3<Scalar> about_com = Matrix3<Scalar>::Constant(Scalar(0));
};

/// How a joint lets its child link move in its parent link.
enum class JointType {
  /// Rotates about the axis.
  Revolute,
  /// Translates along the axis.
  Prismatic,
  /// Does not move: the tree merges both links into one body.
  Fixed,
  /// Translates and rotates freely. It has 7 positions: translation (3, m) and unit quaternion (w,
  /// x, y, z). It has 6 velocities: linear velocity of the child's origin (3, m/s) and angular
  /// velocity (3, rad/s), both in the axes of the joint's origin frame.
  Free
};

/// Returns the name of a joint type, as in URDF.
constexpr std::string_view to_string(JointType type) {
  switch (type) {
    case JointType::Revolute: return "revolute";
    case JointType::Prismatic: return "prismatic";
    case JointType::Fixed: return "fixed";
    case JointType::Free: return "free";
  }
  return "unknown";
}

/// Limits of a joint. The defaults mean "no limit".
template <RealScalar Scalar>
struct JointLimits {
  /// Lowest position (m or rad).
  Scalar lower = -scalar_traits<Scalar>::infinity();
  /// Highest position (m or rad).
  Scalar upper = scalar_traits<Scalar>::infinity();
  /// Largest speed (m/s or rad/s).
  Scalar velocity = scalar_traits<Scalar>::infinity();
  /// Largest force or torque (N or N m).
  Scalar effort = scalar_traits<Scalar>::infinity();
};

/// A joint between two links, as it is given to the builder. Links are referred to by name.
template <RealScalar Scalar>
struct Joint {
  /// Name, unique among the joints.
  std::string name;
  /// How the joint moves.
  JointType type = JointType::Revolute;
  /// Name of the parent link.
  std::string parent;
  /// Name of the child link, which the joint moves.
  std::string child;
  /// Pose of the joint frame in the parent link's frame.
  Pose<Scalar> origin;
  /// Axis of a revolute or prismatic joint, in the joint frame. Its length must not be zero.
  Vector3<Scalar> axis = Vector3<Scalar>(Scalar(1), Scalar(0), Scalar(0));
  /// Limits. Of a joint that follows a leader only the position limits are used: they narrow the
  /// leader's range.
  JointLimits<Scalar> limits;
  /// Name of the joint that this one follows (`mimic` in URDF), or empty. A follower has no
  /// coordinate: q = ratio · q_leader + offset.
  std::string leader;
  /// Ratio of this joint's position to the leader's.
  Scalar ratio = Scalar(1);
  /// Position of this joint where the leader's is zero (m or rad).
  Scalar offset = Scalar(0);
};

/// A body of a tree, with the joint that moves it.
template <RealScalar Scalar>
struct Body {
  /// Index of the parent body, or -1 for the world.
  int parent = -1;
  /// Type of the joint: Revolute, Prismatic or Free.
  JointType type = JointType::Revolute;
  /// Index of the joint's first entry in positions q.
  Index position = 0;
  /// Index of the joint's first entry in velocities.
  Index velocity = 0;
  /// True when the joint follows a leader. It then shares the entries of its leader.
  bool follows = false;
  /// Ratio of the joint's position to its coordinate. It is 1 unless the joint follows a leader.
  Scalar ratio = Scalar(1);
  /// Position of the joint where its coordinate is zero (m or rad).
  Scalar offset = Scalar(0);
  /// Pose of the body's frame at q = 0 in the parent body's frame.
  Pose<Scalar> placement;
  /// Inertia of all merged links, in the body's frame.
  Inertia<Scalar> inertia;
  /// Index one past the last body below this one.
  int subtree_end = 0;
  /// Name of the joint.
  std::string name;
};

/// A named frame on a body. Link numbers are the frame numbers of inverse kinematics.
template <RealScalar Scalar>
struct Link {
  /// Name of the link.
  std::string name;
  /// Index of the body that carries it, or -1 for the world.
  int body = -1;
  /// Pose of the link's frame in the body's frame.
  Pose<Scalar> placement;
  /// True when the builder was given an inertia. A link without one has no mass.
  bool has_inertia = false;
};

template <RealScalar Scalar>
class KinematicTreeBuilder;

/// A robot: bodies, links and limits. KinematicTreeBuilder makes it; it never changes after that.
template <RealScalar Scalar>
class KinematicTree {
 public:
  /// The scalar type.
  using scalar_type = Scalar;
  /// A read-only view of a vector.
  using VectorView = Eigen::Ref<const VectorX<Scalar>>;

  /// Returns the bodies, parents first.
  const std::vector<Body<Scalar>>& bodies() const { return bodies_; }
  /// Returns the links, in the order in which they were added.
  const std::vector<Link<Scalar>>& links() const { return links_; }
  /// Returns the length of position vectors q. A free joint has seven entries.
  Index nq() const { return positions_; }
  /// Returns the length of velocity, acceleration and torque vectors. A free joint has six
  /// entries.
  Index nv() const { return velocities_; }
  /// Returns true when a coordinate drives several joints.
  bool coupled() const { return coupled_; }

  /// Returns the index of the link of that name, or -1. Complexity: O(links).
  int find_link(std::string_view name) const { return find(links_, name); }
  /// Returns the index of the body that the joint of that name moves, or -1. Complexity:
  /// O(bodies).
  int find_joint(std::string_view name) const { return find(bodies_, name); }

  /// Returns the lowest positions (nq; m or rad), infinite where there is no limit. Free joints
  /// have none.
  const VectorX<Scalar>& lower() const { return lower_; }
  /// Returns the highest positions (nq; m or rad).
  const VectorX<Scalar>& upper() const { return upper_; }
  /// Returns the largest speeds (nv; m/s or rad/s).
  const VectorX<Scalar>& velocity_limits() const { return velocity_limits_; }
  /// Returns the largest forces and torques (nv; N or N m).
  const VectorX<Scalar>& effort_limits() const { return effort_limits_; }

  /// Returns a hash of the tree's structure and numbers. Workspaces keep it, so that a workspace of
  /// another tree is refused. A copy of the tree has the same one.
  std::uint64_t fingerprint() const { return fingerprint_; }

  /// Returns the neutral positions: zero, clamped to the limits, and identity quaternions for free
  /// joints. Allocates.
  VectorX<Scalar> neutral() const {
    VectorX<Scalar> q = VectorX<Scalar>::Constant(positions_, Scalar(0));
    q = q.cwiseMax(lower_).cwiseMin(upper_);
    for (const Body<Scalar>& body : bodies_) {
      if (body.type == JointType::Free) q[body.position + 3] = Scalar(1);
    }
    return q;
  }

  /// Writes q moved along `step` (nv, velocity times time) to `out` (nq): entries are added, and
  /// quaternions are rotated by the angular part and normalised. `out` may be q. Never allocates.
  void advance(const VectorView& q, const VectorView& step, Eigen::Ref<VectorX<Scalar>> out) const {
    for (const Body<Scalar>& body : bodies_) {
      const Index p = body.position, v = body.velocity;
      if (body.type != JointType::Free) {
        if (!body.follows) out[p] = q[p] + step[v];
        continue;
      }
      for (Index k = 0; k < 3; ++k) out[p + k] = q[p + k] + step[v + k];
      rotate(q.data() + p + 3, Vector3<Scalar>(step[v + 3], step[v + 4], step[v + 5]),
             out.data() + p + 3);
    }
  }

  /// Writes the step (nv) from positions `from` to positions `to` (nq): entries are subtracted, and
  /// quaternions give the rotation vector of the shorter turn. `advance` along the step leads from
  /// `from` to `to`. Never allocates.
  void difference(const VectorView& from, const VectorView& to,
                  Eigen::Ref<VectorX<Scalar>> out) const {
    for (const Body<Scalar>& body : bodies_) {
      const Index p = body.position, v = body.velocity;
      if (body.type != JointType::Free) {
        if (!body.follows) out[v] = to[p] - from[p];
        continue;
      }
      for (Index k = 0; k < 3; ++k) out[v + k] = to[p + k] - from[p + k];
      rotation_between(from.data() + p + 3, to.data() + p + 3, out.data() + v + 3);
    }
  }

 private:
  friend class KinematicTreeBuilder<Scalar>;

  template <class Named>
  static int find(const std::vector<Named>& items, std::string_view name) {
    for (std::size_t k = 0; k < items.size(); ++k) {
      if (items[k].name == name) return static_cast<int>(k);
    }
    return -1;
  }

  /// Rotates the quaternion `from` by the rotation vector w (rad, outer axes): exp(w/2) · from.
  static void rotate(const Scalar* from, const Vector3<Scalar>& w, Scalar* to) {
    using std::sqrt;
    const QuaternionWxyz<Scalar> q = quaternion_product<Scalar>(
        quaternion_exp<Scalar>(w), QuaternionWxyz<Scalar>(from[0], from[1], from[2], from[3]));
    const Scalar inverse = Scalar(1) / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int k = 0; k < 4; ++k) to[k] = q[k] * inverse;
  }

  /// Writes the rotation vector of the shorter turn (rad, outer axes): 2 log(to · from⁻¹).
  static void rotation_between(const Scalar* from, const Scalar* to, Scalar* w) {
    const Vector3<Scalar> turn = quaternion_log<Scalar>(
        quaternion_product<Scalar>(QuaternionWxyz<Scalar>(to[0], to[1], to[2], to[3]),
                                   QuaternionWxyz<Scalar>(from[0], -from[1], -from[2], -from[3])));
    for (int k = 0; k < 3; ++k) w[k] = turn[k];
  }

  std::vector<Body<Scalar>> bodies_;
  std::vector<Link<Scalar>> links_;
  VectorX<Scalar> lower_, upper_, velocity_limits_, effort_limits_;
  Index positions_ = 0, velocities_ = 0;
  std::uint64_t fingerprint_ = 0;
  bool coupled_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
