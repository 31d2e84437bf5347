#pragma once

// Composite rigid bodies: column i of the mass matrix is what a unit acceleration of joint i alone takes, moving everything
// below it as one body (m, h = m c, I about the origin),
//
//   (N, F) = (I a, a × h)  turning,  (h × a, m a)  sliding;      M_ji = a_j · N_j or a_j · F_j,  walking up:  N += r × F
//
// Reference: Walker, Orin (1982); Featherstone (2008) §6.2.

#include <cassert>
#include <vector>

#include "clothctl/robot/motion.hpp"

namespace clothctl::robot {

/// Memory of `mass_matrix`.
template <RealScalar Scalar>
struct MassMatrixWorkspace {
  /// Inertias; velocities are of no use.
  Motion<Scalar> motion;
  /// Masses of all that hangs on a body, itself included.
  std::vector<Scalar> masses;

  /// Makes room for a tree's bodies. Allocates.
  explicit MassMatrixWorkspace(const Tree<Scalar>& tree) : motion(tree), masses(tree.bodies().size()) {}
};

/// Writes the mass matrix M (velocities × velocities, symmetric, all of it) where `kinematics` stands. Never allocates.
/// Complexity: O(bodies × depth) and the zeros.
template <RealScalar Scalar>
void mass_matrix(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics, MassMatrixWorkspace<Scalar>& work,
                 Eigen::Ref<MatrixX<Scalar>> M) {
  assert(M.rows() == tree.velocities() && M.cols() == tree.velocities());
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  detail::place_inertias(tree, kinematics, work.motion);
  for (std::size_t i = 0; i < bodies.size(); ++i) work.masses[i] = bodies[i].inertia.mass;
  M.setConstant(Scalar(0));
  const auto walk = [&](std::size_t i, Index column, Vector3<Scalar> N, Vector3<Scalar> F, const Scalar& ratio) {
    for (int j = static_cast<int>(i); j >= 0;) {
      const Body<Scalar>& body = bodies[static_cast<std::size_t>(j)];
      const BodyPlace<Scalar>& place = kinematics.places[static_cast<std::size_t>(j)];
      const bool own = j == static_cast<int>(i);
      const auto add = [&](Index row, const Scalar& value) {
        M(row, column) += value;
        if (!own) M(column, row) += value;
      };
      if (body.type == JointType::Revolute) {
        add(body.velocity, Scalar(ratio * body.ratio * place.R.col(2).dot(N)));
      } else if (body.type == JointType::Prismatic) {
        add(body.velocity, Scalar(ratio * body.ratio * place.R.col(2).dot(F)));
      } else {
        const Matrix3<Scalar> axes = detail::outer_axes(kinematics, body);
        for (int k = 0; k < 3; ++k) {
          add(body.velocity + k, Scalar(ratio * axes.col(k).dot(F)));
          add(body.velocity + 3 + k, Scalar(ratio * axes.col(k).dot(N)));
        }
      }
      N += place.from_parent.cross(F);
      j = body.parent;
    }
  };
  for (std::size_t i = bodies.size(); i-- > 0;) {
    const Body<Scalar>& body = bodies[i];
    const BodyPlace<Scalar>& place = kinematics.places[i];
    const detail::BodyMotion<Scalar>& own = work.motion.bodies[i];
    const Scalar mass = work.masses[i];
    const Vector3<Scalar> axis = place.R.col(2);
    if (body.type == JointType::Revolute) {
      walk(i, body.velocity, own.I * axis, axis.cross(own.h), body.ratio);
    } else if (body.type == JointType::Prismatic) {
      walk(i, body.velocity, own.h.cross(axis), mass * axis, body.ratio);
    } else {
      const Matrix3<Scalar> axes = detail::outer_axes(kinematics, body);
      for (int k = 0; k < 3; ++k) {
        walk(i, body.velocity + k, own.h.cross(axes.col(k)), mass * axes.col(k), Scalar(1));
        walk(i, body.velocity + 3 + k, own.I * axes.col(k), axes.col(k).cross(own.h), Scalar(1));
      }
    }
    if (body.parent < 0) continue;
    const std::size_t p = static_cast<std::size_t>(body.parent);
    detail::BodyMotion<Scalar>& parent = work.motion.bodies[p];
    const Vector3<Scalar>& r = place.from_parent;
    // I about the parent's origin: - [r][h] - [h][r] - m [r][r] more
    const Vector3<Scalar> lever = Scalar(2) * own.h + mass * r;
    parent.I += own.I + r.dot(lever) * Matrix3<Scalar>::Identity() - own.h * r.transpose() - r * (own.h + mass * r).transpose();
    parent.h += own.h + mass * r;
    work.masses[p] += mass;
  }
}

}  // namespace clothctl::robot
