#pragma once

// The matrix types of the library. Points are stored as columns, so vertex i is `points.col(i)` and
// its three coordinates are adjacent in memory. All types name their storage order, so that
// EIGEN_DEFAULT_TO_ROW_MAJOR changes nothing here.

#include "clothctl/config.hpp"
#include "clothctl/core/scalar.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Signed index and size type, Eigen's own.
using Index = Eigen::Index;

/// A dense matrix, stored by columns; with one row (and not one column) it is a row vector, which
/// Eigen stores by rows. Use it in place of Eigen::Matrix, whose default order is a macro.
template <class Scalar, int kRows, int kCols>
using DenseMatrix = Eigen::Matrix<Scalar, kRows, kCols,
                                  (kRows == 1 && kCols != 1) ? Eigen::RowMajor : Eigen::ColMajor>;

/// A point, vector or force in space.
template <class Scalar>
using Vector3 = DenseMatrix<Scalar, 3, 1>;

/// A 3×3 block.
template <class Scalar>
using Matrix3 = DenseMatrix<Scalar, 3, 3>;

/// A dense column vector.
template <class Scalar>
using VectorX = DenseMatrix<Scalar, Eigen::Dynamic, 1>;

/// A dense matrix of any size, stored by columns.
template <class Scalar>
using MatrixX = DenseMatrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;

/// n points, velocities or forces as the columns of a 3×n matrix.
template <class Scalar>
using Points = DenseMatrix<Scalar, 3, Eigen::Dynamic>;

/// A read-only view of n points (3×n). It refers to a matrix, block or map whose columns are
/// contiguous. Anything else (an expression, a cast, rows with a stride) is evaluated into a copy,
/// which allocates.
template <class Scalar>
using PointsView = Eigen::Ref<const Points<Scalar>>;

/// A block of `kLanes` right-hand sides. Each column is one degree of freedom and holds its values
/// in all right-hand sides, so that one vector instruction serves all right-hand sides.
template <class Scalar, int kLanes>
using Lanes = DenseMatrix<Scalar, kLanes, Eigen::Dynamic>;

/// Returns true when every coefficient is finite. Complexity: O(size). Works under -ffast-math.
template <class Derived>
bool all_finite(const Eigen::DenseBase<Derived>& matrix) {
  for (Index j = 0; j < matrix.cols(); ++j) {
    for (Index i = 0; i < matrix.rows(); ++i) {
      if (!is_finite(matrix.derived().coeff(i, j))) return false;
    }
  }
  return true;
}

/// Returns true when the length of a direction is 1 to within a hundredth. Works under -ffast-math.
template <class Derived>
bool is_unit(const Eigen::MatrixBase<Derived>& direction) {
  using Scalar = typename Derived::Scalar;
  const Scalar square = direction.squaredNorm();
  return is_finite(square) && Scalar(0.98) < square && square < Scalar(1.02);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
