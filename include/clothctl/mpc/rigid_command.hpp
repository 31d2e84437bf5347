#pragma once

// What a hand that holds several vertices is told: it moves them as one rigid body. The planned velocities v_j of its vertices,
// arms r_j = x_j - c from their centroid c, are fitted by
//
//   v = mean v_j,   ω = J⁻¹ Σ r_j × (v_j - v),   J = Σ |r_j|² I - r_j r_jᵀ,      x_j⁺ = c + h v + exp(h [ω]×) r_j
//
// with the exponential by Rodrigues' formula.

#include <cmath>
#include <type_traits>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include "clothctl/core/types.hpp"

namespace clothctl {

/// Moves `points` (3×m, m) rigidly as their `velocities` (3×m, m/s) ask for, for `dt` seconds, and writes where they end.
/// Points on a line do not turn about it. Never allocates.
template <RealScalar Scalar>
void move_rigidly(const PointsView<Scalar>& points, const PointsView<Scalar>& velocities, std::type_identity_t<Scalar> dt,
                  std::type_identity_t<Eigen::Ref<Points<Scalar>>> moved) {
  using std::cos;
  using std::sin;
  using std::sqrt;
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
    inertia.diagonal().array() += Scalar(16) * scalar_traits<Scalar>::epsilon() * size;  // a line does not turn about itself
    const Vector3<Scalar> omega = dt * inertia.ldlt().solve(momentum);
    const Scalar angle = sqrt(omega.squaredNorm());
    if (Scalar(0) < angle) {
      const Vector3<Scalar> axis = omega / angle;
      const Scalar zero = Scalar(0);
      Matrix3<Scalar> cross;
      cross << zero, -axis[2], axis[1], axis[2], zero, -axis[0], -axis[1], axis[0], zero;
      turn += sin(angle) * cross + (Scalar(1) - cos(angle)) * (cross * cross);
    }
  }
  for (Index j = 0; j < points.cols(); ++j) {
    const Vector3<Scalar> arm = points.col(j) - c;
    moved.col(j) = c + dt * v + turn * arm;
  }
}

}  // namespace clothctl
