#pragma once

// The motion of a patch of m vertices held by one finger, split into the part that a linear map about the centroid can
// make (paper 000, eq. 3) and the rest. With reference offsets r_j = û_j - c (columns of Rm, 3×m):
//
//   centroid        c = (1/m) Σ x_j
//   best linear map L = (Σ x_j ρ_jᵀ),  ρ_j = (Rm Rmᵀ)⁺ r_j          (least squares; pseudo-inverse: flat patches have rank 2)
//   non-affine part x Nᵀ = 0  <=>  x_j - c = L r_j for some L         N: (m - 1 - rank) × m, orthonormal rows
//
// A flat patch leaves 9 of the 12 affine modes; the rank is found, never assumed.

#include <string>
#include <vector>

#include <Eigen/Eigenvalues>

#include "clothctl/core/types.hpp"

namespace clothctl {

/// The affine split of a patch. Made once with room for m vertices; `update` never allocates.
template <RealScalar Scalar>
class PatchModes {
 public:
  /// Makes room for `count` vertices. Allocates.
  explicit PatchModes(Index count) : offsets_(3, count), map_(3, count), rest_(count, count), trial_(count) {}

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
  /// count as flat. Never allocates.
  void update(const PointsView<Scalar>& reference) {
    using std::sqrt;
    const Index m = count();
    Vector3<Scalar> centre = Vector3<Scalar>::Zero();
    Scalar number = Scalar(0);
    for (Index j = 0; j < m; ++j) {
      centre += reference.col(j);
      number += Scalar(1);
    }
    centre /= number;
    for (Index j = 0; j < m; ++j) offsets_.col(j) = reference.col(j) - centre;
    Matrix3<Scalar> spread = Matrix3<Scalar>::Zero();
    for (Index j = 0; j < m; ++j) spread += offsets_.col(j) * offsets_.col(j).transpose();
    eigen_.compute(spread);
    const Vector3<Scalar> values = eigen_.eigenvalues();  // ascending
    const Matrix3<Scalar> axes = eigen_.eigenvectors();
    map_.setZero();
    rank_ = 0;
    non_affine_ = 0;
    Index rows = 0;
    rest_.row(rows++).setConstant(Scalar(1) / sqrt(number));
    for (int a = 2; a >= 0; --a) {
      if (!(Scalar(1e-6) * values[2] < values[a]) || !(Scalar(0) < values[2])) continue;
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
  Eigen::SelfAdjointEigenSolver<Matrix3<Scalar>> eigen_;
  int rank_ = 0;
  Index non_affine_ = 0;
};

}  // namespace clothctl
