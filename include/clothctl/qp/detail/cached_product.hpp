#pragma once

// Keeps the product H x between solves. In a warm start most unknowns have the same value as when
// the product was computed, so only the columns of the other unknowns are added.

#include <algorithm>
#include "clothctl/core/types.hpp"
#include "clothctl/linalg/vector_kernels.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The product H x for the last x. All memory comes from `reserve`.
template <RealScalar Scalar>
class CachedProduct {
 public:
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) {
    set_zero<Scalar>({&product_, &at_, &sum_, &move_}, n);
    known_ = false;
  }

  /// Call this after a change of H or of the number of unknowns.
  void forget() { known_ = false; }

  /// Returns true when the product belongs to exactly this x of n unknowns.
  bool is_of(const Vector& x, Index n) const { return known_ && moved(x, n) == 0; }

  /// Returns H x, n entries in use. Computes it from scratch unless it belongs to exactly this x.
  template <class Curvature>
  const Vector& refresh(Curvature& curvature, const Vector& x) {
    const Index n = curvature.unknowns();
    if (is_of(x, n)) return product_;
    std::fill_n(product_.data(), n, Scalar(0));
    curvature.add_product(x, product_);
    std::copy_n(x.data(), n, at_.data());
    known_ = all_finite(x.head(n));
    return product_;
  }

  /// Returns H x. If at most a quarter of the unknowns changed since `refresh`, adds only the
  /// columns of those; the rounding error then grows with the distance that they moved.
  template <class Curvature>
  const Vector& update(Curvature& curvature, const Vector& x) {
    const Index n = curvature.unknowns(), count = known_ ? moved(x, n) : n;
    if (count == 0 || 4 * count > n) return refresh(curvature, x);
    for (Index j = 0; j < n; ++j) move_[j] = x[j] - at_[j];
    std::copy_n(product_.data(), n, sum_.data());
    curvature.add_product(move_, sum_);
    return sum_;
  }

 private:
  /// Returns the number of unknowns that differ from those of the stored product.
  Index moved(const Vector& x, Index n) const {
    Index count = 0;
    for (Index j = 0; j < n; ++j) count += x[j] < at_[j] || x[j] > at_[j] ? 1 : 0;
    return count;
  }

  Vector product_, at_, sum_, move_;
  bool known_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
