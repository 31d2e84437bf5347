#pragma once

// Forward dynamics by the articulated-body algorithm: the accelerations that torques cause, with a
// diagonal d ≥ 0 added to the mass matrix,
//
//   (M(q) + diag d) q̈ = τ - C(q, q̇) - g(q)
//
// with the mass matrix M, the Coriolis and centrifugal torques C and the torques g that hold the
// robot against gravity. Three passes over the tree:
//
// 1. From the root to the leaves: motions at q̈ = 0 and the forces p = (N, F) that they need
//    (detail/motion.hpp).
// 2. From the leaves to the root: the articulated inertia of each body, from which its joint is
//    eliminated (detail/articulated_inertia.hpp).
// 3. From the root to the leaves: q̈ = D⁻¹ (u - Uᵀ (α, A)) with the symbols of step 2 and the
//    parent's acceleration (α, A), shifted to the body's origin.
//
// For a tree whose joints share coordinates, M + diag d is built and factored instead.
//
// Reference: Featherstone, Rigid Body Dynamics Algorithms (2008) §7.3. The diagonal is that of
// stable PD: Tan, Liu, Turk (2011), who solve a dense system.

#include <string_view>
#include <vector>

#include "clothctl/linalg/small_cholesky.hpp"
#include "clothctl/robot/detail/articulated_inertia.hpp"
#include "clothctl/robot/inverse_dynamics.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How forward dynamics ended.
enum class DynamicsStatus {
  /// The accelerations are finite. Use them.
  Solved,
  /// Poses, velocities, torques, diagonal or gravity hold NaN or an infinity. Do not use the
  /// accelerations; correct the input.
  InvalidInput,
  /// A joint moves nothing that has inertia and has no diagonal; the report names its body. Give
  /// the link an inertia or the joint a diagonal. Body -1: the accelerations overflow.
  NoInertia,
  /// A vector is not of length nv; nothing was written. Correct the call.
  WrongSize,
  /// Poses or workspace were made for another tree; nothing was written. Make them for this one.
  OtherTree
};

/// Returns the name of a status.
constexpr std::string_view to_string(DynamicsStatus status) {
  switch (status) {
    case DynamicsStatus::Solved: return "solved";
    case DynamicsStatus::InvalidInput: return "invalid_input";
    case DynamicsStatus::NoInertia: return "no_inertia";
    case DynamicsStatus::WrongSize: return "wrong_size";
    case DynamicsStatus::OtherTree: return "other_tree";
  }
  return "unknown";
}

/// Result of forward dynamics.
struct DynamicsReport {
  /// How it ended.
  DynamicsStatus status = DynamicsStatus::Solved;
  /// With NoInertia the body that the joint moves, or -1 where accelerations overflow; else -1.
  int body = -1;
};

/// Memory of `forward_dynamics`.
template <RealScalar Scalar>
struct ForwardDynamicsWorkspace {
  /// Motions and inertias of the bodies.
  detail::BodyMotions<Scalar> motion;
  /// Articulated inertias of a body and of the bodies between it and the world, by depth.
  std::vector<detail::ArticulatedInertia<Scalar>> articulated;
  /// Joints, one for each body.
  std::vector<detail::EliminatedJoint<Scalar>> joints;
  /// U of each free joint.
  std::vector<Eigen::Matrix<Scalar, 6, 6>> free_U;
  /// D⁻¹ (Uᵀ, u) of each free joint.
  std::vector<Eigen::Matrix<Scalar, 6, 7>> free_solved;
  /// For each body its index in the two lists above, or -1.
  std::vector<int> free_slot;
  /// Memory of `inverse_dynamics`, for coupled trees.
  InverseDynamicsWorkspace<Scalar> inverse;
  /// Memory of `mass_matrix`, for coupled trees.
  MassMatrixWorkspace<Scalar> composite;
  /// The mass matrix of a coupled tree, else empty.
  MatrixX<Scalar> M;
  /// Its Cholesky factor.
  clothctl::SmallCholesky<Scalar> factor;
  /// Torques C + g of a coupled tree.
  VectorX<Scalar> bias;
  /// An empty vector.
  VectorX<Scalar> none;

  /// Makes room for `tree`. Allocates.
  explicit ForwardDynamicsWorkspace(const KinematicTree<Scalar>& tree)
      : motion(tree),
        articulated(tree.bodies().size()),
        joints(tree.bodies().size()),
        free_slot(tree.bodies().size(), -1),
        inverse(tree),
        composite(tree) {
    int count = 0;
    for (std::size_t i = 0; i < tree.bodies().size(); ++i) {
      const int p = tree.bodies()[i].parent;
      joints[i].depth = p < 0 ? 0 : joints[static_cast<std::size_t>(p)].depth + 1;
      if (tree.bodies()[i].type == JointType::Free) free_slot[i] = count++;
    }
    free_U.resize(static_cast<std::size_t>(count));
    free_solved.resize(static_cast<std::size_t>(count));
    const Index n = tree.coupled() ? tree.nv() : 0;
    M.setZero(n, n);
    factor.reserve(n);
    bias.setZero(tree.nv());
  }
};

namespace detail {

/// Forward dynamics by a Cholesky factor of M + diag d, for trees whose joints share coordinates.
template <RealScalar Scalar>
DynamicsReport coupled_dynamics(
    const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
    const Eigen::Ref<const VectorX<Scalar>>& qd, const Eigen::Ref<const VectorX<Scalar>>& torques,
    const Eigen::Ref<const VectorX<Scalar>>& diagonal, const Vector3<Scalar>& gravity,
    ForwardDynamicsWorkspace<Scalar>& work, Eigen::Ref<VectorX<Scalar>> qdd) {
  MatrixX<Scalar>& M = work.M;
  qdd.setConstant(Scalar(0));
  inverse_dynamics<Scalar>(tree, body_poses, qd, qdd, gravity, work.inverse, work.bias);
  mass_matrix<Scalar>(tree, body_poses, work.composite, M);
  if (diagonal.size() > 0) M.diagonal() += diagonal;
  qdd = torques - work.bias;
  work.factor.resize(M.rows());
  for (Index j = 0; j < M.cols(); ++j) {
    for (Index i = j; i < M.rows(); ++i) work.factor(i, j) = M(i, j);
  }
  const Index failed = work.factor.solve(qdd);
  for (std::size_t i = 0; failed >= 0 && i < tree.bodies().size(); ++i) {
    const Body<Scalar>& body = tree.bodies()[i];
    const Index last = body.velocity + (body.type == JointType::Free ? 5 : 0);
    if (body.velocity <= failed && failed <= last)
      return {DynamicsStatus::NoInertia, static_cast<int>(i)};
  }
  return {};
}

/// The second pass, leaves first. Returns the body whose joint has no inertia to move, or -1.
template <RealScalar Scalar>
[[gnu::flatten]] int inward_pass(const KinematicTree<Scalar>& tree,
                                 const BodyPoses<Scalar>& body_poses,
                                 const Eigen::Ref<const VectorX<Scalar>>& torques,
                                 const Eigen::Ref<const VectorX<Scalar>>& diagonal,
                                 ForwardDynamicsWorkspace<Scalar>& work) {
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  for (std::size_t i = bodies.size(); i-- > 0;) {
    const Body<Scalar>& body = bodies[i];
    const BodyPose<Scalar>& place = body_poses.poses[i];
    EliminatedJoint<Scalar>& joint = work.joints[i];
    ArticulatedInertia<Scalar>& a = work.articulated[static_cast<std::size_t>(joint.depth)];
    if (body.subtree_end == static_cast<int>(i) + 1) a.clear();
    a.add(work.motion.bodies[i]);
    bool released;
    if (body.type != JointType::Free) {
      const Scalar more = diagonal.size() > 0 ? diagonal[body.velocity] : Scalar(0);
      released = eliminate_joint<Scalar>(body.type == JointType::Revolute, place.R.col(2),
                                         torques[body.velocity], more, a, joint);
    } else {
      const std::size_t k = static_cast<std::size_t>(work.free_slot[i]);
      released =
          eliminate_free_joint<Scalar>(free_joint_axes(body_poses, body), torques, diagonal,
                                       body.velocity, work.free_U[k], work.free_solved[k], a);
    }
    if (!released) return static_cast<int>(i);
    if (body.parent < 0) continue;
    ArticulatedInertia<Scalar>& parent =
        work.articulated[static_cast<std::size_t>(joint.depth - 1)];
    if (body.subtree_end == bodies[static_cast<std::size_t>(body.parent)].subtree_end)
      parent.clear();  // this is the first of its children
    add_to_parent<Scalar>(place.from_parent, a, parent);
  }
  return -1;
}

/// The third pass, root first.
template <RealScalar Scalar>
[[gnu::flatten]] void outward_pass(const KinematicTree<Scalar>& tree,
                                   const BodyPoses<Scalar>& body_poses,
                                   ForwardDynamicsWorkspace<Scalar>& work,
                                   Eigen::Ref<VectorX<Scalar>>& qdd) {
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  const Padded3<Scalar> zero = Padded3<Scalar>::Constant(Scalar(0));
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const Body<Scalar>& body = bodies[i];
    const BodyPose<Scalar>& place = body_poses.poses[i];
    EliminatedJoint<Scalar>& joint = work.joints[i];
    if (body.parent < 0) {
      joint.alpha = joint.a = zero;
    } else {
      const EliminatedJoint<Scalar>& parent = work.joints[static_cast<std::size_t>(body.parent)];
      joint.alpha = parent.alpha;
      PaddedMatrix3<Scalar> back;
      back.clear();
      back.add_cross(-place.from_parent);
      Padded3<Scalar> a = parent.a;
      back.add_product(parent.alpha, a);
      joint.a = a;
    }
    if (body.type == JointType::Free) {
      const Eigen::Matrix<Scalar, 6, 7>& solved =
          work.free_solved[static_cast<std::size_t>(work.free_slot[i])];
      const Matrix3<Scalar> axes = free_joint_axes(body_poses, body);
      auto own_qdd = qdd.template segment<6>(body.velocity);
      own_qdd = solved.col(6) - solved.template leftCols<3>() * joint.alpha.template head<3>() -
                solved.template block<6, 3>(0, 3) * joint.a.template head<3>();
      joint.a.template head<3>() += axes * own_qdd.template head<3>();
      joint.alpha.template head<3>() += axes * own_qdd.template tail<3>();
      continue;
    }
    const Scalar acceleration = joint.inverse * (joint.u - dot<Scalar>(joint.alpha, joint.U_N) -
                                                 dot<Scalar>(joint.a, joint.U_F));
    qdd[body.velocity] = acceleration;
    const Vector3<Scalar>& axis = place.R.col(2);
    add_padded<Scalar>(acceleration * axis,
                       body.type == JointType::Revolute ? joint.alpha : joint.a);
  }
}

}  // namespace detail

/// Writes the accelerations (nv) that `torques` (nv; N or N m) cause at velocities `qd` (nv) and
/// poses `body_poses`. `diagonal` (nv, or empty for zero) is added to the diagonal of the mass
/// matrix. `gravity` is in m/s², world axes. Add external forces f at a point to the torques as Jᵀ
/// f. Never allocates. Complexity: O(bodies), and O(nv³) for coupled trees. Fails when: see
/// DynamicsStatus.
template <RealScalar Scalar>
[[nodiscard]] DynamicsReport forward_dynamics(
    const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
    const typename KinematicTree<Scalar>::VectorView& qd,
    const typename KinematicTree<Scalar>::VectorView& torques,
    const typename KinematicTree<Scalar>::VectorView& diagonal, const Vector3<Scalar>& gravity,
    ForwardDynamicsWorkspace<Scalar>& work, Eigen::Ref<VectorX<Scalar>> qdd) {
  const Index n = tree.nv();
  if (qd.size() != n || torques.size() != n || qdd.size() != n ||
      (diagonal.size() != 0 && diagonal.size() != n))
    return {DynamicsStatus::WrongSize, -1};
  if (!detail::poses_fit(tree, body_poses) || !work.motion.fits(tree))
    return {DynamicsStatus::OtherTree, -1};
  const auto refuse = [&](int body) -> DynamicsReport {
    const bool finite =
        all_finite(qd) && all_finite(torques) && all_finite(diagonal) && all_finite(gravity);
    bool placed = true;
    for (const BodyPose<Scalar>& place : body_poses.poses)
      placed = placed && all_finite(place.R) && all_finite(place.p);
    return finite && placed ? DynamicsReport{DynamicsStatus::NoInertia, body}
                            : DynamicsReport{DynamicsStatus::InvalidInput, -1};
  };
  if (tree.coupled()) {
    const DynamicsReport report = detail::coupled_dynamics<Scalar>(tree, body_poses, qd, torques,
                                                                   diagonal, gravity, work, qdd);
    if (report.status == DynamicsStatus::Solved && all_finite(qdd)) return report;
    return refuse(report.body);
  }
  detail::compute_motions<Scalar>(tree, body_poses, qd, work.none, gravity, work.motion);
  const int stuck = detail::inward_pass<Scalar>(tree, body_poses, torques, diagonal, work);
  if (stuck >= 0) return refuse(stuck);
  detail::outward_pass<Scalar>(tree, body_poses, work, qdd);
  return all_finite(qdd) ? DynamicsReport{} : refuse(-1);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
