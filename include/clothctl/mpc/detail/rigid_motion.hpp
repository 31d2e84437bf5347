#pragma once

// Rigid motion of a grip that holds several vertices. The planned velocities v_j of the vertices,
// with arms r_j = x_j - c from their centroid c, are fitted by a rigid motion:
//
//   v = mean v_j,   ω = J⁻¹ Σ r_j × (v_j - v),   J = Σ |r_j|² I - r_j r_jᵀ
//   x_j⁺ = c + h v + exp(h [ω]) r_j

#include <type_traits>

#include "clothctl/config.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/math/rotation.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The velocities of a rigid body.
template <RealScalar Scalar>
struct RigidVelocity {
  /// c, m.
  Vector3<Scalar> centroid;
  /// v, m/s.
  Vector3<Scalar> linear;
  /// ω, rad/s.
  Vector3<Scalar> angular;

  /// Returns the velocity at the point `p` (m), m/s.
  Vector3<Scalar> at(const Vector3<Scalar>& p) const {
    const Vector3<Scalar> arm = p - centroid;
    return linear + angular.cross(arm);
  }
};

/// Returns the rigid motion that fits the `velocities` (3×m, m/s) of `points` (3×m, m) best. Points
/// on a line do not rotate about it. Never allocates.
template <RealScalar Scalar>
RigidVelocity<Scalar> fit_rigid_velocity(const PointsView<Scalar>& points,
                                         const PointsView<Scalar>& velocities) {
  Vector3<Scalar> c = Vector3<Scalar>::Zero(), v = Vector3<Scalar>::Zero();
  const Scalar number = Scalar(static_cast<double>(points.cols()));
  for (Index j = 0; j < points.cols(); ++j) {
    c += points.col(j);
    v += velocities.col(j);
  }
  c /= number;
  v /= number;
  Matrix3<Scalar> inertia = Matrix3<Scalar>::Zero();
  Vector3<Scalar> momentum = Vector3<Scalar>::Zero();
  for (Index j = 0; j < points.cols(); ++j) {
    const Vector3<Scalar> arm = points.col(j) - c;
    inertia += arm.squaredNorm() * Matrix3<Scalar>::Identity() - arm * arm.transpose();
    momentum += arm.cross(velocities.col(j) - v);
  }
  Vector3<Scalar> omega = Vector3<Scalar>::Zero();
  const Scalar size = inertia.trace();
  if (Scalar(0) < size) {
    inertia.diagonal().array() +=
        Scalar(16) * scalar_traits<Scalar>::epsilon() * size;  // a line does not turn about itself
    omega = inertia.ldlt().solve(momentum);
  }
  return {c, v, omega};
}

/// Moves `points` (3×m, m) for `dt` seconds by a rigid motion about their centroid, and writes the
/// new positions to `moved`. Never allocates.
template <RealScalar Scalar>
void move_rigidly(const PointsView<Scalar>& points, const RigidVelocity<Scalar>& motion,
                  std::type_identity_t<Scalar> dt,
                  std::type_identity_t<Eigen::Ref<Points<Scalar>>> moved) {
  const Vector3<Scalar> angle = dt * motion.angular;
  const Matrix3<Scalar> turn = rotation_exp<Scalar>(angle);
  for (Index j = 0; j < points.cols(); ++j) {
    const Vector3<Scalar> arm = points.col(j) - motion.centroid;
    moved.col(j) = motion.centroid + dt * motion.linear + turn * arm;
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
