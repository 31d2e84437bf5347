#pragma once

// Makes KinematicTree a model of ArticulatedDynamics (concepts/articulated.hpp), so that inverse
// kinematics and stable PD take it. Its frames are the links of the tree. Gravity is a member of
// the workspace.

#include "clothctl/concepts/articulated.hpp"
#include "clothctl/robot/forward_dynamics.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// All memory that kinematics and dynamics of a tree need.
template <RealScalar Scalar>
struct KinematicTreeWorkspace {
  /// Poses of the bodies.
  BodyPoses<Scalar> body_poses;
  /// Memory of `inverse_dynamics`.
  InverseDynamicsWorkspace<Scalar> inverse;
  /// Memory of `forward_dynamics`.
  ForwardDynamicsWorkspace<Scalar> forward;
  /// Gravity (m/s², world).
  Vector3<Scalar> gravity = standard_gravity<Scalar>();

  /// Makes room for `tree`. Allocates.
  explicit KinematicTreeWorkspace(const KinematicTree<Scalar>& tree)
      : body_poses(tree), inverse(tree), forward(tree) {}
};

/// How a tree takes part as an ArticulatedDynamics model.
template <RealScalar Scalar>
struct articulated_traits<KinematicTree<Scalar>> {
  /// The scalar type.
  using scalar_type = Scalar;
  /// The workspace.
  using workspace_type = KinematicTreeWorkspace<Scalar>;
  /// The model.
  using Model = KinematicTree<Scalar>;
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// A view of a vector that is written.
  using Out = Eigen::Ref<VectorX<Scalar>>;

  /// Makes a workspace. Allocates.
  static workspace_type make_workspace(const Model& tree) { return workspace_type(tree); }
  /// Returns the number of frames: one for each link.
  static Index frames(const Model& tree) { return static_cast<Index>(tree.links().size()); }
  /// Returns true when `work` was made for this tree or a copy of it.
  static bool workspace_fits(const Model& tree, const workspace_type& work) {
    return detail::poses_fit(tree, work.body_poses) && work.inverse.motion.fits(tree) &&
           work.forward.motion.fits(tree);
  }
  /// Returns the length of positions.
  static Index nq(const Model& tree) { return tree.nq(); }
  /// Returns the length of velocities.
  static Index nv(const Model& tree) { return tree.nv(); }
  /// Returns the lowest positions.
  static const VectorX<Scalar>& lower(const Model& tree) { return tree.lower(); }
  /// Returns the highest positions.
  static const VectorX<Scalar>& upper(const Model& tree) { return tree.upper(); }
  /// Returns the largest torques.
  static const VectorX<Scalar>& effort_limits(const Model& tree) { return tree.effort_limits(); }
  /// Writes q moved along `step`.
  static void advance(const Model& tree, const View& q, const View& step, Out out) {
    tree.advance(q, step, out);
  }
  /// Writes the step between two positions.
  static void difference(const Model& tree, const View& from, const View& to, Out out) {
    tree.difference(from, to, out);
  }
  /// Computes the poses of all bodies.
  static void forward_kinematics(const Model& tree, const View& q, workspace_type& work) {
    clothctl::forward_kinematics<Scalar>(tree, q, work.body_poses);
  }
  /// Writes the pose of a link; infinite entries where there is no such link.
  static void frame_pose(const Model& tree, const workspace_type& work, int link,
                         Matrix3<Scalar>& R, Vector3<Scalar>& p) {
    const Pose<Scalar> pose = link_pose(tree, work.body_poses, link);
    R = pose.R;
    p = pose.p;
  }
  /// Writes the Jacobian of a point that is fixed on a link; see `point_jacobian`.
  static void point_jacobian(const Model& tree, const workspace_type& work, int link,
                             const Vector3<Scalar>& x, Eigen::Ref<MatrixX<Scalar>> J) {
    clothctl::point_jacobian<Scalar>(tree, work.body_poses, link, x, J);
  }
  /// Writes the linear rows of the Jacobian, times `factor`.
  static void position_jacobian(const Model& tree, const workspace_type& work, int link,
                                const Vector3<Scalar>& x, const Scalar& factor,
                                Eigen::Ref<MatrixX<Scalar>> J) {
    clothctl::position_jacobian<Scalar>(tree, work.body_poses, link, x, factor, J);
  }
  /// Writes the torques that accelerations need.
  static void inverse_dynamics(const Model& tree, const View& qd, const View& qdd,
                               workspace_type& work, Out torques) {
    clothctl::inverse_dynamics<Scalar>(tree, work.body_poses, qd, qdd, work.gravity, work.inverse,
                                       torques);
  }
  /// Writes the accelerations that torques cause. Returns -1 on success; else the velocity
  /// coordinate of the joint without inertia, or 0 if something else is wrong.
  [[nodiscard]] static Index forward_dynamics(const Model& tree, const View& qd,
                                              const View& torques, const View& diagonal,
                                              workspace_type& work, Out qdd) {
    const DynamicsReport report = clothctl::forward_dynamics<Scalar>(
        tree, work.body_poses, qd, torques, diagonal, work.gravity, work.forward, qdd);
    if (report.status == DynamicsStatus::Solved) return -1;
    return report.body < 0 ? Index(0)
                           : tree.bodies()[static_cast<std::size_t>(report.body)].velocity;
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI
