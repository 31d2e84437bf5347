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
  /// Motions, inertias and forces.
  Motion<Scalar> motion;

  /// Makes room for a tree's bodies. Allocates.
  explicit InverseDynamicsWorkspace(const Tree<Scalar>& tree) : motion(tree) {}
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
  detail::place_motions<Scalar>(tree, kinematics, qd, qdd, gravity, work.motion);
  torques.setConstant(Scalar(0));
  for (std::size_t i = bodies.size(); i-- > 0;) {
    const Body<Scalar>& body = bodies[i];
    const BodyPlace<Scalar>& place = kinematics.places[i];
    const Vector3<Scalar>&N = work.motion.bodies[i].N, &F = work.motion.bodies[i].F;
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
    detail::BodyMotion<Scalar>& parent = work.motion.bodies[static_cast<std::size_t>(body.parent)];
    parent.F += F;
    parent.N += N + place.from_parent.cross(F);
  }
}

}  // namespace clothctl::robot
