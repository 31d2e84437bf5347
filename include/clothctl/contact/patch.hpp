#pragma once

// The motion of a patch of m vertices held by one finger, split into the part that a linear map about the centroid can
// make (paper 000, eq. 3) and the rest. With reference offsets r_j = û_j - c (columns of Rm, 3×m):
//
//   centroid        c = (1/m) Σ x_j
//   best linear map L = (Σ x_j ρ_jᵀ),  ρ_j = (Rm Rmᵀ)⁺ r_j          (least squares; pseudo-inverse: flat patches have rank 2)
//   non-affine part x Nᵀ = 0  <=>  x_j - c = L r_j for some L         N: (m - 1 - rank) × m, orthonormal rows
//
// A flat patch leaves 9 of the 12 affine modes; the rank is found, never assumed.

#include <cassert>
#include <cmath>
#include <utility>

#include "clothctl/core/types.hpp"

namespace clothctl {

namespace detail {

/// Makes the symmetric matrix `a` diagonal by Jacobi's rotations (three sweeps or four, each entry to rounding) and leaves the
/// eigenvectors in the columns of `axes`, in the order of the diagonal.
template <RealScalar Scalar>
void diagonalise(Matrix3<Scalar>& a, Matrix3<Scalar>& axes) {
  using std::abs;
  using std::sqrt;
  constexpr int kMaxSweeps = 12;
  axes.setIdentity();
  const Scalar small = scalar_traits<Scalar>::epsilon() * scalar_traits<Scalar>::epsilon() * a.trace();
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    bool done = true;
    for (const auto& [p, q] : {std::pair<Index, Index>(0, 1), std::pair<Index, Index>(0, 2), std::pair<Index, Index>(1, 2)}) {
      if (!(small < abs(a(p, q)))) continue;
      done = false;
      const Scalar half = (a(q, q) - a(p, p)) / (Scalar(2) * a(p, q));
      const Scalar size = abs(half) + sqrt(half * half + Scalar(1));
      const Scalar t = Scalar(1) / (half < Scalar(0) ? -size : size);
      const Scalar c = Scalar(1) / sqrt(t * t + Scalar(1));
      const Scalar s = t * c;
      for (Index i = 0; i < 3; ++i) {  // a = a J, axes = axes J
        const Scalar left = a(i, p), axis = axes(i, p);
        a(i, p) = c * left - s * a(i, q);
        a(i, q) = s * left + c * a(i, q);
        axes(i, p) = c * axis - s * axes(i, q);
        axes(i, q) = s * axis + c * axes(i, q);
      }
      for (Index i = 0; i < 3; ++i) {  // a = Jᵀ a
        const Scalar upper = a(p, i);
        a(p, i) = c * upper - s * a(q, i);
        a(q, i) = s * upper + c * a(q, i);
      }
      a(p, q) = a(q, p) = Scalar(0);
    }
    if (done) break;
  }
}

}  // namespace detail

/// The affine split of a patch. Made once with room for m vertices; `update` never allocates.
template <RealScalar Scalar>
class PatchModes {
 public:
  /// Makes room for `count` vertices, at least 1. Allocates.
  explicit PatchModes(Index count)
      : offsets_(Points<Scalar>::Zero(3, count)),
        map_(Points<Scalar>::Zero(3, count)),
        rest_(MatrixX<Scalar>::Zero(count, count)),
        trial_(VectorX<Scalar>::Zero(count)) {
    assert(count >= 1);
  }

  /// Number of vertices m.
  Index count() const { return offsets_.cols(); }
  /// Rank of the reference shape: 0 a point, 1 a line, 2 a flat patch, 3 a solid one.
  int rank() const { return rank_; }
  /// Number of scalar non-affine modes, m - 1 - rank, at least 0.
  Index non_affine_count() const { return non_affine_; }
  /// Weights ρ of the least-squares linear map: column a of L is Σ_j x_j map(a, j). 3×m.
  const Points<Scalar>& map() const { return map_; }
  /// Row i of N, over the m vertices.
  typename MatrixX<Scalar>::ConstRowXpr non_affine(Index i) const { return rest_.row(i); }

  /// Takes the reference positions (3×m, m), finds rank, map and non-affine modes. Directions thinner than 1e-3 of the widest
  /// (2e-3 in float) count as flat, and a patch that is not finite as a point. Never allocates. Complexity: O(m³).
  void update(const PointsView<Scalar>& reference) {
    using std::sqrt;
    const Index m = count();
    assert(reference.cols() == m);
    Vector3<Scalar> centre = Vector3<Scalar>::Zero();
    const Scalar number = Scalar(static_cast<double>(m));
    for (Index j = 0; j < m; ++j) centre += reference.col(j);
    centre /= number;
    for (Index j = 0; j < m; ++j) offsets_.col(j) = reference.col(j) - centre;
    Matrix3<Scalar> spread = Matrix3<Scalar>::Zero();
    for (Index j = 0; j < m; ++j) spread += offsets_.col(j) * offsets_.col(j).transpose();
    Matrix3<Scalar> axes;
    detail::diagonalise(spread, axes);
    const Vector3<Scalar> values = spread.diagonal();
    const Scalar widest = values.maxCoeff();
    // Points in one place differ by the rounding of their coordinates.
    const Scalar place = Scalar(4) * scalar_traits<Scalar>::epsilon() * reference.cwiseAbs().maxCoeff();
    const bool shaped = all_finite(values) && number * place * place < widest;
    // Squares of relative thickness; the eigenvalues' own rounding must count as flat.
    const Scalar rounding = Scalar(32) * scalar_traits<Scalar>::epsilon();
    const Scalar thinnest = Scalar(1e-6) < rounding ? rounding : Scalar(1e-6);
    map_.setZero();
    rank_ = 0;
    non_affine_ = 0;
    Index rows = 0;
    rest_.row(rows++).setConstant(Scalar(1) / sqrt(number));
    for (Index a = 0; a < 3; ++a) {
      if (!shaped || !(thinnest * widest < values[a])) continue;
      ++rank_;
      const Vector3<Scalar> axis = axes.col(a);
      for (Index j = 0; j < m; ++j) {
        const Scalar along = axis.dot(offsets_.col(j));
        map_.col(j) += axis * (along / values[a]);
        if (rows < m) rest_(rows, j) = along / sqrt(values[a]);
      }
      if (rows < m) ++rows;
    }
    // Complete the orthonormal affine rows to a basis by Gram-Schmidt on unit vectors, twice for orthogonality.
    const Index affine = rows;
    for (Index candidate = 0; candidate < m && rows < m; ++candidate) {
      trial_.setZero();
      trial_[candidate] = Scalar(1);
      for (int pass = 0; pass < 2; ++pass) {
        for (Index i = 0; i < rows; ++i) {
          const Scalar overlap = rest_.row(i).dot(trial_.transpose());
          trial_ -= overlap * rest_.row(i).transpose();
        }
      }
      const Scalar length = sqrt(trial_.squaredNorm());
      if (!(Scalar(0.1) / number < length)) continue;
      rest_.row(rows++) = trial_.transpose() / length;
    }
    non_affine_ = rows - affine;
    for (Index i = 0; i < non_affine_; ++i) rest_.row(i) = rest_.row(affine + i);
  }

 private:
  Points<Scalar> offsets_, map_;
  MatrixX<Scalar> rest_;
  VectorX<Scalar> trial_;
  int rank_ = 0;
  Index non_affine_ = 0;
};

}  // namespace clothctl
