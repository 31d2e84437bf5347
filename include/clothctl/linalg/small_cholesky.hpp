#pragma once

// Solves A x = b for a symmetric positive definite A of at most a few dozen rows, without
// allocation. With U = L D,
//
//   A = L D Lᵀ,   U_j = A_j - Σ_(k<j) U_jk / d_k · U_k,   d_j = U_jj,
//   x_j = (z_j - Σ_(i>j) U_ij x_i) / d_j
//
// b is stored below A as one more row; this row of U is z = L⁻¹ b. Columns are padded to a multiple
// of four entries, and every loop runs over whole columns. For up to 23 rows the length of a column
// is known at compile time. Near 15 rows, loops over remainders and square roots would cost more
// than all other work.

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A matrix and a right-hand side. The elimination overwrites both.
template <RealScalar Scalar>
class SmallCholesky {
 public:
  /// Makes room for up to n rows. Allocates.
  explicit SmallCholesky(Index n = 0) { reserve(n); }
  /// Makes room for up to n rows. Allocates.
  void reserve(Index n) {
    entries_.setZero(padded(n) * n);
    inverse_.setZero(padded(n));
    x_.setZero(padded(n));
  }
  /// Length of a column for n rows: n + 1 rounded up to whole groups of four.
  static Index padded(Index n) { return n / 4 * 4 + 4; }

  /// Sets the size to n, at most the reserved size. The entries then have arbitrary values.
  void resize(Index n) {
    n_ = n;
    stride_ = padded(n);
  }
  /// Number of rows.
  Index size() const { return n_; }
  /// Entry (i, j) of A, i ≥ j, before a solve.
  Scalar& operator()(Index i, Index j) { return entries_[j * stride_ + i]; }
  /// Column j, `padded(n)` entries. Entries above the diagonal and after row n may have any value.
  Scalar* column(Index j) { return entries_.data() + j * stride_; }

  /// x ← A⁻¹ x for x of n entries. Overwrites A. Returns -1, or the first column whose pivot is not
  /// positive; x does not change then. Never allocates. Complexity: n³/3.
  Index solve(Eigen::Ref<VectorX<Scalar>> x) {
    for (Index j = 0; j < n_; ++j) {
      Scalar* const own = column(j);
      for (Index i = 0; i < j; ++i) own[i] = Scalar(0);
      own[n_] = x[j];
      for (Index i = n_ + 1; i < stride_; ++i) own[i] = Scalar(0);
    }
    Index failed;
    switch (stride_ / 4) {
      case 1: failed = eliminate<4>(); break;
      case 2: failed = eliminate<8>(); break;
      case 3: failed = eliminate<12>(); break;
      case 4: failed = eliminate<16>(); break;
      case 5: failed = eliminate<20>(); break;
      case 6: failed = eliminate<24>(); break;
      default: failed = eliminate<Eigen::Dynamic>();
    }
    if (failed < 0) x = x_.head(n_);
    return failed;
  }

 private:
  template <int kRows>
  Index eliminate() {
    using Column = Eigen::Map<Eigen::Array<Scalar, kRows, 1>>;
    for (Index j = 0; j < n_; ++j) {
      Column own(column(j), stride_);
      if constexpr (kRows == Eigen::Dynamic) {
        for (Index k = 0; k < j; ++k) own -= share_of(j, k) * Column(column(k), stride_);
      } else {
        Eigen::Array<Scalar, kRows, 1> sum = own;
        for (Index k = 0; k < j; ++k) sum -= share_of(j, k) * Column(column(k));
        own = sum;
      }
      if (!(own[j] > Scalar(0))) return j;
      inverse_[j] = Scalar(1) / own[j];
    }
    Column x(x_.data(), stride_);
    x.setConstant(Scalar(0));  // entries that are not solved yet add zero to the dot products
    for (Index j = n_; j-- > 0;) {
      const Column own(column(j), stride_);
      x[j] = (own[n_] - (own * x).sum()) * inverse_[j];
    }
    return -1;
  }
  Scalar share_of(Index j, Index k) { return (*this)(j, k) * inverse_[k]; }

  VectorX<Scalar> entries_, inverse_, x_;
  Index n_ = 0, stride_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
