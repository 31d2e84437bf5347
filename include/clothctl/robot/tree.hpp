#pragma once

// A tree of rigid bodies. Links that do not move against each other are one body; a body has one joint to its parent and a
// frame at that joint's origin, whose z axis is the joint's:
//
//   T_parent_body = placement · Rot(z, q) or placement · Trans(z q)
//
// Bodies stand in depth-first order: parents come first, and the bodies below body i are i + 1 … subtree_end(i) - 1. A
// coordinate of the tree drives one joint, and with couplings several: q_joint = ratio · q + offset.

#include <cmath>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/robot/joint.hpp"

namespace clothctl::robot {

/// A body of a tree and the joint that moves it.
template <RealScalar Scalar>
struct Body {
  /// The body that it hangs on, or -1 for the world.
  int parent = -1;
  /// Revolute, Prismatic or Free.
  JointType type = JointType::Revolute;
  /// First of its entries in positions q.
  Index position = 0;
  /// First of its entries in velocities.
  Index velocity = 0;
  /// Whether another joint leads this one: both have the same entries.
  bool follows = false;
  /// Ratio of the joint to its coordinate: 1 but for joints that follow.
  Scalar ratio = Scalar(1);
  /// Offset of the joint to its coordinate.
  Scalar offset = Scalar(0);
  /// The joint frame at q = 0 in the parent body's frame.
  Pose<Scalar> placement;
  /// Inertia in the body's frame.
  Inertia<Scalar> inertia;
  /// The body after the last one below this.
  int subtree_end = 0;
  /// The joint's name.
  std::string name;
};

/// A link: a named frame on a body.
template <RealScalar Scalar>
struct Link {
  /// Its name.
  std::string name;
  /// The body that it is part of, or -1 for the world.
  int body = -1;
  /// Its frame in the body's frame.
  Pose<Scalar> placement;
  /// Whether it was given an inertia; one without weighs nothing.
  bool has_inertia = false;
};

template <RealScalar Scalar>
class TreeBuilder;

/// Bodies, links and limits. Made by TreeBuilder; does not change.
template <RealScalar Scalar>
class Tree {
 public:
  /// The number type.
  using scalar_type = Scalar;
  /// A read-only view of a vector.
  using VectorView = Eigen::Ref<const VectorX<Scalar>>;

  /// The bodies, parents first.
  const std::vector<Body<Scalar>>& bodies() const { return bodies_; }
  /// The links, in the order in which they were added.
  const std::vector<Link<Scalar>>& links() const { return links_; }
  /// Length of position vectors q; a free joint has seven entries.
  Index positions() const { return positions_; }
  /// Length of velocity, acceleration and torque vectors.
  Index velocities() const { return velocities_; }
  /// Whether a coordinate drives several joints.
  bool coupled() const { return coupled_; }

  /// The link of that name, or -1. Complexity: O(links).
  int find_link(std::string_view name) const { return find(links_, name); }
  /// The body moved by the joint of that name, or -1. Complexity: O(bodies).
  int find_joint(std::string_view name) const { return find(bodies_, name); }

  /// Least positions; those of free joints are unlimited.
  const VectorX<Scalar>& lower() const { return lower_; }
  /// Largest positions.
  const VectorX<Scalar>& upper() const { return upper_; }
  /// Largest speeds.
  const VectorX<Scalar>& velocity_limits() const { return velocity_limits_; }
  /// Largest forces and torques.
  const VectorX<Scalar>& effort_limits() const { return effort_limits_; }

  /// All zero, moved into the limits; quaternions of free joints are the identity. Allocates.
  VectorX<Scalar> neutral() const {
    VectorX<Scalar> q = VectorX<Scalar>::Constant(positions_, Scalar(0));
    q = q.cwiseMax(lower_).cwiseMin(upper_);
    for (const Body<Scalar>& body : bodies_) {
      if (body.type == JointType::Free) q[body.position + 3] = Scalar(1);
    }
    return q;
  }

  /// q moved along `step` (velocity times time): sums, but for quaternions, which turn by its angular part and stay unit. `out`
  /// may be q. Never allocates.
  void advance(const VectorView& q, const VectorView& step, Eigen::Ref<VectorX<Scalar>> out) const {
    for (const Body<Scalar>& body : bodies_) {
      const Index p = body.position, v = body.velocity;
      if (body.type != JointType::Free) {
        if (!body.follows) out[p] = q[p] + step[v];
        continue;
      }
      for (Index k = 0; k < 3; ++k) out[p + k] = q[p + k] + step[v + k];
      turn(q.data() + p + 3, Vector3<Scalar>(step[v + 3], step[v + 4], step[v + 5]), out.data() + p + 3);
    }
  }

  /// The step that takes `from` to `to`: differences, but for quaternions, where it is the shorter turn. `advance` along it
  /// arrives. Never allocates.
  void difference(const VectorView& from, const VectorView& to, Eigen::Ref<VectorX<Scalar>> out) const {
    for (const Body<Scalar>& body : bodies_) {
      const Index p = body.position, v = body.velocity;
      if (body.type != JointType::Free) {
        if (!body.follows) out[v] = to[p] - from[p];
        continue;
      }
      for (Index k = 0; k < 3; ++k) out[v + k] = to[p + k] - from[p + k];
      turn_between(from.data() + p + 3, to.data() + p + 3, out.data() + v + 3);
    }
  }

 private:
  friend class TreeBuilder<Scalar>;

  template <class Named>
  static int find(const std::vector<Named>& items, std::string_view name) {
    for (std::size_t k = 0; k < items.size(); ++k) {
      if (items[k].name == name) return static_cast<int>(k);
    }
    return -1;
  }

  /// The quaternion `from` after a turn by the vector w (rad), in the outer axes: exp(w/2) · from.
  static void turn(const Scalar* from, const Vector3<Scalar>& w, Scalar* to) {
    using std::cos;
    using std::sin;
    using std::sqrt;
    const Scalar half = Scalar(0.5) * sqrt(w.squaredNorm());
    const Scalar tiny = sqrt(sqrt(scalar_traits<Scalar>::epsilon()));
    const Scalar share = Scalar(0.5) * (half < tiny ? Scalar(1) - half * half / Scalar(6) : Scalar(sin(half) / half));
    const Scalar a = cos(half), b = share * w[0], c = share * w[1], d = share * w[2];
    const Scalar w0 = from[0], x0 = from[1], y0 = from[2], z0 = from[3];
    const Scalar qw = a * w0 - b * x0 - c * y0 - d * z0, qx = a * x0 + b * w0 + c * z0 - d * y0;
    const Scalar qy = a * y0 + c * w0 + d * x0 - b * z0, qz = a * z0 + d * w0 + b * y0 - c * x0;
    const Scalar inverse = Scalar(1) / sqrt(qw * qw + qx * qx + qy * qy + qz * qz);
    to[0] = qw * inverse;
    to[1] = qx * inverse;
    to[2] = qy * inverse;
    to[3] = qz * inverse;
  }

  /// The vector of the shorter turn from one quaternion to another, in the outer axes: 2 log(to · from⁻¹).
  static void turn_between(const Scalar* from, const Scalar* to, Scalar* w) {
    using std::atan2;
    using std::sqrt;
    const Scalar a0 = from[0], a1 = from[1], a2 = from[2], a3 = from[3];
    const Scalar b0 = to[0], b1 = to[1], b2 = to[2], b3 = to[3];
    Scalar q0 = b0 * a0 + b1 * a1 + b2 * a2 + b3 * a3;
    Vector3<Scalar> axis(-b0 * a1 + b1 * a0 - b2 * a3 + b3 * a2, -b0 * a2 + b1 * a3 + b2 * a0 - b3 * a1,
                         -b0 * a3 - b1 * a2 + b2 * a1 + b3 * a0);
    if (q0 < Scalar(0)) {
      q0 = -q0;
      axis = -axis;
    }
    const Scalar sine = sqrt(axis.squaredNorm());
    const Scalar share = sine > Scalar(0) ? Scalar(Scalar(2) * atan2(sine, q0) / sine) : Scalar(0);
    for (int k = 0; k < 3; ++k) w[k] = share * axis[k];
  }

  std::vector<Body<Scalar>> bodies_;
  std::vector<Link<Scalar>> links_;
  VectorX<Scalar> lower_, upper_, velocity_limits_, effort_limits_;
  Index positions_ = 0, velocities_ = 0;
  bool coupled_ = false;
};

}  // namespace clothctl::robot
