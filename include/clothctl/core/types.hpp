#pragma once

// The few matrix shapes that everything shares. Points are stored as columns, so vertex i is `points.col(i)` and its
// three coordinates are adjacent in memory.

#include <Eigen/Core>

#include "clothctl/core/scalar.hpp"

namespace clothctl {

/// Signed index and size type, Eigen's own.
using Index = Eigen::Index;

/// A point, vector or force in space.
template <class Scalar>
using Vector3 = Eigen::Matrix<Scalar, 3, 1>;

/// A 3×3 block.
template <class Scalar>
using Matrix3 = Eigen::Matrix<Scalar, 3, 3>;

/// A dense column vector.
template <class Scalar>
using VectorX = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;

/// A dense matrix, column major.
template <class Scalar>
using MatrixX = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;

/// n points, velocities or forces as the columns of a 3×n matrix.
template <class Scalar>
using Points = Eigen::Matrix<Scalar, 3, Eigen::Dynamic>;

/// A read-only view of n points (3×n). Takes a matrix, block or map of contiguous columns as it is; anything else (rows apart,
/// an expression, another scalar cast) is evaluated into a copy, which allocates.
template <class Scalar>
using PointsView = Eigen::Ref<const Points<Scalar>>;

/// A block of right-hand sides, one column a degree of freedom and `kLanes` values side by side in it, so that a
/// row operation on all of them is one vector instruction.
template <class Scalar, int kLanes>
using Lanes = Eigen::Matrix<Scalar, kLanes, Eigen::Dynamic>;

/// Tells whether every coefficient is finite. Complexity: O(size). Holds under -ffast-math.
template <class Derived>
bool all_finite(const Eigen::DenseBase<Derived>& matrix) {
  for (Index j = 0; j < matrix.cols(); ++j) {
    for (Index i = 0; i < matrix.rows(); ++i) {
      if (!is_finite(matrix.derived().coeff(i, j))) return false;
    }
  }
  return true;
}

}  // namespace clothctl
