#pragma once

// The Cholesky factor of a principal submatrix whose index set grows and shrinks:
//
//   L Lᵀ = H_FF + s I,   F an ordered list of unknowns
//
//   append i:  l = L⁻¹ H_Fi,  d² = H_ii + s - lᵀl,  new last row (lᵀ, d)          O(f²)
//   remove k:  delete row and column k. Givens rotations change the block T below
//              and right of it to T' with T'T'ᵀ = T Tᵀ + w wᵀ, where w is the
//              deleted column below the diagonal                                 O((f - k)²)
//
// Reference: Golub and Van Loan, Matrix Computations, 4th ed. (2013), §6.5.4.

#include <algorithm>
#include <cmath>
#include <vector>

#include "clothctl/linalg/tiled_cholesky.hpp"
#include "clothctl/linalg/vector_kernels.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// An updatable Cholesky factor of a subset of the unknowns. All memory comes from `reserve`.
template <RealScalar Scalar>
class UpdatableCholesky {
 public:
  /// A dense matrix.
  using Matrix = MatrixX<Scalar>;
  /// A read-only view of the matrix H.
  using HessianView = Eigen::Ref<const Matrix>;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) { reserve(n, n); }

  /// Makes room for sets of at most `most` of n unknowns. Allocates.
  void reserve(Index n, Index most) {
    Index stride = (most + 7) / 8 * 8;
    if (stride % 64 == 0) stride += 8;  // or all columns would share few cache sets
    L_.setZero(stride, most);
    order_.assign(static_cast<std::size_t>(most), 0);
    position_.assign(static_cast<std::size_t>(n), -1);
    set_zero<Scalar>({&work_, &scale_, &cosine_, &sine_}, most);
    size_ = 0;
  }

  /// Clears the set.
  void clear() {
    for (Index k = 0; k < size_; ++k) position(order(k)) = -1;
    size_ = 0;
  }

  /// Clears the set, and lends the whole reserved memory of L to the caller.
  Eigen::Ref<Matrix> lend() {
    clear();
    return L_;
  }

  /// Number of unknowns in the set.
  Index size() const { return size_; }
  /// The unknown at position k of the order.
  Index order(Index k) const { return order_[static_cast<std::size_t>(k)]; }
  /// The position of unknown i in the order, or -1 when it is not in the set.
  Index place(Index i) const { return position_[static_cast<std::size_t>(i)]; }
  /// L as an f×f view; only its lower triangle is meaningful.
  Eigen::Ref<const Matrix> lower() const { return L_.topLeftCorner(size_, size_); }

  /// Appends unknown i. Returns false, and does not append it, when the enlarged block is almost
  /// singular: d² ≤ relative (H_ii + shift). In both cases `pivot()` then is d², and `column()` is
  /// L⁻¹ H_Fi.
  bool append(const HessianView& H, Index i, const Scalar& shift, const Scalar& relative) {
    using std::sqrt;
    for (Index k = 0; k < size_; ++k) work_[k] = H(order(k), i);
    solve_lower(work_);
    const Scalar diagonal = H(i, i) + shift;
    pivot_ = diagonal - dot_product(size_, work_.data(), work_.data());
    if (!(pivot_ > relative * diagonal)) return false;
    for (Index k = 0; k < size_; ++k) L_(size_, k) = work_[k];
    L_(size_, size_) = sqrt(pivot_);
    order_[static_cast<std::size_t>(size_)] = i;
    position(i) = size_++;
    return true;
  }

  /// The pivot d² of the last `append`.
  const Scalar& pivot() const { return pivot_; }
  /// L⁻¹ H_Fi of the last `append` (first `size()` entries, before a successful append).
  const VectorX<Scalar>& column() const { return work_; }

  /// Cosines of the rotations of the last `remove`, one for each position after the removed one.
  const VectorX<Scalar>& cosine() const { return cosine_; }
  /// Sines of the rotations of the last `remove`.
  const VectorX<Scalar>& sine() const { return sine_; }

  /// Removes the unknown at position k of the order.
  void remove(Index k) {
    using std::sqrt;
    const Index m = size_ - k - 1;
    for (Index j = 0; j < m; ++j) work_[j] = L_(k + 1 + j, k);
    for (Index j = 0; j < k; ++j) {
      Scalar* column = &L_.coeffRef(0, j);
      std::copy(column + k + 1, column + size_, column + k);
    }
    for (Index j = k + 1; j < size_; ++j) {
      const Scalar* from = &L_.coeffRef(0, j);
      std::copy(from + j, from + size_, &L_.coeffRef(0, j - 1) + j - 1);
    }
    position(order(k)) = -1;
    for (Index j = k; j + 1 < size_; ++j) {
      order_[static_cast<std::size_t>(j)] = order(j + 1);
      position(order(j)) = j;
    }
    --size_;
    for (Index j = 0; j < m; ++j) {
      const Scalar a = L_(k + j, k + j);
      const Scalar b = work_[j];
      const Scalar r = sqrt(a * a + b * b);
      const Scalar c = a / r;
      const Scalar s = b / r;
      cosine_[j] = c;
      sine_[j] = s;
      const Index below = m - j - 1;
      L_(k + j, k + j) = r;
      apply_rotation(below, c, s, &L_.coeffRef(k + j, k + j) + 1, work_.data() + j + 1);
    }
  }

  /// Factors the set `wanted[0 … count-1]` from scratch, in tiles. Leaves out unknowns that would
  /// make the block almost singular (their `place` is -1).
  void rebuild(const HessianView& H, const std::vector<Index>& wanted, Index count,
               const Scalar& shift, const Scalar& relative) {
    clear();
    for (Index k = 0; k < count; ++k) {
      const Index i = wanted[static_cast<std::size_t>(k)];
      for (Index r = k; r < count; ++r) L_(r, k) = H(wanted[static_cast<std::size_t>(r)], i);
      L_(k, k) += shift;
      scale_[k] = L_(k, k);
    }
    const Index good =
        cholesky_in_place<Scalar>(L_.topLeftCorner(count, count), scale_.head(count), relative);
    for (Index k = 0; k < good; ++k) {
      const Index i = wanted[static_cast<std::size_t>(k)];
      order_[static_cast<std::size_t>(k)] = i;
      position(i) = k;
    }
    size_ = good;
    for (Index k = good; k < count; ++k)
      append(H, wanted[static_cast<std::size_t>(k)], shift, relative);
  }

  /// v ← L⁻¹ v on the first `size()` entries.
  void solve_lower(VectorX<Scalar>& v) const {
    clothctl::solve_lower(L_.data(), L_.outerStride(), size_, v.data());
  }
  /// v ← L⁻ᵀ v on the first `size()` entries.
  void solve_upper(VectorX<Scalar>& v) const {
    clothctl::solve_upper(L_.data(), L_.outerStride(), size_, v.data());
  }

 private:
  Index& position(Index i) { return position_[static_cast<std::size_t>(i)]; }

  Matrix L_;
  std::vector<Index> order_, position_;
  VectorX<Scalar> work_, scale_, cosine_, sine_;
  Scalar pivot_ = Scalar(0);
  Index size_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
