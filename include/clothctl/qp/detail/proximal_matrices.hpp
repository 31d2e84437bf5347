#pragma once

// H, A and Aᵀ of the scaled problem: dense, by columns, with lists of their nonzeros.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "clothctl/core/types.hpp"
#include "clothctl/linalg/columns.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The matrices of a proximal subproblem of n unknowns and m rows. Its parts are protected, for the
/// subproblem that is made of it.
template <RealScalar Scalar>
class ProximalMatrices {
 public:
  using ConstMap = Eigen::Map<const MatrixX<Scalar>>;
  using Map = Eigen::Map<MatrixX<Scalar>>;

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    hessian_.assign(static_cast<std::size_t>(n * n), Scalar(0));
    rows_.assign(static_cast<std::size_t>(n * m), Scalar(0));
    columns_.assign(static_cast<std::size_t>(n * m), Scalar(0));
    h_.reserve(n, n);
    a_.reserve(m, n);
    at_.reserve(n, m);
    n_ = m_ = 0;
  }
  /// Sets the size, at most the reserved one. The caller must then write H, A and Aᵀ.
  void resize(Index n, Index m) {
    n_ = n;
    m_ = m;
    h_.view(hessian_.data(), n, n);
    a_.view(rows_.data(), m, n);
    at_.view(columns_.data(), n, m);
  }
  /// Computes Aᵀ from A.
  void refresh_transpose() {
    constexpr Index kTile = 8;  // a line of the cache holds this many numbers
    for (Index first = 0; first < n_; first += kTile) {
      const Index end = (std::min)(first + kTile, n_);
      for (Index i = 0; i < m_; ++i) {
        for (Index j = first; j < end; ++j) At()(j, i) = A()(i, j);
      }
    }
  }
  /// Updates the pointers to the matrices. Needed after this object was copied or moved.
  void attach() {
    h_.attach(hessian_.data());
    a_.attach(rows_.data());
    at_.attach(columns_.data());
  }
  /// Lists the nonzeros of H, A and Aᵀ. Returns false, and does nothing, if the problem is small.
  bool list() {
    constexpr Index kSmall = 40;
    if (n_ + m_ < kSmall) return false;
    h_.list(hessian_.data(), n_, n_);
    a_.list(rows_.data(), m_, n_);
    at_.list(columns_.data(), n_, m_);
    return true;
  }

  Index unknowns() const { return n_; }
  Index rows() const { return m_; }
  Map H() { return {hessian_.data(), n_, n_}; }
  Map A() { return {rows_.data(), m_, n_}; }
  Map At() { return {columns_.data(), n_, m_}; }
  ConstMap H() const { return {hessian_.data(), n_, n_}; }
  ConstMap A() const { return {rows_.data(), m_, n_}; }
  ConstMap At() const { return {columns_.data(), n_, m_}; }
  const Columns<Scalar>& columns_of_H() const { return h_; }
  const Columns<Scalar>& columns_of_A() const { return a_; }
  const Columns<Scalar>& columns_of_At() const { return at_; }

  /// Returns √h_jj. Since H is semidefinite, |h_jk| ≤ √h_jj √h_kk.
  Scalar root_of_diagonal(Index j) const {
    using std::sqrt;
    return sqrt((std::max)(Scalar(0), Scalar(H()(j, j))));
  }

 protected:
  Columns<Scalar> h_, a_, at_;
  Index n_ = 0, m_ = 0;

 private:
  std::vector<Scalar> hessian_, rows_, columns_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
