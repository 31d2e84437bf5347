#pragma once

// Eigenvalues and eigenvectors of a symmetric 3×3 matrix by Jacobi's rotations:
//
//   A = V diag(λ) Vᵀ,   Vᵀ V = I
//
// Each rotation J(p, q) makes one pair of entries off the diagonal zero. With c = cos φ, s = sin φ,
//
//   δ = a_qq - a_pp,   t = s/c = sign(δ) 2 a_pq / (|δ| + √(δ² + 4 a_pq²)),   c = 1/√(1 + t²)
//
// where t is the root of smaller modulus, |t| ≤ 1. Sweeps over the three pairs converge
// quadratically: three or four reach rounding. Small eigenvalues keep digits that the roots of the
// characteristic polynomial would lose.
//
// The same rotation makes two columns a, b orthogonal, with a_pp = a·a, a_pq = a·b, a_qq = b·b:
// one-sided Jacobi, which gives the singular values in horn.hpp and in prioritised inverse
// kinematics.
//
// Reference: Golub, Van Loan, Matrix Computations (2013) §8.5; Demmel, Veselić, SIAM J. Matrix
// Anal. Appl. 13 (1992) for the accuracy.

#include <algorithm>
#include <cmath>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A plane rotation by its cosine and sine.
template <RealScalar Scalar>
struct JacobiRotation {
  /// c = cos φ, at least √½.
  Scalar cosine;
  /// s = sin φ.
  Scalar sine;
};

/// Returns the rotation, |φ| ≤ π/4, for which columns c a - s b and s a + c b of [a b] are
/// orthogonal, where `a_pp` = a·a, `a_qq` = b·b and `a_pq` = a·b ≠ 0. If they are the entries of a
/// symmetric matrix, the rotation makes its entry pq zero.
template <RealScalar Scalar>
JacobiRotation<Scalar> jacobi_rotation(const Scalar& a_pp, const Scalar& a_qq, const Scalar& a_pq) {
  using std::abs;
  using std::sqrt;
  Scalar delta = a_qq - a_pp, twice = Scalar(2) * a_pq;
  Scalar square = delta * delta + twice * twice;
  if (!(Scalar(1e-30) < square) || !(square < Scalar(1e30))) {  // near over- or underflow, or NaN
    const Scalar scale = (std::max)(Scalar(abs(delta)), Scalar(abs(twice)));
    delta /= scale;
    twice /= scale;
    square = delta * delta + twice * twice;
  }
  const Scalar size = abs(delta) + sqrt(square);
  const Scalar t = delta < Scalar(0) ? Scalar(-twice / size) : Scalar(twice / size);
  const Scalar cosine = Scalar(1) / sqrt(Scalar(1) + t * t);
  return {cosine, cosine * t};
}

namespace detail {

/// Rotates each pair of rows and columns of the symmetric matrix `a`, and the columns of `vectors`,
/// so that the entry of the pair vanishes; both are n×n, and both triangles of `a` are kept.
/// Entries up to `negligible` stay. Returns true when all are. Never allocates. Complexity: 6 n³.
template <class Matrix>
bool jacobi_sweep(Matrix& a, Matrix& vectors, const typename Matrix::Scalar& negligible) {
  using Scalar = typename Matrix::Scalar;
  using std::abs;
  const Index n = a.rows();
  bool done = true;
  for (Index p = 0; p + 1 < n; ++p) {
    for (Index q = p + 1; q < n; ++q) {
      if (abs(a(p, q)) <= negligible) continue;  // NaN goes on and spreads
      done = false;
      const auto [c, s] = jacobi_rotation<Scalar>(a(p, p), a(q, q), a(p, q));
      for (Index i = 0; i < n; ++i) {  // a = a J, vectors = vectors J
        const Scalar left = a(i, p), axis = vectors(i, p);
        a(i, p) = c * left - s * a(i, q);
        a(i, q) = s * left + c * a(i, q);
        vectors(i, p) = c * axis - s * vectors(i, q);
        vectors(i, q) = s * axis + c * vectors(i, q);
      }
      for (Index i = 0; i < n; ++i) {  // a = Jᵀ a
        const Scalar upper = a(p, i);
        a(p, i) = c * upper - s * a(q, i);
        a(q, i) = s * upper + c * a(q, i);
      }
      a(p, q) = a(q, p) = Scalar(0);
    }
  }
  return done;
}

}  // namespace detail

/// Eigenvalues and eigenvectors of a symmetric 3×3 matrix.
template <RealScalar Scalar>
struct SymmetricEigen {
  /// The eigenvalues, in no particular order.
  Vector3<Scalar> values;
  /// Column k is the unit eigenvector of values[k].
  Matrix3<Scalar> vectors;
};

/// Returns eigenvalues and eigenvectors of the symmetric matrix `A`; both triangles are read. NaN
/// or infinite entries give a result with NaN or infinite entries. Never allocates. Complexity:
/// usually 4 and at most 12 sweeps of three rotations.
template <RealScalar Scalar>
SymmetricEigen<Scalar> symmetric_eigen(const Matrix3<Scalar>& A) {
  using std::abs;
  constexpr int kMaxSweeps = 12;
  Matrix3<Scalar> a = A;
  SymmetricEigen<Scalar> eigen;
  eigen.vectors.setIdentity();
  const Scalar eps = scalar_traits<Scalar>::epsilon();
  const Scalar negligible = eps * eps * (abs(a(0, 0)) + abs(a(1, 1)) + abs(a(2, 2)));
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    if (detail::jacobi_sweep(a, eigen.vectors, negligible)) break;
  }
  eigen.values = Vector3<Scalar>(a(0, 0), a(1, 1), a(2, 2));
  return eigen;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
