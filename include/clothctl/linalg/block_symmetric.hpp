#pragma once

// A symmetric sparse matrix of 3×3 blocks, with one block row for each vertex. The pattern is fixed
// at construction; values change in place. The matrix stores the diagonal blocks and, for each pair
// i > j, the block (i, j). Block (j, i) is its transpose.

#include <algorithm>
#include <array>
#include <cassert>
#include <utility>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Symmetric n×n matrix of 3×3 blocks with a fixed pattern.
template <RealScalar Scalar>
class BlockSymmetric {
 public:
  /// A matrix without rows.
  BlockSymmetric() = default;

  /// Fixes the pattern: `pairs` lists the coupled vertices in any order; repeated pairs are
  /// allowed. Allocates. Complexity: O(p log p). Fails when: `rows` is negative or an index is
  /// outside [0, rows) (assert).
  BlockSymmetric(Index rows, std::vector<std::pair<int, int>> pairs) {
    assert(rows >= 0);
    for (auto& [i, j] : pairs) {
      assert(i >= 0 && i < rows && j >= 0 && j < rows);
      if (i < j) std::swap(i, j);
    }
    pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                               [](const auto& p) { return p.first == p.second; }),
                pairs.end());
    std::sort(pairs.begin(), pairs.end());
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
    row_begin_.assign(static_cast<std::size_t>(rows) + 1, 0);
    column_.reserve(pairs.size());
    for (const auto& [i, j] : pairs) {
      ++row_begin_[static_cast<std::size_t>(i) + 1];
      column_.push_back(j);
    }
    for (std::size_t i = 1; i < row_begin_.size(); ++i) row_begin_[i] += row_begin_[i - 1];
    diagonal_.assign(static_cast<std::size_t>(rows), Matrix3<Scalar>::Zero().eval());
    lower_.assign(column_.size(), Matrix3<Scalar>::Zero().eval());
  }

  /// Number of block rows.
  Index rows() const { return static_cast<Index>(diagonal_.size()); }
  /// Number of stored off-diagonal blocks.
  Index lower_count() const { return static_cast<Index>(lower_.size()); }
  /// First slot (index of a stored off-diagonal block) of block row i. The slots of row i end where
  /// those of row i+1 begin.
  int row_begin(Index i) const { return row_begin_[static_cast<std::size_t>(i)]; }
  /// Block column of a slot, always less than the block row of the slot.
  int column(Index slot) const { return column_[static_cast<std::size_t>(slot)]; }
  /// Returns the slot of the pair (i, j), in either order, or -1 if the pattern does not have it
  /// (as for i = j). Complexity: O(log k) for k slots in the row. Fails when: i or j is outside [0,
  /// rows) (assert).
  int find(int i, int j) const {
    assert(i >= 0 && i < rows() && j >= 0 && j < rows());
    if (i < j) std::swap(i, j);
    const auto first = column_.begin() + row_begin_[static_cast<std::size_t>(i)];
    const auto last = column_.begin() + row_begin_[static_cast<std::size_t>(i) + 1];
    const auto it = std::lower_bound(first, last, j);
    return it != last && *it == j ? static_cast<int>(it - column_.begin()) : -1;
  }
  /// Diagonal block of row i.
  Matrix3<Scalar>& diagonal(Index i) { return diagonal_[static_cast<std::size_t>(i)]; }
  /// Diagonal block of row i.
  const Matrix3<Scalar>& diagonal(Index i) const { return diagonal_[static_cast<std::size_t>(i)]; }
  /// Block (row, column(slot)) of a slot.
  Matrix3<Scalar>& lower(Index slot) { return lower_[static_cast<std::size_t>(slot)]; }
  /// Block (row, column(slot)) of a slot.
  const Matrix3<Scalar>& lower(Index slot) const { return lower_[static_cast<std::size_t>(slot)]; }

  /// Sets every block to zero; the pattern stays.
  void set_zero() {
    for (auto& block : diagonal_) block.setZero();
    for (auto& block : lower_) block.setZero();
  }

  /// Adds `factor` times `other`, a matrix of the same pattern. Never allocates. Fails when: the
  /// sizes differ (assert).
  void add_scaled(const BlockSymmetric& other, Scalar factor) {
    assert(other.lower_.size() == lower_.size() && other.diagonal_.size() == diagonal_.size());
    for (std::size_t i = 0; i < diagonal_.size(); ++i) diagonal_[i] += factor * other.diagonal_[i];
    for (std::size_t i = 0; i < lower_.size(); ++i) lower_[i] += factor * other.lower_[i];
  }

  /// Returns a matrix of the same pattern in another scalar, with values converted. Allocates.
  template <RealScalar Other>
  BlockSymmetric<Other> cast() const {
    BlockSymmetric<Other> out;
    out.row_begin_ = row_begin_;
    out.column_ = column_;
    out.diagonal_.assign(diagonal_.size(), Matrix3<Other>::Zero().eval());
    out.lower_.assign(lower_.size(), Matrix3<Other>::Zero().eval());
    out.assign(*this);
    return out;
  }

  /// Converts the values of `other`, a matrix of the same pattern in another scalar, to those of
  /// this one. Never allocates. Fails when: the sizes differ (assert).
  template <RealScalar Other>
  void assign(const BlockSymmetric<Other>& other) {
    assert(other.lower_.size() == lower_.size() && other.diagonal_.size() == diagonal_.size());
    const auto convert = [](const std::vector<Matrix3<Other>>& from,
                            std::vector<Matrix3<Scalar>>& to) {
      for (std::size_t i = 0; i < to.size(); ++i) {
        for (Index k = 0; k < 9; ++k) to[i].data()[k] = static_cast<Scalar>(from[i].data()[k]);
      }
    };
    convert(other.diagonal_, diagonal_);
    convert(other.lower_, lower_);
  }

  /// y = A x for kLanes vectors at once: x and y are kLanes×3n, column 3i+c is coordinate c of
  /// vertex i. No allocation. Fails when: x or y is of another size, or both are the same object
  /// (assert).
  template <int kLanes>
  void multiply(const Lanes<Scalar, kLanes>& x, Lanes<Scalar, kLanes>& y) const {
    assert(x.cols() == 3 * rows() && y.cols() == 3 * rows() && &x != &y);
    for (Index i = 0; i < rows(); ++i) {
      const Matrix3<Scalar>& d = diagonal_[static_cast<std::size_t>(i)];
      Eigen::Matrix<Scalar, kLanes, 3> sum = x.template middleCols<3>(3 * i) * d;
      const Eigen::Matrix<Scalar, kLanes, 3> xi = x.template middleCols<3>(3 * i);
      for (int s = row_begin(i); s < row_begin(i + 1); ++s) {
        const Index j = column(s);
        const Matrix3<Scalar>& b = lower(s);
        sum += x.template middleCols<3>(3 * j).lazyProduct(b.transpose());
        y.template middleCols<3>(3 * j) += xi.lazyProduct(b);
      }
      // Rows ascend, and every stored block (i, j) has j < i. So later rows still add to y_i, and
      // it must get its first value here.
      y.template middleCols<3>(3 * i) = sum;
    }
  }

 private:
  template <RealScalar Other>
  friend class BlockSymmetric;

  std::vector<int> row_begin_{0};
  std::vector<int> column_;
  std::vector<Matrix3<Scalar>> diagonal_;
  std::vector<Matrix3<Scalar>> lower_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
