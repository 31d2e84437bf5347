#pragma once

// The lengths t at which the unknowns that move along x + t p meet their bounds, in order.

#include <algorithm>
#include <cstddef>
#include <vector>

#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The breakpoints of a line search within bounds.
template <RealScalar Scalar>
class BoundBreakpoints {
 public:
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) {
    length_.setZero(n);
    unknowns_.assign(static_cast<std::size_t>(n), 0);
  }

  /// Finds the breakpoints of the first `count` unknowns of `moving`, which are at x within the
  /// bounds lo and hi and move along p. Infinite bounds and unknowns with p_i = 0 have none. Never
  /// allocates.
  void find(const std::vector<Index>& moving, Index count, const Vector& x, const Vector& p,
            const Vector& lo, const Vector& hi) {
    count_ = next_ = 0;
    least_ = scalar_traits<Scalar>::infinity();
    for (Index k = 0; k < count; ++k) {
      const Index i = moving[static_cast<std::size_t>(k)];
      const Scalar edge = p[i] < Scalar(0) ? lo[i] : hi[i];
      if (!has_bound(edge) || (!(p[i] < Scalar(0)) && !(p[i] > Scalar(0)))) continue;
      length_[i] = (std::max)(Scalar(0), Scalar((edge - x[i]) / p[i]));
      least_ = (std::min)(least_, length_[i]);
      unknowns_[static_cast<std::size_t>(count_++)] = i;
    }
  }

  /// Returns true when a breakpoint comes before the length t.
  bool any_before(const Scalar& t) const { return least_ < t; }

  /// Orders the breakpoints by length, equal ones by unknown. Call it before the functions below.
  void sort() {
    std::sort(unknowns_.begin(), unknowns_.begin() + count_, [this](Index a, Index b) {
      return length_[a] < length_[b] || (!(length_[b] < length_[a]) && a < b);
    });
  }

  /// Returns true when no breakpoint is left.
  bool done() const { return next_ == count_; }
  /// Length of the next breakpoint.
  const Scalar& length() const { return length_[unknowns_[static_cast<std::size_t>(next_)]]; }
  /// Returns the unknown of the next breakpoint, and goes on to the one after it.
  Index take() { return unknowns_[static_cast<std::size_t>(next_++)]; }

 private:
  Vector length_;
  std::vector<Index> unknowns_;
  Index count_ = 0, next_ = 0;
  Scalar least_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
