#pragma once

// The motion of a patch of m vertices x_j that a finger holds, split into an affine part and a
// non-affine part. A finger can make only the affine part: a motion of the centroid c and a linear
// map L about c ([Bai 2016], eq. 3). With the offsets r_j of the vertices of a reference shape from
// its centroid, as columns of a 3×m matrix Rm:
//
//   c = (1/m) Σ x_j
//   L = Σ x_j ρ_jᵀ,   ρ_j = (Rm Rmᵀ)⁺ r_j               best linear map, least squares
//   x Nᵀ = 0   <=>   x_j - c = L r_j for some L         N: m - 1 - rank orthonormal rows
//
// The pseudo-inverse ⁺ is needed because flat patches have rank 2, so that only 9 of the 12 affine
// modes exist. The rank is computed, never assumed.

#include <cassert>
#include <cmath>

#include "clothctl/core/types.hpp"
#include "clothctl/math/symmetric_eigen.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The basis of a patch's affine motion. Made with room for m vertices; `update` never allocates.
template <RealScalar Scalar>
class AffinePatchBasis {
 public:
  /// Makes room for `count` vertices, at least 1. Allocates.
  explicit AffinePatchBasis(Index count)
      : offsets_(Points<Scalar>::Zero(3, count)),
        map_(Points<Scalar>::Zero(3, count)),
        rest_(MatrixX<Scalar>::Zero(count, count)),
        trial_(VectorX<Scalar>::Zero(count)) {
    assert(count >= 1);
  }

  /// Returns the number of vertices m.
  Index count() const { return offsets_.cols(); }
  /// Returns the rank of the reference shape: 0 for a point, 1 a line, 2 a flat patch, 3 a solid
  /// one.
  int rank() const { return rank_; }
  /// Returns the number of scalar non-affine modes: m - 1 - rank, at least 0.
  Index non_affine_count() const { return non_affine_; }
  /// Returns the weights ρ of the best linear map, 3×m: column a of L is Σ_j x_j map(a, j).
  const Points<Scalar>& map() const { return map_; }
  /// Returns row i of N, m.
  typename MatrixX<Scalar>::ConstRowXpr non_affine(Index i) const { return rest_.row(i); }

  /// Computes rank, map and non-affine modes of the reference positions (3×m, m). A direction in
  /// which the patch is thinner than 1e-3 of its widest direction (2e-3 in float) counts as flat.
  /// If a position is not finite, the patch counts as a point. Never allocates. Complexity: O(m³).
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
    const SymmetricEigen<Scalar> eigen = symmetric_eigen<Scalar>(spread);
    const Vector3<Scalar> values = eigen.values;
    const Scalar widest = values.maxCoeff();
    // Rounding of the coordinates moves coincident points apart by about this much.
    const Scalar place =
        Scalar(4) * scalar_traits<Scalar>::epsilon() * reference.cwiseAbs().maxCoeff();
    const bool shaped = all_finite(values) && number * place * place < widest;
    // Largest squared relative thickness that counts as flat. It covers the rounding of
    // eigenvalues.
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
      const Vector3<Scalar> axis = eigen.vectors.col(a);
      for (Index j = 0; j < m; ++j) {
        const Scalar along = axis.dot(offsets_.col(j));
        map_.col(j) += axis * (along / values[a]);
        if (rows < m) rest_(rows, j) = along / sqrt(values[a]);
      }
      if (rows < m) ++rows;
    }
    // Completes the affine rows to an orthonormal basis by Gram-Schmidt on unit vectors. The second
    // pass restores orthogonality.
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

}  // namespace clothctl::inline CLOTHCTL_ABI
