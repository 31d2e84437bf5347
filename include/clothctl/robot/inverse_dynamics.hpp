#pragma once

// Inverse dynamics and the mass matrix of a tree,
//
//   τ = M(q) q̈ + C(q, q̇) + g(q)
//
// Inverse dynamics is the recursive Newton-Euler algorithm: a pass from the root to the leaves
// finds the accelerations (α, A) of all bodies, a pass from the leaves to the root sums the moments
// and forces (N, F) that they need, and joint i with axis a carries τ_i = a · N (revolute) or a · F
// (prismatic). Gravity enters as an acceleration of the world, A_0 = -gravity. With q̈ = 0 the
// result is C + g, with q̇ = q̈ = 0 it is g.
//
// The mass matrix is computed by the composite rigid body algorithm: column i holds the torques for
// a unit acceleration of only joint i, which moves its body and everything below as one body of
// mass m, first moment h = m c and inertia I about its origin:
//
//   (N, F) = (I a, a × h)   revolute,      (h × a, m a)   prismatic
//   M_ji = a_j · N_j or a_j · F_j,         from a body to its parent:  N += r × F
//
// Reference: Luh, Walker, Paul (1980); Walker, Orin (1982); Featherstone, Rigid Body Dynamics
// Algorithms (2008) §5.3, §6.2.

#include <vector>

#include "clothctl/robot/detail/motion.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Memory of `mass_matrix`.
template <RealScalar Scalar>
struct MassMatrixWorkspace {
  /// Inertias in the bodies' own axes.
  std::vector<detail::BodyInertia<Scalar>> inertias;
  /// Inertias of each body with everything below it, in world axes.
  std::vector<detail::BodyInertia<Scalar>> composites;

  /// The tree that the workspace was made for.
  std::uint64_t fingerprint;

  /// Makes room for the bodies of `tree`. Allocates.
  explicit MassMatrixWorkspace(const KinematicTree<Scalar>& tree)
      : inertias(detail::body_inertias(tree)),
        composites(inertias),
        fingerprint(tree.fingerprint()) {}
};

namespace detail {

/// Adds the composite inertia `own` of a body to its parent's. `r` leads from the parent's origin
/// to the body's.
template <RealScalar Scalar>
void add_composite(const Vector3<Scalar>& r, const BodyInertia<Scalar>& own,
                   BodyInertia<Scalar>& parent) {
  const Vector3<Scalar> shift = own.mass * r, s = Scalar(2) * own.h + shift;
  const Scalar x = r[0] * s[0], y = r[1] * s[1], z = r[2] * s[2], half(0.5);
  const SymmetricMatrix3<Scalar> more{
      y + z, -half * (r[0] * s[1] + s[0] * r[1]), -half * (r[0] * s[2] + s[0] * r[2]),
      x + z, -half * (r[1] * s[2] + s[1] * r[2]), x + y};  // -[r][h] - [h][r] - m [r][r]
  parent.moments += own.moments;
  parent.moments += more;
  parent.h += own.h + shift;
  parent.mass += own.mass;
}

/// Adds to column `column` of the mass matrix and to the same entries of its row: the torques with
/// which the joints between body i and the world carry the moment N and the force F of body i.
template <RealScalar Scalar>
void propagate_to_root(const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
                       int i, Index column, Vector3<Scalar> N, const Vector3<Scalar>& F,
                       Eigen::Ref<MatrixX<Scalar>>& M) {
  const Body<Scalar>* const bodies = tree.bodies().data();
  const BodyPose<Scalar>* const poses = body_poses.poses.data();
  const auto add = [&](Index row, const Scalar& value) {
    M(row, column) += value;
    M(column, row) += value;
  };
  for (int below = i, j = bodies[i].parent; j >= 0; below = j, j = bodies[j].parent) {
    const Body<Scalar>& body = bodies[j];
    N += poses[below].from_parent.cross(F);
    if (body.type != JointType::Free) {
      add(body.velocity,
          body.ratio * poses[j].R.col(2).dot(body.type == JointType::Revolute ? N : F));
      continue;
    }
    const Matrix3<Scalar> axes = free_joint_axes(body_poses, body);
    for (int k = 0; k < 3; ++k) {
      add(body.velocity + k, axes.col(k).dot(F));
      add(body.velocity + 3 + k, axes.col(k).dot(N));
    }
  }
}

}  // namespace detail

/// Writes the mass matrix M (nv × nv, both triangles) at the poses `body_poses`. Never allocates.
/// Complexity: O(nv² + bodies × depth). Fails when (WrongSize, OtherTree): M is not nv × nv, or
/// poses or workspace are of another tree.
template <RealScalar Scalar>
TreeStatus mass_matrix(const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
                       MassMatrixWorkspace<Scalar>& work, Eigen::Ref<MatrixX<Scalar>> M) {
  if (M.rows() != tree.nv() || M.cols() != tree.nv()) return TreeStatus::WrongSize;
  if (!detail::poses_fit(tree, body_poses) || work.fingerprint != tree.fingerprint())
    return TreeStatus::OtherTree;
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  for (std::size_t i = 0; i < bodies.size(); ++i)
    work.inertias[i].rotate(body_poses.poses[i].R, work.composites[i]);
  M.setConstant(Scalar(0));
  for (std::size_t i = bodies.size(); i-- > 0;) {
    const Body<Scalar>& body = bodies[i];
    const BodyPose<Scalar>& place = body_poses.poses[i];
    const detail::BodyInertia<Scalar>& own = work.composites[i];
    const int at = static_cast<int>(i);
    if (body.type == JointType::Free) {
      const Matrix3<Scalar> axes = detail::free_joint_axes(body_poses, body),
                            slide = own.mass * axes;
      Matrix3<Scalar> turn_N, turn_F;
      for (int k = 0; k < 3; ++k) {
        turn_N.col(k) = own.moments * Vector3<Scalar>(axes.col(k));
        turn_F.col(k) = axes.col(k).cross(own.h);
      }
      M.template block<3, 3>(body.velocity, body.velocity) = axes.transpose() * slide;
      M.template block<3, 3>(body.velocity, body.velocity + 3) = axes.transpose() * turn_F;
      M.template block<3, 3>(body.velocity + 3, body.velocity) = turn_F.transpose() * axes;
      M.template block<3, 3>(body.velocity + 3, body.velocity + 3) = axes.transpose() * turn_N;
      for (int k = 0; k < 3; ++k) {
        detail::propagate_to_root<Scalar>(tree, body_poses, at, body.velocity + k,
                                          own.h.cross(axes.col(k)), slide.col(k), M);
        detail::propagate_to_root<Scalar>(tree, body_poses, at, body.velocity + 3 + k,
                                          turn_N.col(k), turn_F.col(k), M);
      }
    } else {
      const bool turns = body.type == JointType::Revolute;
      const Vector3<Scalar> axis = body.ratio * place.R.col(2);
      const Vector3<Scalar> N = turns ? own.moments * axis : Vector3<Scalar>(own.h.cross(axis));
      const Vector3<Scalar> F = turns ? axis.cross(own.h) : Vector3<Scalar>(own.mass * axis);
      M(body.velocity, body.velocity) += axis.dot(turns ? N : F);
      detail::propagate_to_root<Scalar>(tree, body_poses, at, body.velocity, N, F, M);
    }
    if (body.parent >= 0) {
      detail::add_composite<Scalar>(place.from_parent, own,
                                    work.composites[static_cast<std::size_t>(body.parent)]);
    }
  }
  return TreeStatus::Done;
}

/// Returns gravity on earth, (0, 0, -9.81) m/s².
template <RealScalar Scalar>
Vector3<Scalar> standard_gravity() {
  return {Scalar(0), Scalar(0), Scalar(-9.81)};
}

/// Memory of `inverse_dynamics`.
template <RealScalar Scalar>
struct InverseDynamicsWorkspace {
  /// Motions, inertias and forces.
  detail::BodyMotions<Scalar> motion;

  /// Makes room for the bodies of `tree`. Allocates.
  explicit InverseDynamicsWorkspace(const KinematicTree<Scalar>& tree) : motion(tree) {}
};

/// Writes the torques (nv; N or N m) that velocities `qd` and accelerations `qdd` (nv) need at the
/// poses `body_poses`. `gravity` is in m/s², world axes. A NaN in the input gives NaN torques.
/// Never allocates. Complexity: O(bodies). Fails when (WrongSize, OtherTree): a vector is not of
/// length nv, or poses or workspace are of another tree.
template <RealScalar Scalar>
TreeStatus inverse_dynamics(const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
                            const typename KinematicTree<Scalar>::VectorView& qd,
                            const typename KinematicTree<Scalar>::VectorView& qdd,
                            const Vector3<Scalar>& gravity, InverseDynamicsWorkspace<Scalar>& work,
                            Eigen::Ref<VectorX<Scalar>> torques) {
  if (qd.size() != tree.nv() || qdd.size() != tree.nv() || torques.size() != tree.nv())
    return TreeStatus::WrongSize;
  if (!detail::poses_fit(tree, body_poses) || !work.motion.fits(tree)) return TreeStatus::OtherTree;
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  detail::compute_motions<Scalar>(tree, body_poses, qd, qdd, gravity, work.motion);
  torques.setConstant(Scalar(0));
  for (std::size_t i = bodies.size(); i-- > 0;) {
    const Body<Scalar>& body = bodies[i];
    const BodyPose<Scalar>& place = body_poses.poses[i];
    const Vector3<Scalar>&N = work.motion.bodies[i].N, &F = work.motion.bodies[i].F;
    if (body.type == JointType::Revolute) {
      torques[body.velocity] += body.ratio * place.R.col(2).dot(N);
    } else if (body.type == JointType::Prismatic) {
      torques[body.velocity] += body.ratio * place.R.col(2).dot(F);
    } else {
      const Matrix3<Scalar> axes = detail::free_joint_axes(body_poses, body);
      torques.template segment<3>(body.velocity) = axes.transpose() * F;
      torques.template segment<3>(body.velocity + 3) = axes.transpose() * N;
    }
    if (body.parent < 0) continue;
    detail::BodyMotion<Scalar>& parent = work.motion.bodies[static_cast<std::size_t>(body.parent)];
    parent.F += F;
    parent.N += N + place.from_parent.cross(F);
  }
  return TreeStatus::Done;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
