#pragma once

// Recursive Newton-Euler: the torques that an acceleration takes,
//
//   τ = M(q) q̈ + C(q, q̇) + g(q),      root to leaf (α, A), leaf to root (N, F),  τ_i = a · N or a · F
//
// with gravity as an acceleration of the world, A_0 = -gravity. C + g is the answer for q̈ = 0, g that for q̇ = q̈ = 0.
// Reference: Luh, Walker, Paul (1980); Featherstone (2008) §5.3.

#include <cassert>
#include <vector>

#include "clothctl/robot/motion.hpp"

namespace clothctl::robot {

/// Gravity on earth, z up (m/s²).
template <RealScalar Scalar>
Vector3<Scalar> standard_gravity() {
  return {Scalar(0), Scalar(0), Scalar(-9.81)};
}

/// Memory of `inverse_dynamics`.
template <RealScalar Scalar>
struct InverseDynamicsWorkspace {
  /// Velocities and inertias.
  Motion<Scalar> motion;
  /// Angular acceleration of each body, and acceleration of its origin.
  std::vector<Vector3<Scalar>> turning, moving;
  /// Moment about each body's origin and force that its joint passes on.
  std::vector<Vector3<Scalar>> moments, forces;

  /// Makes room for a tree's bodies. Allocates.
  explicit InverseDynamicsWorkspace(const Tree<Scalar>& tree) : motion(tree) {
    for (std::vector<Vector3<Scalar>>* v : {&turning, &moving, &moments, &forces}) v->resize(tree.bodies().size());
  }
};

/// Writes the torques of velocities qd and accelerations qdd (N, N m) where `kinematics` stands. NaN in shows in the torques.
/// Never allocates. Complexity: O(bodies).
template <RealScalar Scalar>
void inverse_dynamics(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics,
                      const typename Tree<Scalar>::VectorView& qd, const typename Tree<Scalar>::VectorView& qdd,
                      const Vector3<Scalar>& gravity, InverseDynamicsWorkspace<Scalar>& work,
                      Eigen::Ref<VectorX<Scalar>> torques) {
  assert(qd.size() == tree.velocities() && qdd.size() == tree.velocities() && torques.size() == tree.velocities());
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  detail::place_inertias(tree, kinematics, work.motion);
  detail::place_velocities<Scalar>(tree, kinematics, qd, work.motion);
  const Vector3<Scalar> zero = Vector3<Scalar>::Constant(Scalar(0)), up = -gravity;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const Body<Scalar>& body = bodies[i];
    const BodyPlace<Scalar>& place = kinematics.places[i];
    const detail::BodyMotion<Scalar>& own = work.motion.bodies[i];
    const std::size_t p = static_cast<std::size_t>((std::max)(body.parent, 0));
    const Vector3<Scalar>&turn_p = body.parent < 0 ? zero : work.turning[p], &move_p = body.parent < 0 ? up : work.moving[p];
    Vector3<Scalar>&turn = work.turning[i], &move = work.moving[i];
    turn = turn_p + own.c_turn;
    move = move_p + turn_p.cross(place.from_parent) + own.c_move;
    if (body.type == JointType::Revolute) {
      turn += (body.ratio * qdd[body.velocity]) * place.R.col(2);
    } else if (body.type == JointType::Prismatic) {
      move += (body.ratio * qdd[body.velocity]) * place.R.col(2);
    } else {
      const Matrix3<Scalar> axes = detail::outer_axes(kinematics, body);
      move += axes * qdd.template segment<3>(body.velocity);
      turn += axes * qdd.template segment<3>(body.velocity + 3);
    }
    work.moments[i] = own.bias_N + own.I * turn + own.h.cross(move);
    work.forces[i] = own.bias_F + body.inertia.mass * move + turn.cross(own.h);
  }
  torques.setConstant(Scalar(0));
  for (std::size_t i = bodies.size(); i-- > 0;) {
    const Body<Scalar>& body = bodies[i];
    const BodyPlace<Scalar>& place = kinematics.places[i];
    const Vector3<Scalar>&N = work.moments[i], &F = work.forces[i];
    if (body.type == JointType::Revolute) {
      torques[body.velocity] += body.ratio * place.R.col(2).dot(N);
    } else if (body.type == JointType::Prismatic) {
      torques[body.velocity] += body.ratio * place.R.col(2).dot(F);
    } else {
      const Matrix3<Scalar> axes = detail::outer_axes(kinematics, body);
      torques.template segment<3>(body.velocity) = axes.transpose() * F;
      torques.template segment<3>(body.velocity + 3) = axes.transpose() * N;
    }
    if (body.parent < 0) continue;
    const std::size_t p = static_cast<std::size_t>(body.parent);
    work.forces[p] += F;
    work.moments[p] += N + place.from_parent.cross(F);
  }
}

}  // namespace clothctl::robot
