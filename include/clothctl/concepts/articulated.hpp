#pragma once

// ArticulatedModel and ArticulatedDynamics: what inverse kinematics and hand control ask of a robot. Both are checked through a
// trait, so that a robot of another library joins in by specialising the trait in its user's tree.
//
// A model is const; what depends on where it stands is in a workspace, made once. Positions q may have more entries than
// velocities (quaternions); `advance` and `difference` go between them. Twists are linear first, in world axes.

#include <concepts>

#include "clothctl/core/types.hpp"

namespace clothctl {

namespace detail {

/// The number and workspace types of a model that names them; empty for every other type.
template <class Model>
struct articulated_types_of {};
template <class Model>
requires requires {
  typename Model::scalar_type;
  typename Model::workspace_type;
}
struct articulated_types_of<Model> {
  using scalar_type = typename Model::scalar_type;
  using workspace_type = typename Model::workspace_type;
};

}  // namespace detail

/// How a type acts as a robot. The primary forwards to members of the same names.
template <class Model>
struct articulated_traits : detail::articulated_types_of<Model> {
  /// Makes a workspace. Allocates.
  static auto make_workspace(const Model& model) requires requires { model.make_workspace(); }
  { return model.make_workspace(); }
  /// Length of positions.
  static Index positions(const Model& model) requires requires { model.positions(); }
  { return model.positions(); }
  /// Length of velocities, accelerations and torques.
  static Index velocities(const Model& model) requires requires { model.velocities(); }
  { return model.velocities(); }
  /// Least positions; infinite where there is no limit.
  static decltype(auto) lower(const Model& model) requires requires { model.lower(); }
  { return model.lower(); }
  /// Largest positions.
  static decltype(auto) upper(const Model& model) requires requires { model.upper(); }
  { return model.upper(); }
  /// Largest torques.
  static decltype(auto) effort_limits(const Model& model) requires requires { model.effort_limits(); }
  { return model.effort_limits(); }
  /// q moved along `step` (velocity times time) to `out`.
  template <class Q, class Step, class Out>
  requires requires(const Model& m, const Q& q, const Step& step, Out& out) { m.advance(q, step, out); }
  static void advance(const Model& model, const Q& q, const Step& step, Out&& out) { model.advance(q, step, out); }
  /// The step that takes `from` to `to`.
  template <class From, class To, class Out>
  requires requires(const Model& m, const From& from, const To& to, Out& out) { m.difference(from, to, out); }
  static void difference(const Model& model, const From& from, const To& to, Out&& out) { model.difference(from, to, out); }
  /// Puts the workspace to positions q.
  template <class Vector, class Workspace>
  requires requires(const Model& m, const Vector& v, Workspace& w) { m.place(v, w); }
  static void place(const Model& model, const Vector& q, Workspace& work) { model.place(q, work); }
  /// Writes rotation and origin of a frame in the world.
  template <class Scalar, class Workspace>
  requires requires(const Model& m, const Workspace& w, Matrix3<Scalar>& R, Vector3<Scalar>& p) { m.frame_pose(w, 0, R, p); }
  static void frame_pose(const Model& model, const Workspace& work, int frame, Matrix3<Scalar>& R, Vector3<Scalar>& p) {
    model.frame_pose(work, frame, R, p);
  }
  /// Writes the Jacobian (6 × velocities) of the world point x that is fixed on a frame.
  template <class Scalar, class Workspace, class Out>
  requires requires(const Model& m, const Workspace& w, const Vector3<Scalar>& x, Out& J) { m.point_jacobian(w, 0, x, J); }
  static void point_jacobian(const Model& model, const Workspace& work, int frame, const Vector3<Scalar>& x, Out&& J) {
    model.point_jacobian(work, frame, x, J);
  }
  /// Writes the torques that velocities qd and accelerations qdd take, gravity included.
  template <class Qd, class Qdd, class Workspace, class Out>
  requires requires(const Model& m, const Qd& qd, const Qdd& qdd, Workspace& w, Out& out) {
    m.inverse_dynamics(qd, qdd, w, out);
  }
  static void inverse_dynamics(const Model& model, const Qd& qd, const Qdd& qdd, Workspace& work, Out&& torques) {
    model.inverse_dynamics(qd, qdd, work, torques);
  }
  /// Writes the accelerations that torques cause at velocities qd, with a diagonal added to the mass matrix. Answers -1, or the
  /// coordinate (or any, where the input is not finite) at which no finite answer exists.
  template <class Qd, class Torques, class Diagonal, class Workspace, class Out>
  requires requires(const Model& m, const Qd& qd, const Torques& t, const Diagonal& d, Workspace& w, Out& out) {
    m.forward_dynamics(qd, t, d, w, out);
  }
  [[nodiscard]] static auto forward_dynamics(const Model& model, const Qd& qd, const Torques& torques, const Diagonal& diagonal,
                                             Workspace& work, Out&& qdd) {
    return model.forward_dynamics(qd, torques, diagonal, work, qdd);
  }
};

/// A robot's kinematics.
///
/// Axioms: J q̇ is the derivative of the frame's motion along `advance`; `advance` along `difference` arrives; const model, one
/// workspace a thread; nothing but make_workspace allocates.
template <class Model, class Scalar = double>
concept ArticulatedModel = RealScalar<Scalar> && requires {
  typename articulated_traits<Model>::workspace_type;
} && requires(const Model& model, typename articulated_traits<Model>::workspace_type& work, const VectorX<Scalar>& v,
              VectorX<Scalar>& out, MatrixX<Scalar>& J, Matrix3<Scalar>& R, Vector3<Scalar>& p, int frame) {
  { articulated_traits<Model>::make_workspace(model) } -> std::same_as<typename articulated_traits<Model>::workspace_type>;
  { articulated_traits<Model>::positions(model) } -> std::convertible_to<Index>;
  { articulated_traits<Model>::velocities(model) } -> std::convertible_to<Index>;
  { articulated_traits<Model>::lower(model) } -> std::convertible_to<VectorX<Scalar>>;
  { articulated_traits<Model>::upper(model) } -> std::convertible_to<VectorX<Scalar>>;
  articulated_traits<Model>::advance(model, v, v, out);
  articulated_traits<Model>::difference(model, v, v, out);
  articulated_traits<Model>::place(model, v, work);
  articulated_traits<Model>::frame_pose(model, work, frame, R, p);
  articulated_traits<Model>::point_jacobian(model, work, frame, p, J);
};

/// A robot's dynamics too: τ = M(q) q̈ + C(q, q̇) + g(q).
///
/// Axioms: forward dynamics undoes inverse dynamics; with a diagonal d it answers (M + diag d) q̈ = τ - C - g.
template <class Model, class Scalar = double>
concept ArticulatedDynamics = ArticulatedModel<Model, Scalar> &&
    requires(const Model& model, typename articulated_traits<Model>::workspace_type& work, const VectorX<Scalar>& v,
             VectorX<Scalar>& out) {
  { articulated_traits<Model>::effort_limits(model) } -> std::convertible_to<VectorX<Scalar>>;
  articulated_traits<Model>::inverse_dynamics(model, v, v, work, out);
  { articulated_traits<Model>::forward_dynamics(model, v, v, v, work, out) } -> std::convertible_to<Index>;
};

}  // namespace clothctl
