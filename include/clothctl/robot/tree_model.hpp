#pragma once

// A tree as inverse kinematics and hand control see it (concepts/articulated.hpp): frames are its links, and gravity stands in
// the workspace.

#include "clothctl/concepts/articulated.hpp"
#include "clothctl/robot/forward_dynamics.hpp"

namespace clothctl {

namespace robot {

/// All memory that a tree's kinematics and dynamics need.
template <RealScalar Scalar>
struct TreeWorkspace {
  /// Where the bodies are.
  Kinematics<Scalar> kinematics;
  /// Memory of `inverse_dynamics`.
  InverseDynamicsWorkspace<Scalar> inverse;
  /// Memory of `forward_dynamics`.
  ForwardDynamicsWorkspace<Scalar> forward;
  /// Gravity (m/s²).
  Vector3<Scalar> gravity = standard_gravity<Scalar>();

  /// Makes room for a tree. Allocates.
  explicit TreeWorkspace(const Tree<Scalar>& tree) : kinematics(tree), inverse(tree), forward(tree) {}
};

}  // namespace robot

/// A tree is a robot.
template <RealScalar Scalar>
struct articulated_traits<robot::Tree<Scalar>> {
  /// The number type.
  using scalar_type = Scalar;
  /// The memory.
  using workspace_type = robot::TreeWorkspace<Scalar>;
  /// The model.
  using Model = robot::Tree<Scalar>;
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// A view of a vector that is written.
  using Out = Eigen::Ref<VectorX<Scalar>>;

  /// Makes a workspace. Allocates.
  static workspace_type make_workspace(const Model& tree) { return workspace_type(tree); }
  /// Number of frames: the links.
  static Index frames(const Model& tree) { return static_cast<Index>(tree.links().size()); }
  /// Length of positions.
  static Index positions(const Model& tree) { return tree.positions(); }
  /// Length of velocities.
  static Index velocities(const Model& tree) { return tree.velocities(); }
  /// Least positions.
  static const VectorX<Scalar>& lower(const Model& tree) { return tree.lower(); }
  /// Largest positions.
  static const VectorX<Scalar>& upper(const Model& tree) { return tree.upper(); }
  /// Largest torques.
  static const VectorX<Scalar>& effort_limits(const Model& tree) { return tree.effort_limits(); }
  /// q moved along a step.
  static void advance(const Model& tree, const View& q, const View& step, Out out) { tree.advance(q, step, out); }
  /// The step from one q to another.
  static void difference(const Model& tree, const View& from, const View& to, Out out) { tree.difference(from, to, out); }
  /// Places all bodies.
  static void place(const Model& tree, const View& q, workspace_type& work) {
    robot::forward_kinematics<Scalar>(tree, q, work.kinematics);
  }
  /// The pose of a link.
  static void frame_pose(const Model& tree, const workspace_type& work, int link, Matrix3<Scalar>& R, Vector3<Scalar>& p) {
    const robot::Pose<Scalar> pose = robot::link_pose(tree, work.kinematics, link);
    R = pose.R;
    p = pose.p;
  }
  /// The Jacobian of a world point on a link.
  static void point_jacobian(const Model& tree, const workspace_type& work, int link, const Vector3<Scalar>& x,
                             Eigen::Ref<MatrixX<Scalar>> J) {
    robot::point_jacobian<Scalar>(tree, work.kinematics, link, x, J);
  }
  /// The same, linear rows alone, times a factor: what inverse kinematics asks most often.
  static void position_jacobian(const Model& tree, const workspace_type& work, int link, const Vector3<Scalar>& x,
                                const Scalar& factor, Eigen::Ref<MatrixX<Scalar>> J) {
    robot::position_jacobian<Scalar>(tree, work.kinematics, link, x, factor, J);
  }
  /// Torques of an acceleration.
  static void inverse_dynamics(const Model& tree, const View& qd, const View& qdd, workspace_type& work, Out torques) {
    robot::inverse_dynamics<Scalar>(tree, work.kinematics, qd, qdd, work.gravity, work.inverse, torques);
  }
  /// Accelerations of torques; -1, or the coordinate without a finite answer.
  [[nodiscard]] static Index forward_dynamics(const Model& tree, const View& qd, const View& torques, const View& diagonal,
                                              workspace_type& work, Out qdd) {
    const robot::DynamicsReport report =
        robot::forward_dynamics<Scalar>(tree, work.kinematics, qd, torques, diagonal, work.gravity, work.forward, qdd);
    if (report.status == robot::DynamicsStatus::Solved) return -1;
    return report.body < 0 ? Index(0) : tree.bodies()[static_cast<std::size_t>(report.body)].velocity;
  }
};

}  // namespace clothctl
