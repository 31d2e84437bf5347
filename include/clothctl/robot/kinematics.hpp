#pragma once

// Where bodies are, and how points of them move. World axes throughout; twists are linear first.
//
//   R_i = R_p R_place Rot(z, q),   p_i = p_p + R_p p_place (+ R_i z q, sliding)
//   Jacobian of a point x on a body: column [a × (x - p); a] for a turning joint on the way to the world, [a; 0] for a sliding
//   one, a = R_i z; columns of joints that share a coordinate add up
//
// Reference: Featherstone, Rigid Body Dynamics Algorithms (2008) ch. 4; Siciliano et al., Robotics (2009) §3.1.

#include <cassert>
#include <cmath>
#include <vector>

#include <Eigen/Geometry>

#include "clothctl/robot/tree.hpp"

namespace clothctl::robot {

/// Where a body is.
template <RealScalar Scalar>
struct BodyPlace {
  /// Its axes in the world; the third column is the joint's axis.
  Matrix3<Scalar> R;
  /// Its origin in the world (m).
  Vector3<Scalar> p;
  /// Its origin from the parent body's, in world axes (m).
  Vector3<Scalar> from_parent;
};

/// Where all bodies of a tree are.
template <RealScalar Scalar>
struct Kinematics {
  /// A place for each body.
  std::vector<BodyPlace<Scalar>> places;

  /// Makes room for a tree's bodies. Allocates.
  explicit Kinematics(const Tree<Scalar>& tree) : places(tree.bodies().size()) {}
};

namespace detail {

/// The rotation of a quaternion (w, x, y, z) of any length but zero.
template <RealScalar Scalar>
Matrix3<Scalar> rotation_of(const Scalar& w, const Scalar& x, const Scalar& y, const Scalar& z) {
  const Scalar one(1), two = Scalar(2) / (w * w + x * x + y * y + z * z);
  Matrix3<Scalar> R;
  R << one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y),  //
      two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x),   //
      two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y);
  return R;
}

/// Places a body whose joint frame at rest has that rotation and, from the parent, that origin.
template <RealScalar Scalar>
void place_body(const Body<Scalar>& body, const Eigen::Ref<const VectorX<Scalar>>& q, BodyPlace<Scalar>& place) {
  using std::cos;
  using std::sin;
  const Index at = body.position;
  if (body.type == JointType::Free) {
    place.from_parent += place.R * q.template segment<3>(at);
    place.R *= rotation_of<Scalar>(q[at + 3], q[at + 4], q[at + 5], q[at + 6]);
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

/// The axes of a free body's velocities: those of its joint at rest.
template <RealScalar Scalar>
Matrix3<Scalar> outer_axes(const Kinematics<Scalar>& kinematics, const Body<Scalar>& body) {
  if (body.parent < 0) return body.placement.R;
  return kinematics.places[static_cast<std::size_t>(body.parent)].R * body.placement.R;
}

}  // namespace detail

/// Places all bodies for positions q. An entry that is NaN shows in every body that it moves. Never allocates. Complexity:
/// O(bodies).
template <RealScalar Scalar>
void forward_kinematics(const Tree<Scalar>& tree, const typename Tree<Scalar>::VectorView& q, Kinematics<Scalar>& kinematics) {
  assert(q.size() == tree.positions());
  BodyPlace<Scalar>* const places = kinematics.places.data();
  int i = 0;
  for (const Body<Scalar>& body : tree.bodies()) {
    BodyPlace<Scalar>& place = places[i++];
    if (body.parent < 0) {
      place.R = body.placement.R;
      place.from_parent = body.placement.p;
      detail::place_body<Scalar>(body, q, place);
      place.p = place.from_parent;
    } else {
      const BodyPlace<Scalar>& parent = places[body.parent];
      place.R.noalias() = parent.R * body.placement.R;
      place.from_parent.noalias() = parent.R * body.placement.p;
      detail::place_body<Scalar>(body, q, place);
      place.p = parent.p + place.from_parent;
    }
  }
}

/// The pose of link number `link` in the world.
template <RealScalar Scalar>
Pose<Scalar> link_pose(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics, int link) {
  assert(link >= 0 && link < static_cast<int>(tree.links().size()));
  const Link<Scalar>& frame = tree.links()[static_cast<std::size_t>(link)];
  if (frame.body < 0) return frame.placement;
  const BodyPlace<Scalar>& place = kinematics.places[static_cast<std::size_t>(frame.body)];
  return Pose<Scalar>{place.R, place.p} * frame.placement;
}

/// Writes the Jacobian of the world point x (m), fixed on link number `link`, to J (6 × velocities): J q̇ is the point's
/// velocity (rows 0 to 2) and the link's angular velocity (rows 3 to 5). Never allocates. Complexity: O(velocities + depth).
template <RealScalar Scalar>
void point_jacobian(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics, int link, const Vector3<Scalar>& x,
                    Eigen::Ref<MatrixX<Scalar>> J) {
  assert(J.rows() == 6 && J.cols() == tree.velocities());
  assert(link >= 0 && link < static_cast<int>(tree.links().size()));
  J.setConstant(Scalar(0));
  for (int b = tree.links()[static_cast<std::size_t>(link)].body; b >= 0;) {
    const Body<Scalar>& body = tree.bodies()[static_cast<std::size_t>(b)];
    const BodyPlace<Scalar>& place = kinematics.places[static_cast<std::size_t>(b)];
    const Vector3<Scalar> arm = x - place.p, axis = place.R.col(2);
    if (body.type == JointType::Revolute) {
      J.template block<3, 1>(0, body.velocity) += body.ratio * axis.cross(arm);
      J.template block<3, 1>(3, body.velocity) += body.ratio * axis;
    } else if (body.type == JointType::Prismatic) {
      J.template block<3, 1>(0, body.velocity) += body.ratio * axis;
    } else {
      const Matrix3<Scalar> frame = detail::outer_axes(kinematics, body);
      for (int k = 0; k < 3; ++k) {
        J.template block<3, 1>(0, body.velocity + k) = frame.col(k);
        J.template block<3, 1>(0, body.velocity + 3 + k) = frame.col(k).cross(arm);
        J.template block<3, 1>(3, body.velocity + 3 + k) = frame.col(k);
      }
    }
    b = body.parent;
  }
}

/// Writes the linear rows of `point_jacobian`, times a factor, to J (3 × velocities). Never allocates.
template <RealScalar Scalar>
void position_jacobian(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics, int link, const Vector3<Scalar>& x,
                       const Scalar& factor, Eigen::Ref<MatrixX<Scalar>> J) {
  assert(J.rows() == 3 && J.cols() == tree.velocities());
  assert(link >= 0 && link < static_cast<int>(tree.links().size()));
  J.setConstant(Scalar(0));
  for (int b = tree.links()[static_cast<std::size_t>(link)].body; b >= 0;) {
    const Body<Scalar>& body = tree.bodies()[static_cast<std::size_t>(b)];
    const BodyPlace<Scalar>& place = kinematics.places[static_cast<std::size_t>(b)];
    const Scalar share = factor * body.ratio;
    if (body.type == JointType::Revolute) {
      const Vector3<Scalar> arm = x - place.p, axis = place.R.col(2);
      J.template block<3, 1>(0, body.velocity) += share * axis.cross(arm);
    } else if (body.type == JointType::Prismatic) {
      J.template block<3, 1>(0, body.velocity) += share * place.R.col(2);
    } else {
      const Vector3<Scalar> arm = x - place.p;
      const Matrix3<Scalar> frame = detail::outer_axes(kinematics, body);
      for (int k = 0; k < 3; ++k) {
        J.template block<3, 1>(0, body.velocity + k) = factor * frame.col(k);
        J.template block<3, 1>(0, body.velocity + 3 + k) = factor * frame.col(k).cross(arm);
      }
    }
    b = body.parent;
  }
}

/// Writes the Jacobian of a link's origin; see `point_jacobian`.
template <RealScalar Scalar>
void link_jacobian(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics, int link, Eigen::Ref<MatrixX<Scalar>> J) {
  point_jacobian<Scalar>(tree, kinematics, link, link_pose(tree, kinematics, link).p, J);
}

}  // namespace clothctl::robot
