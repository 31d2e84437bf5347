#pragma once

// Keeps the product H x between solves. Most unknowns of a warm start have not moved since the
// product was made, so only the columns of the others have to be added.

#include <algorithm>
#include "clothctl/core/types.hpp"
#include "clothctl/linalg/vector_kernels.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The product of a curvature's H with the x it was last made for. All memory comes from `reserve`.
template <RealScalar Scalar>
class CachedProduct {
 public:
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) {
    set_zero<Scalar>({&product_, &at_, &sum_, &move_}, n);
    known_ = false;
  }

  /// H or the number of unknowns changed.
  void forget() { known_ = false; }

  /// Returns true when the product was made for this very x of n unknowns.
  bool is_of(const Vector& x, Index n) const { return known_ && moved(x, n) == 0; }

  /// H x, n entries in use: from scratch, or made so for this very x.
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

  /// H x, rounded by how far x went since `refresh`: where few unknowns moved, only their part is
  /// new.
  template <class Curvature>
  const Vector& update(Curvature& curvature, const Vector& x) {
    const Index n = curvature.unknowns(), away = known_ ? moved(x, n) : n;
    if (away == 0 || 4 * away > n) return refresh(curvature, x);
    for (Index j = 0; j < n; ++j) move_[j] = x[j] - at_[j];
    std::copy_n(product_.data(), n, sum_.data());
    curvature.add_product(move_, sum_);
    return sum_;
  }

 private:
  /// The number of unknowns that are not where the product was made.
  Index moved(const Vector& x, Index n) const {
    Index count = 0;
    for (Index j = 0; j < n; ++j) count += x[j] < at_[j] || x[j] > at_[j] ? 1 : 0;
    return count;
  }

  Vector product_, at_, sum_, move_;
  bool known_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
