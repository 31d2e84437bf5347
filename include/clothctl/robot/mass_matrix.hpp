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
  /// Inertias in the bodies' own axes.
  std::vector<detail::BodyInertia<Scalar>> inertias;
  /// Inertias of all that hangs on a body, itself included, in world axes.
  std::vector<detail::BodyInertia<Scalar>> composites;

  /// Makes room for a tree's bodies. Allocates.
  explicit MassMatrixWorkspace(const Tree<Scalar>& tree) : inertias(detail::own_inertias(tree)), composites(inertias) {}
};

namespace detail {

/// Adds a body's composite inertia to its parent's, which is r away.
template <RealScalar Scalar>
void add_composite(const Vector3<Scalar>& r, const BodyInertia<Scalar>& own, BodyInertia<Scalar>& parent) {
  const Vector3<Scalar> shift = own.mass * r, s = Scalar(2) * own.h + shift;
  const Scalar x = r[0] * s[0], y = r[1] * s[1], z = r[2] * s[2], half(0.5);
  const Symmetric<Scalar> more{y + z, -half * (r[0] * s[1] + s[0] * r[1]), -half * (r[0] * s[2] + s[0] * r[2]),
                               x + z, -half * (r[1] * s[2] + s[1] * r[2]), x + y};  // -[r][h] - [h][r] - m [r][r]
  parent.I += own.I;
  parent.I += more;
  parent.h += own.h + shift;
  parent.mass += own.mass;
}

/// Writes column `column` of the mass matrix above its diagonal, and the row beside it: N, F move body i.
template <RealScalar Scalar>
void walk_up(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics, int i, Index column, Vector3<Scalar> N,
             const Vector3<Scalar>& F, Eigen::Ref<MatrixX<Scalar>>& M) {
  const Body<Scalar>* const bodies = tree.bodies().data();
  const BodyPlace<Scalar>* const places = kinematics.places.data();
  const auto add = [&](Index row, const Scalar& value) {
    M(row, column) += value;
    M(column, row) += value;
  };
  for (int below = i, j = bodies[i].parent; j >= 0; below = j, j = bodies[j].parent) {
    const Body<Scalar>& body = bodies[j];
    N += places[below].from_parent.cross(F);
    if (body.type != JointType::Free) {
      add(body.velocity, body.ratio * places[j].R.col(2).dot(body.type == JointType::Revolute ? N : F));
      continue;
    }
    const Matrix3<Scalar> axes = outer_axes(kinematics, body);
    for (int k = 0; k < 3; ++k) {
      add(body.velocity + k, axes.col(k).dot(F));
      add(body.velocity + 3 + k, axes.col(k).dot(N));
    }
  }
}

}  // namespace detail

/// Writes the mass matrix M (velocities × velocities, symmetric, all of it) where `kinematics` stands. Never allocates.
/// Complexity: O(bodies × depth) and the zeros.
template <RealScalar Scalar>
void mass_matrix(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics, MassMatrixWorkspace<Scalar>& work,
                 Eigen::Ref<MatrixX<Scalar>> M) {
  assert(M.rows() == tree.velocities() && M.cols() == tree.velocities());
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  for (std::size_t i = 0; i < bodies.size(); ++i) work.inertias[i].turn(kinematics.places[i].R, work.composites[i]);
  M.setConstant(Scalar(0));
  for (std::size_t i = bodies.size(); i-- > 0;) {
    const Body<Scalar>& body = bodies[i];
    const BodyPlace<Scalar>& place = kinematics.places[i];
    const detail::BodyInertia<Scalar>& own = work.composites[i];
    const int at = static_cast<int>(i);
    if (body.type == JointType::Free) {
      const Matrix3<Scalar> axes = detail::outer_axes(kinematics, body), slide = own.mass * axes;
      Matrix3<Scalar> turn_N, turn_F;
      for (int k = 0; k < 3; ++k) {
        turn_N.col(k) = own.I * Vector3<Scalar>(axes.col(k));
        turn_F.col(k) = axes.col(k).cross(own.h);
      }
      M.template block<3, 3>(body.velocity, body.velocity) = axes.transpose() * slide;
      M.template block<3, 3>(body.velocity, body.velocity + 3) = axes.transpose() * turn_F;
      M.template block<3, 3>(body.velocity + 3, body.velocity) = turn_F.transpose() * axes;
      M.template block<3, 3>(body.velocity + 3, body.velocity + 3) = axes.transpose() * turn_N;
      for (int k = 0; k < 3; ++k) {
        detail::walk_up<Scalar>(tree, kinematics, at, body.velocity + k, own.h.cross(axes.col(k)), slide.col(k), M);
        detail::walk_up<Scalar>(tree, kinematics, at, body.velocity + 3 + k, turn_N.col(k), turn_F.col(k), M);
      }
    } else {
      const bool turns = body.type == JointType::Revolute;
      const Vector3<Scalar> axis = body.ratio * place.R.col(2);
      const Vector3<Scalar> N = turns ? own.I * axis : Vector3<Scalar>(own.h.cross(axis));
      const Vector3<Scalar> F = turns ? axis.cross(own.h) : Vector3<Scalar>(own.mass * axis);
      M(body.velocity, body.velocity) += axis.dot(turns ? N : F);
      detail::walk_up<Scalar>(tree, kinematics, at, body.velocity, N, F, M);
    }
    if (body.parent >= 0) {
      detail::add_composite<Scalar>(place.from_parent, own, work.composites[static_cast<std::size_t>(body.parent)]);
    }
  }
}

}  // namespace clothctl::robot
