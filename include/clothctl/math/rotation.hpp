#pragma once

// Rotations in space. A rotation is written in one of three ways:
//
//   rotation vector  w = θ a       unit axis a, angle θ (rad)
//   rotation matrix  R             orthonormal, det R = +1
//   quaternion       q = (w, x, y, z), scalar part first; q and -q are the same rotation
//
// and the maps between them are
//
//   [v] u = v × u                                       cross-product matrix
//   exp(w) = (cos θ/2, sinc(θ/2) w/2)                   quaternion, sinc x = sin x / x
//          = I + sin θ [a] + (1 - cos θ) [a]²           matrix (Rodrigues' formula)
//   log(q) = 2 atan2(|v|, q_w) v / |v|                  v = (x, y, z), q_w ≥ 0: the shorter turn
//
// The half angle makes all of them exact to rounding near θ = 0 and near θ = π. Matrix logarithms
// go through the quaternion. Its largest entry is computed first, from the diagonal of R, and the
// other entries are divided by this one, never by a small number.
//
// Reference: Shepperd, J. Guidance and Control 1 (1978) for matrix to quaternion; Solà, Deray,
// Atchuthan, A micro Lie theory for state estimation in robotics (2018) for exp and log.

#include <algorithm>
#include <cmath>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A quaternion as a vector (w, x, y, z), scalar part first.
template <class Scalar>
using QuaternionWxyz = Eigen::Matrix<Scalar, 4, 1>;

/// Returns the matrix [v] of the cross product: [v] u = v × u for every u.
template <RealScalar Scalar>
Matrix3<Scalar> cross_matrix(const Vector3<Scalar>& v) {
  const Scalar zero(0);
  Matrix3<Scalar> M;
  M << zero, -v[2], v[1], v[2], zero, -v[0], -v[1], v[0], zero;
  return M;
}

/// Returns whether R is a rotation: RᵀR is within `tolerance` of the identity (Frobenius norm), and
/// the determinant is positive. False where a number is not finite.
template <RealScalar Scalar>
bool is_rotation(const Matrix3<Scalar>& R, const Scalar& tolerance) {
  const Matrix3<Scalar> off = R.transpose() * R - Matrix3<Scalar>::Identity();
  const Scalar determinant = R(0, 0) * (R(1, 1) * R(2, 2) - R(1, 2) * R(2, 1)) +
                             R(0, 1) * (R(1, 2) * R(2, 0) - R(1, 0) * R(2, 2)) +
                             R(0, 2) * (R(1, 0) * R(2, 1) - R(1, 1) * R(2, 0));
  return off.squaredNorm() < tolerance * tolerance && Scalar(0) < determinant;
}

/// Returns the product a b: as rotations, b first and then a.
template <RealScalar Scalar>
QuaternionWxyz<Scalar> quaternion_product(const QuaternionWxyz<Scalar>& a,
                                          const QuaternionWxyz<Scalar>& b) {
  return {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
          a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
          a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3],
          a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1]};
}

/// Returns the conjugate (w, -x, -y, -z): the inverse rotation of a unit quaternion.
template <RealScalar Scalar>
QuaternionWxyz<Scalar> quaternion_conjugate(const QuaternionWxyz<Scalar>& q) {
  return {q[0], -q[1], -q[2], -q[3]};
}

/// Returns the unit quaternion of the rotation vector `w` (rad).
template <RealScalar Scalar>
QuaternionWxyz<Scalar> quaternion_exp(const Vector3<Scalar>& w) {
  using std::cos;
  using std::sin;
  using std::sqrt;
  const Scalar half = Scalar(0.5) * sqrt(w.squaredNorm());
  // Below this angle the next term of the series, half⁴/120, is lost in rounding.
  const Scalar series_limit = sqrt(sqrt(scalar_traits<Scalar>::epsilon()));
  const Scalar sinc =
      half < series_limit ? Scalar(Scalar(1) - half * half / Scalar(6)) : Scalar(sin(half) / half);
  const Scalar share = Scalar(0.5) * sinc;
  return {cos(half), share * w[0], share * w[1], share * w[2]};
}

/// Returns the rotation vector (rad, length at most π) of a quaternion of any length. At exactly π
/// both axes ±a are right and one of them is returned. A zero quaternion gives zero.
template <RealScalar Scalar>
Vector3<Scalar> quaternion_log(const QuaternionWxyz<Scalar>& q) {
  using std::atan2;
  using std::sqrt;
  Scalar w = q[0];
  Vector3<Scalar> v(q[1], q[2], q[3]);
  if (w < Scalar(0)) {
    w = -w;
    v = -v;
  }
  const Scalar sine = sqrt(v.squaredNorm());
  const Scalar share = sine > Scalar(0) ? Scalar(Scalar(2) * atan2(sine, w) / sine) : Scalar(0);
  return share * v;
}

/// Returns the rotation matrix of the quaternion (w, x, y, z) of any length but zero.
template <RealScalar Scalar>
Matrix3<Scalar> rotation_from_quaternion(const Scalar& w, const Scalar& x, const Scalar& y,
                                         const Scalar& z) {
  const Scalar one(1), two = Scalar(2) / (w * w + x * x + y * y + z * z);
  Matrix3<Scalar> R;
  R << one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y),  //
      two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x),   //
      two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y);
  return R;
}
/// Returns the rotation matrix of a quaternion of any length but zero.
template <RealScalar Scalar>
Matrix3<Scalar> rotation_from_quaternion(const QuaternionWxyz<Scalar>& q) {
  return rotation_from_quaternion<Scalar>(q[0], q[1], q[2], q[3]);
}

/// Returns the unit quaternion, with w ≥ 0, of a rotation matrix.
template <RealScalar Scalar>
QuaternionWxyz<Scalar> quaternion_from_rotation(const Matrix3<Scalar>& R) {
  using std::sqrt;
  const Scalar one(1), half(0.5);
  // 4 (w², x², y², z²) = (1 + trace, 1 + R00 - R11 - R22, …); the largest is at least 1.
  const Scalar squares[4] = {one + R(0, 0) + R(1, 1) + R(2, 2), one + R(0, 0) - R(1, 1) - R(2, 2),
                             one - R(0, 0) + R(1, 1) - R(2, 2), one - R(0, 0) - R(1, 1) + R(2, 2)};
  int k = 0;
  for (int i = 1; i < 4; ++i) {
    if (squares[i] > squares[k]) k = i;
  }
  const Scalar root = sqrt((std::max)(Scalar(0), squares[k])), largest = half * root,
               share = half / root;
  const Vector3<Scalar> odd(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1));
  QuaternionWxyz<Scalar> q;
  if (k == 0) {
    q = {largest, share * odd[0], share * odd[1], share * odd[2]};
  } else {
    const int i = k - 1, j = (i + 1) % 3, l = (i + 2) % 3;
    q[0] = share * odd[i];
    q[i + 1] = largest;
    q[j + 1] = share * (R(i, j) + R(j, i));
    q[l + 1] = share * (R(i, l) + R(l, i));
  }
  if (q[0] < Scalar(0)) q = -q;
  return q;
}

/// Returns the rotation matrix exp([w]) of the rotation vector `w` (rad).
template <RealScalar Scalar>
Matrix3<Scalar> rotation_exp(const Vector3<Scalar>& w) {
  return rotation_from_quaternion<Scalar>(quaternion_exp<Scalar>(w));
}

/// Returns the rotation vector (rad, length at most π) of a rotation matrix: rotation_exp of it is
/// R. At exactly π both axes are right and one of them is returned.
template <RealScalar Scalar>
Vector3<Scalar> rotation_log(const Matrix3<Scalar>& R) {
  return quaternion_log<Scalar>(quaternion_from_rotation<Scalar>(R));
}

/// Returns the rotation vector (rad) of the shortest rotation that takes the unit vector `from` to
/// the unit vector `to`. For opposite vectors the axis is not unique; one that is perpendicular to
/// them is returned.
template <RealScalar Scalar>
Vector3<Scalar> shortest_rotation(const Vector3<Scalar>& from, const Vector3<Scalar>& to) {
  using std::abs;
  using std::atan2;
  using std::sqrt;
  const auto cross = [](const Vector3<Scalar>& a, const Vector3<Scalar>& b) {
    return Vector3<Scalar>(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                           a[0] * b[1] - a[1] * b[0]);
  };
  Vector3<Scalar> axis = cross(from, to);
  const Scalar sine = sqrt(axis.squaredNorm()), cosine = from.dot(to);
  if (sine > Scalar(8) * scalar_traits<Scalar>::epsilon())
    return (atan2(sine, cosine) / sine) * axis;
  if (cosine > Scalar(0)) return axis;
  int least = 0;
  for (int k = 1; k < 3; ++k) {
    if (abs(from[k]) < abs(from[least])) least = k;
  }
  Vector3<Scalar> side = Vector3<Scalar>::Constant(Scalar(0));
  side[least] = Scalar(1);
  axis = cross(from, side);
  return (atan2(Scalar(0), Scalar(-1)) / sqrt(axis.squaredNorm())) * axis;
}

/// Returns Rz(yaw) Ry(pitch) Rx(roll) (rad): roll about x first, then pitch about y, then yaw about
/// z, all about fixed axes, as in URDF.
template <RealScalar Scalar>
Matrix3<Scalar> rotation_from_roll_pitch_yaw(const Scalar& roll, const Scalar& pitch,
                                             const Scalar& yaw) {
  using std::cos;
  using std::sin;
  const Scalar cz = cos(yaw), sz = sin(yaw), cy = cos(pitch), sy = sin(pitch), cx = cos(roll),
               sx = sin(roll);
  Matrix3<Scalar> R;
  R << cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx,  //
      sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx,   //
      -sy, cy * sx, cy * cx;
  return R;
}

/// Returns roll, pitch and yaw (rad) of a rotation matrix, the pitch from -π/2 to π/2. Where it is
/// a quarter turn, roll and yaw turn about the same axis: yaw is 0 then.
template <RealScalar Scalar>
Vector3<Scalar> roll_pitch_yaw_from_rotation(const Matrix3<Scalar>& R) {
  using std::asin;
  using std::atan2;
  Scalar sine = -R(2, 0);
  if (Scalar(1) < sine) sine = Scalar(1);
  if (sine < Scalar(-1)) sine = Scalar(-1);
  const Scalar level = R(0, 0) * R(0, 0) + R(1, 0) * R(1, 0);
  if (level < Scalar(16) * scalar_traits<Scalar>::epsilon())
    return {atan2(Scalar(-R(1, 2)), R(1, 1)), asin(sine), Scalar(0)};
  return {atan2(R(2, 1), R(2, 2)), asin(sine), atan2(R(1, 0), R(0, 0))};
}

}  // namespace clothctl::inline CLOTHCTL_ABI
