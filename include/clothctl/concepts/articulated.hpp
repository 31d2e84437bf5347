#pragma once

// ArticulatedModel and ArticulatedDynamics: what inverse kinematics and hand control need of a
// robot. Both are checked through articulated_traits, so that a robot class of another library
// needs no change: its user specialises the trait (example: `concepts/articulated.cpp` in the
// tests).
//
// The model is const. Everything that depends on the positions of the robot is in a workspace,
// which is made once. Positions q (nq) may have more entries than velocities (nv), for instance
// where they hold quaternions; `advance` and `difference` connect the two. A twist has its linear
// part first, in world axes. Units: m, rad, s, kg, N, N m.
//
// A trait may offer three optional hooks. Code works without them:
//
//   frames(model) -> integer
//       Number of frames. With it, a frame index beyond the last one is refused by a status.
//       Without it, only negative indices are refused, and frame_pose must write values that are
//       not finite for a frame that does not exist.
//   position_jacobian(model, work, frame, x, factor, J)
//       Writes the linear rows of point_jacobian times `factor` to J (3 × nv). It saves inverse
//       kinematics the angular rows. Without it, point_jacobian is called and its upper half taken.
//   workspace_fits(model, work) -> bool
//       False when the workspace was made for another robot; it is then refused by a status.
//       Without it, every workspace is accepted.

#include <concepts>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// The scalar and workspace types of a model that names them; empty for every other type.
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

/// How a type acts as a robot. The primary template forwards to members of the same names. The
/// optional hooks at the top of this file have no forwarders: a specialisation offers them.
template <class Model>
struct articulated_traits : detail::articulated_types_of<Model> {
  /// Returns a new workspace. Allocates.
  static auto make_workspace(const Model& model) requires requires { model.make_workspace(); }
  { return model.make_workspace(); }
  /// Returns the length of positions.
  static Index nq(const Model& model) requires requires { model.nq(); }
  { return model.nq(); }
  /// Returns the length of velocities, accelerations and torques.
  static Index nv(const Model& model) requires requires { model.nv(); }
  { return model.nv(); }
  /// Returns the lowest positions (nq), infinite where there is no limit.
  static decltype(auto) lower(const Model& model) requires requires { model.lower(); }
  { return model.lower(); }
  /// Returns the highest positions (nq).
  static decltype(auto) upper(const Model& model) requires requires { model.upper(); }
  { return model.upper(); }
  /// Returns the largest torques (nv).
  static decltype(auto) effort_limits(const Model& model) requires requires {
    model.effort_limits();
  }
  { return model.effort_limits(); }
  /// Writes to `out` (nq) the positions that `step` (nv, velocity times time) leads to from q.
  template <class Q, class Step, class Out>
  requires requires(const Model& m, const Q& q, const Step& step, Out& out) {
    m.advance(q, step, out);
  }
  static void advance(const Model& model, const Q& q, const Step& step, Out&& out) {
    model.advance(q, step, out);
  }
  /// Writes the step (nv) that leads from positions `from` to positions `to`.
  template <class From, class To, class Out>
  requires requires(const Model& m, const From& from, const To& to, Out& out) {
    m.difference(from, to, out);
  }
  static void difference(const Model& model, const From& from, const To& to, Out&& out) {
    model.difference(from, to, out);
  }
  /// Computes the poses of all frames at positions q and keeps them in the workspace.
  template <class Vector, class Workspace>
  requires requires(const Model& m, const Vector& v, Workspace& w) { m.forward_kinematics(v, w); }
  static void forward_kinematics(const Model& model, const Vector& q, Workspace& work) {
    model.forward_kinematics(q, work);
  }
  /// Writes the rotation R from a frame to the world, and the origin p of the frame (m, world).
  template <class Scalar, class Workspace>
  requires requires(const Model& m, const Workspace& w, Matrix3<Scalar>& R, Vector3<Scalar>& p) {
    m.frame_pose(w, 0, R, p);
  }
  static void frame_pose(const Model& model, const Workspace& work, int frame, Matrix3<Scalar>& R,
                         Vector3<Scalar>& p) {
    model.frame_pose(work, frame, R, p);
  }
  /// Writes the Jacobian J (6 × nv) of the point x (m, world) that is fixed on a frame.
  template <class Scalar, class Workspace, class Out>
  requires requires(const Model& m, const Workspace& w, const Vector3<Scalar>& x, Out& J) {
    m.point_jacobian(w, 0, x, J);
  }
  static void point_jacobian(const Model& model, const Workspace& work, int frame,
                             const Vector3<Scalar>& x, Out&& J) {
    model.point_jacobian(work, frame, x, J);
  }
  /// Writes the torques that velocities qd and accelerations qdd need, gravity included.
  template <class Qd, class Qdd, class Workspace, class Out>
  requires requires(const Model& m, const Qd& qd, const Qdd& qdd, Workspace& w, Out& out) {
    m.inverse_dynamics(qd, qdd, w, out);
  }
  static void inverse_dynamics(const Model& model, const Qd& qd, const Qdd& qdd, Workspace& work,
                               Out&& torques) {
    model.inverse_dynamics(qd, qdd, work, torques);
  }
  /// Writes the accelerations that torques cause at velocities qd, with `diagonal` (nv) added to
  /// the diagonal of the mass matrix. Returns -1 on success, else the index of a velocity
  /// coordinate that has no finite acceleration (any index when the input is not finite).
  template <class Qd, class Torques, class Diagonal, class Workspace, class Out>
  requires requires(const Model& m, const Qd& qd, const Torques& t, const Diagonal& d, Workspace& w,
                    Out& out) {
    m.forward_dynamics(qd, t, d, w, out);
  }
  [[nodiscard]] static auto forward_dynamics(const Model& model, const Qd& qd,
                                             const Torques& torques, const Diagonal& diagonal,
                                             Workspace& work, Out&& qdd) {
    return model.forward_dynamics(qd, torques, diagonal, work, qdd);
  }
};

/// A robot with kinematics. InverseKinematics, PrioritisedIk and ConstrainedIk take it.
///
/// Axioms: J q̇ is the derivative of the frame's motion along `advance`. `advance` by
/// `difference(from, to)` leads from `from` to `to`. Threads may share a model when each has its
/// own workspace. Nothing but make_workspace allocates.
///
/// Optional hooks: `frames`, `position_jacobian` and `workspace_fits`, described at the top of this
/// file.
template <class Model, class Scalar = double>
concept ArticulatedModel = RealScalar<Scalar> && requires {
  typename articulated_traits<Model>::workspace_type;
} && requires(const Model& model, typename articulated_traits<Model>::workspace_type& work,
              const VectorX<Scalar>& v, VectorX<Scalar>& out, MatrixX<Scalar>& J,
              Matrix3<Scalar>& R, Vector3<Scalar>& p, int frame) {
  {
    articulated_traits<Model>::make_workspace(model)
    } -> std::same_as<typename articulated_traits<Model>::workspace_type>;
  { articulated_traits<Model>::nq(model) } -> std::convertible_to<Index>;
  { articulated_traits<Model>::nv(model) } -> std::convertible_to<Index>;
  { articulated_traits<Model>::lower(model) } -> std::convertible_to<VectorX<Scalar>>;
  { articulated_traits<Model>::upper(model) } -> std::convertible_to<VectorX<Scalar>>;
  articulated_traits<Model>::advance(model, v, v, out);
  articulated_traits<Model>::difference(model, v, v, out);
  articulated_traits<Model>::forward_kinematics(model, v, work);
  articulated_traits<Model>::frame_pose(model, work, frame, R, p);
  articulated_traits<Model>::point_jacobian(model, work, frame, p, J);
};

/// A robot with kinematics and dynamics, τ = M(q) q̈ + C(q, q̇) + g(q). StablePd takes it.
///
/// Axioms: forward dynamics inverts inverse dynamics. With a diagonal d it solves (M + diag d) q̈ =
/// τ - C - g.
///
/// Optional hooks: none.
template <class Model, class Scalar = double>
concept ArticulatedDynamics = ArticulatedModel<Model, Scalar> &&
    requires(const Model& model, typename articulated_traits<Model>::workspace_type& work,
             const VectorX<Scalar>& v, VectorX<Scalar>& out) {
  { articulated_traits<Model>::effort_limits(model) } -> std::convertible_to<VectorX<Scalar>>;
  articulated_traits<Model>::inverse_dynamics(model, v, v, work, out);
  {
    articulated_traits<Model>::forward_dynamics(model, v, v, v, work, out)
    } -> std::convertible_to<Index>;
};

namespace detail {

/// Returns true when the frame exists, as far as the trait can tell (optional hook `frames`).
template <class Model>
bool has_frame(const Model& model, int frame) {
  if constexpr (requires { articulated_traits<Model>::frames(model); }) {
    return frame >= 0 &&
           static_cast<Index>(frame) < Index(articulated_traits<Model>::frames(model));
  } else {
    return frame >= 0;
  }
}

/// Writes the way (nv) of each velocity coordinate from positions q to `limit` (nq each), downwards
/// (sign -1) or upwards (1): the difference from q to points one unit beyond the limits, so that it
/// works for any relation of positions to velocities. For coordinates without a limit this
/// difference is zero, and the way becomes ±1e30. `beyond` (nq): scratch. Never allocates.
template <class Model, RealScalar Scalar>
void way_to_limits(const Model& model, const Eigen::Ref<const VectorX<Scalar>>& q,
                   const Eigen::Ref<const VectorX<Scalar>>& limit, const Scalar& sign,
                   VectorX<Scalar>& beyond, VectorX<Scalar>& way) {
  for (Index i = 0; i < limit.size(); ++i)
    beyond[i] = is_unbounded(limit[i]) ? q[i] : Scalar(limit[i] + sign);
  articulated_traits<Model>::difference(model, q, beyond, way);
  for (Index i = 0; i < way.size(); ++i)
    way[i] = sign * way[i] > Scalar(0.5) ? Scalar(way[i] - sign) : Scalar(sign * Scalar(1e30f));
}

/// Returns true when the workspace belongs to the model, as far as the trait can tell (optional
/// hook `workspace_fits`).
template <class Model, class Workspace>
bool workspace_fits(const Model& model, const Workspace& work) {
  if constexpr (requires { articulated_traits<Model>::workspace_fits(model, work); }) {
    return articulated_traits<Model>::workspace_fits(model, work);
  } else {
    return true;
  }
}

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
