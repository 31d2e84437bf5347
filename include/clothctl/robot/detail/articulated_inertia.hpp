#pragma once

// The articulated inertia of a body, with 3×3 blocks A, B, C: how the body accelerates (α: angular;
// A in (α, A): of its origin) under the wrench at its joint when everything below it moves freely,
// (N, F) = [A B; Bᵀ C] (α, A) + p. The joint with direction S, torque τ and added diagonal d is
// eliminated from it; the result is shifted to the parent's origin by r and added there:
//
//   U = [A B; Bᵀ C] S,   D = Sᵀ U + d,   u = τ - Sᵀ p
//   [A B; Bᵀ C] -= U D⁻¹ Uᵀ,   p += U D⁻¹ u
//   B' = B + [r] C,   A' = A - B' [r] + [r] Bᵀ,   N' = N + r × F
//
// Both B and its transpose G are stored, so that every operation works on whole columns, each
// padded to a register of four numbers.
//
// Reference: Featherstone, Rigid Body Dynamics Algorithms (2008) §7.3.

#include <cmath>

#include "clothctl/robot/detail/motion.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Three numbers and a zero. Four numbers fill a vector register.
template <RealScalar Scalar>
using Padded3 = Eigen::Matrix<Scalar, 4, 1>;

/// Returns the unit vector of axis k.
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE Padded3<Scalar> unit_padded(int k) {
  return {Scalar(k == 0 ? 1 : 0), Scalar(k == 1 ? 1 : 0), Scalar(k == 2 ? 1 : 0), Scalar(0)};
}

/// A 3×3 matrix by its padded columns. Sums are written term by term: compilers keep those in
/// registers.
template <RealScalar Scalar>
struct PaddedMatrix3 {
  Padded3<Scalar> x, y, z;

  PaddedMatrix3() = default;

  /// Sets all entries to zero.
  void clear() { x = y = z = Padded3<Scalar>::Constant(Scalar(0)); }

  /// sum += M v.
  template <class Vector>
  EIGEN_ALWAYS_INLINE void add_product(const Vector& v, Padded3<Scalar>& sum) const {
    sum += v[0] * x;
    sum += v[1] * y;
    sum += v[2] * z;
  }
  /// Returns M v.
  template <class Vector>
  EIGEN_ALWAYS_INLINE Padded3<Scalar> operator*(const Vector& v) const {
    Padded3<Scalar> product = v[0] * x;
    product += v[1] * y;
    product += v[2] * z;
    return product;
  }
  /// this += B.
  EIGEN_ALWAYS_INLINE PaddedMatrix3& operator+=(const PaddedMatrix3& B) {
    x += B.x;
    y += B.y;
    z += B.z;
    return *this;
  }
  /// this += v uᵀ.
  template <class Vector>
  EIGEN_ALWAYS_INLINE void add_outer(const Padded3<Scalar>& v, const Vector& u) {
    x += u[0] * v;
    y += u[1] * v;
    z += u[2] * v;
  }
  /// this += [r] B, where `cross` is [r].
  EIGEN_ALWAYS_INLINE void add_products(const PaddedMatrix3& cross, const PaddedMatrix3& B) {
    cross.add_product(B.x, x);
    cross.add_product(B.y, y);
    cross.add_product(B.z, z);
  }
  /// this -= B [r].
  EIGEN_ALWAYS_INLINE void subtract_cross(const PaddedMatrix3& B, const Vector3<Scalar>& r) {
    x += r[1] * B.z;
    x -= r[2] * B.y;
    y += r[2] * B.x;
    y -= r[0] * B.z;
    z += r[0] * B.y;
    z -= r[1] * B.x;
  }
  /// this += [v].
  EIGEN_ALWAYS_INLINE void add_cross(const Vector3<Scalar>& v) {
    x += v[2] * unit_padded<Scalar>(1);
    x -= v[1] * unit_padded<Scalar>(2);
    y += v[0] * unit_padded<Scalar>(2);
    y -= v[2] * unit_padded<Scalar>(0);
    z += v[1] * unit_padded<Scalar>(0);
    z -= v[0] * unit_padded<Scalar>(1);
  }
  Matrix3<Scalar> matrix3() const {
    Matrix3<Scalar> M;
    M << x.template head<3>(), y.template head<3>(), z.template head<3>();
    return M;
  }
  void subtract(const Matrix3<Scalar>& M) {
    x.template head<3>() -= M.col(0);
    y.template head<3>() -= M.col(1);
    z.template head<3>() -= M.col(2);
  }
};

/// sum += v. It multiplies by unit vectors, since storing single numbers would delay the next load
/// of all four.
template <RealScalar Scalar, class Vector>
EIGEN_ALWAYS_INLINE void add_padded(const Vector& v, Padded3<Scalar>& sum) {
  sum += v[0] * unit_padded<Scalar>(0);
  sum += v[1] * unit_padded<Scalar>(1);
  sum += v[2] * unit_padded<Scalar>(2);
}

/// Returns the dot product of the first three entries.
template <RealScalar Scalar, class Vector>
EIGEN_ALWAYS_INLINE Scalar dot(const Vector& v, const Padded3<Scalar>& x) {
  return v[0] * x[0] + v[1] * x[1] + v[2] * x[2];
}

/// Articulated inertia of a body; G = Bᵀ.
template <RealScalar Scalar>
struct ArticulatedInertia {
  PaddedMatrix3<Scalar> A, B, G, C;
  Padded3<Scalar> N, F;  // p: the wrench at zero acceleration

  void clear() {
    A.clear();
    B.clear();
    G.clear();
    C.clear();
    N = F = Padded3<Scalar>::Constant(Scalar(0));
  }

  /// Adds the inertia and forces of the body itself.
  EIGEN_ALWAYS_INLINE void add(const BodyMotion<Scalar>& own) {
    const BodyInertia<Scalar>& inertia = own.inertia;
    add_padded<Scalar>(inertia.moments.col(0), A.x);
    add_padded<Scalar>(inertia.moments.col(1), A.y);
    add_padded<Scalar>(inertia.moments.col(2), A.z);
    B.add_cross(inertia.h);
    G.add_cross(-inertia.h);
    C.x += inertia.mass * unit_padded<Scalar>(0);
    C.y += inertia.mass * unit_padded<Scalar>(1);
    C.z += inertia.mass * unit_padded<Scalar>(2);
    add_padded<Scalar>(own.N, N);
    add_padded<Scalar>(own.F, F);
  }
};

/// A joint after the second pass, and the acceleration of its body in the third.
template <RealScalar Scalar>
struct EliminatedJoint {
  Padded3<Scalar> U_N, U_F;  // U of a joint with one coordinate
  Padded3<Scalar> alpha, a;  // what q̈ adds to the accelerations at q̈ = 0
  Scalar inverse, u;         // 1/D, and u
  int depth;                 // number of bodies between the body and the world
};

/// Solves D X' = X for symmetric positive definite D (6×6, overwritten) and writes X' to X. Returns
/// false when D is not positive definite.
template <RealScalar Scalar>
bool cholesky_solve_six(Eigen::Matrix<Scalar, 6, 6>& D, Eigen::Matrix<Scalar, 6, 7>& X) {
  using std::sqrt;
  for (int j = 0; j < 6; ++j) {
    Scalar pivot = D(j, j);
    for (int k = 0; k < j; ++k) pivot -= D(j, k) * D(j, k);
    if (!(pivot > Scalar(0))) return false;
    D(j, j) = sqrt(pivot);
    for (int i = j + 1; i < 6; ++i) {
      Scalar value = D(i, j);
      for (int k = 0; k < j; ++k) value -= D(i, k) * D(j, k);
      D(i, j) = value / D(j, j);
    }
  }
  for (int c = 0; c < 7; ++c) {
    for (int i = 0; i < 6; ++i) {
      for (int k = 0; k < i; ++k) X(i, c) -= D(i, k) * X(k, c);
      X(i, c) /= D(i, i);
    }
    for (int i = 5; i >= 0; --i) {
      for (int k = i + 1; k < 6; ++k) X(i, c) -= D(k, i) * X(k, c);
      X(i, c) /= D(i, i);
    }
  }
  return true;
}

/// Eliminates a joint with one coordinate from its body's articulated inertia. Returns false when
/// the joint has neither inertia nor diagonal.
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE bool eliminate_joint(bool turns, const Vector3<Scalar>& axis,
                                         const Scalar& torque, const Scalar& diagonal,
                                         ArticulatedInertia<Scalar>& a,
                                         EliminatedJoint<Scalar>& joint) {
  const Padded3<Scalar> U_N = turns ? a.A * axis : a.B * axis,
                        U_F = turns ? a.G * axis : a.C * axis;
  joint.U_N = U_N;
  joint.U_F = U_F;
  // Joints below the body may leave no inertia about the axis but rounding.
  const PaddedMatrix3<Scalar>& own = turns ? a.A : a.C;
  const Scalar D = dot<Scalar>(axis, turns ? joint.U_N : joint.U_F) + diagonal;
  if (!(D > Scalar(64) * scalar_traits<Scalar>::epsilon() * (own.x[0] + own.y[1] + own.z[2])))
    return false;
  joint.inverse = Scalar(1) / D;
  joint.u = torque - dot<Scalar>(axis, turns ? a.N : a.F);
  const Padded3<Scalar> share_N = -joint.inverse * U_N, share_F = -joint.inverse * U_F;
  a.A.add_outer(share_N, joint.U_N);
  a.B.add_outer(share_N, joint.U_F);
  a.G.add_outer(share_F, joint.U_N);
  a.C.add_outer(share_F, joint.U_F);
  a.N -= joint.u * share_N;
  a.F -= joint.u * share_F;
  return true;
}

/// The same for a free joint, which has six coordinates.
template <RealScalar Scalar>
bool eliminate_free_joint(const Matrix3<Scalar>& axes,
                          const Eigen::Ref<const VectorX<Scalar>>& torques,
                          const Eigen::Ref<const VectorX<Scalar>>& diagonal, Index at,
                          Eigen::Matrix<Scalar, 6, 6>& U, Eigen::Matrix<Scalar, 6, 7>& solved,
                          ArticulatedInertia<Scalar>& a) {
  U.template block<3, 3>(0, 0).noalias() = a.B.matrix3() * axes;  // rows: moment, force
  U.template block<3, 3>(3, 0).noalias() = a.C.matrix3() * axes;
  U.template block<3, 3>(0, 3).noalias() = a.A.matrix3() * axes;
  U.template block<3, 3>(3, 3).noalias() = a.G.matrix3() * axes;
  Eigen::Matrix<Scalar, 6, 6> D;
  D.template topRows<3>().noalias() = axes.transpose() * U.template bottomRows<3>();
  D.template bottomRows<3>().noalias() = axes.transpose() * U.template topRows<3>();
  for (int k = 0; k < 6 && diagonal.size() > 0; ++k) D(k, k) += diagonal[at + k];
  solved.template leftCols<6>() = U.transpose();
  solved.template block<3, 1>(0, 6) =
      torques.template segment<3>(at) - axes.transpose() * a.F.template head<3>();
  solved.template block<3, 1>(3, 6) =
      torques.template segment<3>(at + 3) - axes.transpose() * a.N.template head<3>();
  if (!cholesky_solve_six(D, solved)) return false;
  const Eigen::Matrix<Scalar, 6, 6> taken = U * solved.template leftCols<6>();
  const Eigen::Matrix<Scalar, 6, 1> push = U * solved.col(6);
  a.A.subtract(taken.template topLeftCorner<3, 3>());
  a.B.subtract(taken.template topRightCorner<3, 3>());
  a.G.subtract(taken.template bottomLeftCorner<3, 3>());
  a.C.subtract(taken.template bottomRightCorner<3, 3>());
  a.N.template head<3>() += push.template head<3>();
  a.F.template head<3>() += push.template tail<3>();
  return true;
}

/// Adds a body's articulated inertia to its parent's. `r` leads from the parent's origin to the
/// body's.
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE void add_to_parent(const Vector3<Scalar>& r,
                                       const ArticulatedInertia<Scalar>& a,
                                       ArticulatedInertia<Scalar>& parent) {
  PaddedMatrix3<Scalar> X, B = a.B, G = a.G, A = a.A;
  X.clear();
  X.add_cross(r);
  B.add_products(X, a.C);
  G.subtract_cross(a.C, r);
  A.add_products(X, a.G);
  A.subtract_cross(B, r);
  parent.A += A;
  parent.B += B;
  parent.G += G;
  parent.C += a.C;
  parent.F += a.F;
  Padded3<Scalar> N = a.N;
  X.add_product(a.F, N);
  parent.N += N;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
