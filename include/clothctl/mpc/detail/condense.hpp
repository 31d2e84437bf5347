#pragma once

// Condenses the cost of a window into Hessian and gradient. With the changes δ of the inputs and
// their weighted impulse response Z, the weighted outputs e_k = e⁰_k + Σ_{j<=k} Z_{k-j} δ_j give
// the cost ½ Σ_k |e_k|² = ½ δᵀH δ + gᵀδ + const. Because Z is Toeplitz in time, H follows from a
// recurrence instead of products of big matrices:
//
//   H_{j,l} = H_{j+1,l+1} + Z_{K-1-j}ᵀ Z_{K-1-l},   H_{K,.} = H_{.,K} = 0
//   g_j = Σ_{k>=j} Z_{k-j}ᵀ e⁰_k                    j, l, k = 0 .. K-1

#include <algorithm>
#include <array>
#include <cstddef>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Writes `hessian` (inputs·K square, symmetric) and `gradient` (inputs·K) of `blocks` (Z_0 ..
/// Z_{K-1} side by side, rows × inputs·K; rows scaled by the square root of their weight) and
/// `residual` (e⁰, rows × K). Never allocates. Complexity: O(K² rows inputs²).
template <RealScalar Scalar>
void condense(const Eigen::Ref<const MatrixX<Scalar>>& blocks,
              const Eigen::Ref<const MatrixX<Scalar>>& residual,
              Eigen::Ref<MatrixX<Scalar>> hessian, Eigen::Ref<VectorX<Scalar>> gradient) {
  const Index horizon = residual.cols();
  if (horizon == 0) return;
  const Index inputs = blocks.cols() / horizon;
  for (Index lag = 0; lag < horizon; ++lag) {
    for (Index l = horizon - 1; l >= lag; --l) {
      const Index j = l - lag;
      hessian.block(l * inputs, j * inputs, inputs, inputs) =
          blocks.middleCols((horizon - 1 - l) * inputs, inputs)
              .transpose()
              .lazyProduct(blocks.middleCols((horizon - 1 - j) * inputs, inputs));
      if (l + 1 < horizon) {
        hessian.block(l * inputs, j * inputs, inputs, inputs) +=
            hessian.block((l + 1) * inputs, (j + 1) * inputs, inputs, inputs);
      }
    }
  }
  for (Index j = 0; j < hessian.cols(); ++j) {
    for (Index i = 0; i < j; ++i) hessian(i, j) = hessian(j, i);
  }
  gradient.setZero();
  for (Index k = 0; k < horizon; ++k) {
    for (Index j = 0; j <= k; ++j) {
      gradient.segment(j * inputs, inputs).noalias() +=
          blocks.middleCols((k - j) * inputs, inputs).transpose() * residual.col(k);
    }
  }
}

/// Adds the products of rows i.. and c.. of `response`, from its column `first` on, to a tile of
/// the Hessian.
template <Index kRows, Index kColumns, RealScalar Scalar>
void add_products(const MatrixX<Scalar>& response, Index first, Index i, Index c,
                  MatrixX<Scalar>& hessian) {
  std::array<Eigen::Array<Scalar, kRows, 1>, kColumns> sum;
  for (Index q = 0; q < kColumns; ++q)
    sum[static_cast<std::size_t>(q)] = hessian.col(c + q).template segment<kRows>(i);
  for (Index k = first; k < response.cols(); ++k) {
    const Eigen::Array<Scalar, kRows, 1> column = response.col(k).template segment<kRows>(i);
    for (Index q = 0; q < kColumns; ++q)
      sum[static_cast<std::size_t>(q)] += response(c + q, k) * column;
  }
  for (Index q = 0; q < kColumns; ++q)
    hessian.col(c + q).template segment<kRows>(i) = sum[static_cast<std::size_t>(q)];
}

/// Adds the cost of outputs e_k = `residual`_k + Σ_{j<=k} J_{k,j} δ_j whose response changes along
/// the window to `hessian` and `gradient`. `response`: Jᵀ, (inputs·K) × (rows·K), zero for the
/// inputs after a frame. Never allocates. Complexity: O(K³ rows inputs²).
template <RealScalar Scalar>
void condense_jacobian(const MatrixX<Scalar>& response, const MatrixX<Scalar>& residual,
                       MatrixX<Scalar>& hessian, VectorX<Scalar>& gradient) {
  const Index horizon = residual.cols(), rows = residual.rows();
  if (horizon == 0) return;
  const Index inputs = response.rows() / horizon;
  constexpr Index kRows = 16, kColumns = 4;  // that stay in registers
  for (Index c = 0; c < hessian.cols(); c += kColumns) {
    const Index columns = (std::min)(kColumns, hessian.cols() - c);
    for (Index i = c - c % kRows; i < hessian.rows(); i += kRows) {
      const Index first = rows * (i / inputs), height = (std::min)(kRows, hessian.rows() - i);
      if (columns == kColumns && height == kRows) {
        add_products<kRows, kColumns>(response, first, i, c, hessian);
      } else {
        for (Index q = c; q < c + columns; ++q) {
          for (Index k = first; k < response.cols(); ++k)
            hessian.col(q).segment(i, height) +=
                response(q, k) * response.col(k).segment(i, height);
        }
      }
    }
  }
  for (Index k = 0; k < horizon; ++k) {
    const Index size = (k + 1) * inputs;
    for (Index r = 0; r < rows; ++r)
      gradient.head(size) += residual(r, k) * response.col(k * rows + r).head(size);
  }
  for (Index j = 0; j < hessian.cols(); ++j) {
    for (Index i = 0; i < j; ++i) hessian(i, j) = hessian(j, i);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
