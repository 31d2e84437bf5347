#pragma once

// The memory of BlockCholesky::inverse_block: the rows of Z = L⁻¹E on the fronts that are not zero,
// and the product ZᵀZ.

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "clothctl/linalg/detail/front_layout.hpp"
#include "clothctl/linalg/detail/pack.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Memory of BlockCholesky::inverse_block; `make_inverse_block_memory` makes it.
template <RealScalar Scalar>
class InverseBlockMemory {
 public:
  /// Without room.
  InverseBlockMemory() = default;
  /// Room for `count` vertices and a factor of `rows` vertices and `fronts` fronts. Allocates.
  InverseBlockMemory(Index rows, Index fronts, Index count)
      : count_(count), marked_(static_cast<std::size_t>(fronts), 0) {
    rows_.setZero(kLanes, 3 * rows);
    kept_.setZero(padded(3 * count), 3 * rows);
    fronts_.reserve(static_cast<std::size_t>(fronts));
  }

  /// Returns true when there is room for `count` vertices and such a factor.
  bool fits(Index rows, Index fronts, Index count) const {
    return rows_.cols() == 3 * rows && marked_.size() == static_cast<std::size_t>(fronts) &&
           count <= count_;
  }

  /// Lists the fronts on the ways from those of `vertices` to the root, in order of elimination.
  void start(std::span<const int> vertices, const FrontLayout& layout) {
    fronts_.clear();
    for (const int v : vertices) {
      for (int k = layout.front_of[at(v)]; k >= 0 && marked_[at(k)] == 0;
           k = layout.fronts[at(k)].parent) {
        marked_[at(k)] = 1;
        fronts_.push_back(k);
      }
    }
    for (const int k : fronts_) marked_[at(k)] = 0;
    std::sort(fronts_.begin(), fronts_.end());
  }
  /// The fronts, ascending.
  const std::vector<int>& fronts() const { return fronts_; }
  /// The right-hand sides at hand, 16×3n.
  Scalar* rows() { return rows_.data(); }

  /// Sets the right-hand sides on the listed fronts to the unit vectors from number `first` on.
  void load_unit_vectors(std::span<const int> vertices, Index first, const FrontLayout& layout) {
    for_each_pivot(
        layout, [&](int v) { rows_.template middleCols<3>(3 * static_cast<Index>(v)).setZero(); });
    const Index end = (std::min)(first + kLanes, 3 * static_cast<Index>(vertices.size()));
    for (Index k = first; k < end; ++k)
      rows_(k - first, 3 * static_cast<Index>(vertices[static_cast<std::size_t>(k / 3)]) + k % 3) =
          Scalar(1);
  }
  /// Copies the rows of Z on the listed fronts.
  void keep_rows(Index first, const FrontLayout& layout) {
    Index row = 0;
    for_each_pivot(layout, [&](int v) {
      kept_.template block<kLanes, 3>(first, row) =
          rows_.template middleCols<3>(3 * static_cast<Index>(v));
      row += 3;
    });
    kept_rows_ = row;
  }

  /// Writes ZᵀZ of the first `columns` columns of Z.
  void write_products(Index columns, Eigen::Ref<MatrixX<Scalar>> out) const {
    for (Index i = 0; i < columns; i += kLanes) {
      for (Index j = 0; j < (std::min)(i + kLanes, columns); j += kTile)
        write_tile(i, j, columns, out);
    }
  }

 private:
  static constexpr int kLanes = 16, kTile = 4;

  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  static Index padded(Index n) { return (n + kLanes - 1) / kLanes * kLanes; }

  template <class F>
  void for_each_pivot(const FrontLayout& layout, F f) const {
    for (const int k : fronts_) {
      const Front& front = layout.fronts[at(k)];
      for (int v = 0; v < static_cast<int>(front.pivots / 3); ++v)
        f(layout.vertices[at(front.vertex_begin + v)]);
    }
  }

  /// Rows i to i + 15 and columns j to j + 3 of the product, and their mirror image.
  void write_tile(Index i, Index j, Index columns, Eigen::Ref<MatrixX<Scalar>> out) const {
    Pack<Scalar, kLanes> sum[kTile];
    for (auto& s : sum) s.set_zero();
    for (Index r = 0; r < kept_rows_; ++r) {
      const Scalar* row = kept_.data() + r * kept_.rows();
      Pack<Scalar, kLanes> a;
      a.load(row + i);
      for (int t = 0; t < kTile; ++t) sum[t].add_product(a, row[j + t]);
    }
    for (int t = 0; t < kTile && j + t < columns; ++t) {
      Scalar values[kLanes];
      sum[t].store(values);
      for (int l = 0; l < kLanes && i + l < columns; ++l)
        out(i + l, j + t) = out(j + t, i + l) = values[l];
    }
  }

  Index count_ = 0, kept_rows_ = 0;
  std::vector<unsigned char> marked_;
  std::vector<int> fronts_;
  Lanes<Scalar, 16> rows_;
  /// Zᵀ: one column for each row of Z on the listed fronts.
  MatrixX<Scalar> kept_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
