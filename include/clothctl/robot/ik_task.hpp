#pragma once

// What inverse kinematics is to reach, as residuals e and their Jacobian J: -Jᵀe is the gradient of ½ |e|², and a step dq
// changes e by -J dq to first order (of a turn: near its end).
//
//   Position      e = target - x                    J = J_v      x a point that is fixed on a frame
//   Orientation   e = log(R_target Rᵀ)              J = J_ω      world axes, the shorter turn
//   Pointing      e = the turn from a to d          J = (1 - a aᵀ) J_ω      a an axis of the frame, d a direction of the world

#include <cmath>
#include <vector>

#include <Eigen/Geometry>

#include "clothctl/concepts/articulated.hpp"

namespace clothctl::robot {

/// What a task asks of a frame.
enum class IkKind {
  /// A point of it is to be at a place.
  Position,
  /// It is to have a rotation.
  Orientation,
  /// An axis of it is to point along a direction.
  Pointing
};

/// One task, of three rows.
template <RealScalar Scalar>
struct IkTask {
  /// What is asked.
  IkKind kind = IkKind::Position;
  /// The frame: a link number of a tree.
  int frame = 0;
  /// Position: the point, in the frame (m). Pointing: the unit axis, in the frame.
  Vector3<Scalar> local = Vector3<Scalar>::Constant(Scalar(0));
  /// Position: where the point is to be (m, world). Pointing: the unit direction (world).
  Vector3<Scalar> target = Vector3<Scalar>::Constant(Scalar(0));
  /// Orientation: the rotation, frame to world.
  Matrix3<Scalar> rotation = Matrix3<Scalar>::Identity();
  /// Weight of the residual; for rotations the length (m) that a radian counts as.
  Scalar weight = Scalar(1);

  /// A point of a frame is to be at `target` (m, world).
  static IkTask position(int frame, const Vector3<Scalar>& point, const Vector3<Scalar>& target) {
    IkTask task;
    task.frame = frame;
    task.local = point;
    task.target = target;
    return task;
  }
  /// A frame is to have a rotation; a radian counts as `length` (m).
  static IkTask orientation(int frame, const Matrix3<Scalar>& rotation, const Scalar& length = Scalar(0.1)) {
    IkTask task;
    task.kind = IkKind::Orientation;
    task.frame = frame;
    task.rotation = rotation;
    task.weight = length;
    return task;
  }
  /// A unit axis of a frame is to point along a unit direction of the world; a radian counts as `length` (m).
  static IkTask pointing(int frame, const Vector3<Scalar>& axis, const Vector3<Scalar>& direction,
                         const Scalar& length = Scalar(0.1)) {
    IkTask task;
    task.kind = IkKind::Pointing;
    task.frame = frame;
    task.local = axis;
    task.target = direction;
    task.weight = length;
    return task;
  }
};

namespace detail {

/// The vector of a rotation's turn, of length at most π. Near π, where the axis is ill defined, it is one of the two.
template <RealScalar Scalar>
Vector3<Scalar> rotation_vector(const Matrix3<Scalar>& R) {
  using std::atan2;
  using std::sqrt;
  const Scalar one(1), half(0.5);
  // The quaternion by its largest entry: (w, x, y, z)² = (1 + trace, 1 + R00 - R11 - R22, …)/4.
  const Scalar squares[4] = {one + R(0, 0) + R(1, 1) + R(2, 2), one + R(0, 0) - R(1, 1) - R(2, 2),
                             one - R(0, 0) + R(1, 1) - R(2, 2), one - R(0, 0) - R(1, 1) + R(2, 2)};
  int k = 0;
  for (int i = 1; i < 4; ++i) {
    if (squares[i] > squares[k]) k = i;
  }
  const Scalar root = sqrt((std::max)(Scalar(0), squares[k])), own = half * root, share = half / root;
  const Vector3<Scalar> odd(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1));
  Scalar w;
  Vector3<Scalar> v;
  if (k == 0) {
    w = own;
    v = share * odd;
  } else {
    const int i = k - 1, j = (i + 1) % 3, l = (i + 2) % 3;
    w = share * odd[i];
    v[i] = own;
    v[j] = share * (R(i, j) + R(j, i));
    v[l] = share * (R(i, l) + R(l, i));
  }
  if (w < Scalar(0)) {
    w = -w;
    v = -v;
  }
  const Scalar sine = sqrt(v.squaredNorm());
  return sine > Scalar(0) ? Vector3<Scalar>((Scalar(2) * atan2(sine, w) / sine) * v) : v;
}

/// The vector of the shorter turn from a unit vector to another. For opposite ones an axis across them is taken.
template <RealScalar Scalar>
Vector3<Scalar> turn_from_to(const Vector3<Scalar>& from, const Vector3<Scalar>& to) {
  using std::abs;
  using std::atan2;
  using std::sqrt;
  Vector3<Scalar> axis = from.cross(to);
  const Scalar sine = sqrt(axis.squaredNorm()), cosine = from.dot(to);
  if (sine > Scalar(8) * scalar_traits<Scalar>::epsilon()) return (atan2(sine, cosine) / sine) * axis;
  if (cosine > Scalar(0)) return axis;
  int least = 0;
  for (int k = 1; k < 3; ++k) {
    if (abs(from[k]) < abs(from[least])) least = k;
  }
  Vector3<Scalar> side = Vector3<Scalar>::Constant(Scalar(0));
  side[least] = Scalar(1);
  axis = from.cross(side);
  return (atan2(Scalar(0), Scalar(-1)) / sqrt(axis.squaredNorm())) * axis;
}

}  // namespace detail

/// Writes the weighted residual of a task, where the workspace stands, to e (3 rows).
template <class Model, RealScalar Scalar>
void task_residual(const Model& model, const typename articulated_traits<Model>::workspace_type& work,
                   const IkTask<Scalar>& task, Eigen::Ref<Vector3<Scalar>> e) {
  Matrix3<Scalar> R;
  Vector3<Scalar> p;
  articulated_traits<Model>::frame_pose(model, work, task.frame, R, p);
  switch (task.kind) {
    case IkKind::Position: e = task.target - (p + R * task.local); break;
    case IkKind::Orientation: e = detail::rotation_vector<Scalar>(task.rotation * R.transpose()); break;
    case IkKind::Pointing: e = detail::turn_from_to<Scalar>(R * task.local, task.target); break;
  }
  e *= task.weight;
}

/// Writes the weighted Jacobian of a task to J (3 × velocities); `twist` (6 × velocities) is memory.
template <class Model, RealScalar Scalar>
void task_jacobian(const Model& model, const typename articulated_traits<Model>::workspace_type& work,
                   const IkTask<Scalar>& task, MatrixX<Scalar>& twist, Eigen::Ref<MatrixX<Scalar>> J) {
  Matrix3<Scalar> R;
  Vector3<Scalar> p;
  articulated_traits<Model>::frame_pose(model, work, task.frame, R, p);
  if (task.kind == IkKind::Position) {
    const Vector3<Scalar> x = p + R * task.local;
    if constexpr (requires { articulated_traits<Model>::position_jacobian(model, work, task.frame, x, task.weight, J); }) {
      articulated_traits<Model>::position_jacobian(model, work, task.frame, x, task.weight, J);
    } else {
      articulated_traits<Model>::point_jacobian(model, work, task.frame, x, twist);
      J = task.weight * twist.template topRows<3>();
    }
    return;
  }
  articulated_traits<Model>::point_jacobian(model, work, task.frame, p, twist);
  J = task.weight * twist.template bottomRows<3>();
  if (task.kind == IkKind::Orientation) return;
  const Vector3<Scalar> axis = R * task.local;
  for (Index k = 0; k < J.cols(); ++k) {
    const Scalar along = axis[0] * J(0, k) + axis[1] * J(1, k) + axis[2] * J(2, k);
    for (Index i = 0; i < 3; ++i) J(i, k) -= along * axis[i];
  }
}

}  // namespace clothctl::robot
