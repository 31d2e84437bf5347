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

/// Moves `points` (3×m, m) for `dt` seconds by the rigid motion that fits their `velocities` (3×m,
/// m/s) best, and writes the new positions to `moved`. Points on a line do not rotate about it.
/// Never allocates.
template <RealScalar Scalar>
void move_rigidly(const PointsView<Scalar>& points, const PointsView<Scalar>& velocities,
                  std::type_identity_t<Scalar> dt,
                  std::type_identity_t<Eigen::Ref<Points<Scalar>>> moved) {
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
  Matrix3<Scalar> turn = Matrix3<Scalar>::Identity();
  const Scalar size = inertia.trace();
  if (Scalar(0) < size) {
    inertia.diagonal().array() +=
        Scalar(16) * scalar_traits<Scalar>::epsilon() * size;  // a line does not turn about itself
    const Vector3<Scalar> omega = dt * inertia.ldlt().solve(momentum);
    turn = rotation_exp<Scalar>(omega);
  }
  for (Index j = 0; j < points.cols(); ++j) {
    const Vector3<Scalar> arm = points.col(j) - c;
    moved.col(j) = c + dt * v + turn * arm;
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
