#pragma once

// Sums of products as if computed in twice the precision. The rounding error of each addition and
// multiplication is itself a floating-point number; it is computed exactly and added to a second
// sum. The result has one rounding error, plus eps² times the sum of the absolute values of its
// terms. Reference: Ogita, Rump and Oishi, Accurate sum and dot product, SIAM J. Sci. Comput. 26
// (2005), algorithm Dot2.

#include <cmath>
#include <concepts>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Returns true when AccurateSum is accurate: built-in types, in builds whose compiler keeps the
/// order of operations.
template <RealScalar Scalar>
constexpr bool has_accurate_sums() {
#if defined(__FAST_MATH__) || defined(_M_FP_FAST)
  return false;
#else
  return std::floating_point<Scalar>;
#endif
}

/// A sum and its accumulated rounding error. Only a plain sum if `has_accurate_sums` is false.
template <RealScalar Scalar>
class AccurateSum {
 public:
  /// Adds v.
  void add(const Scalar& v) {
    const Scalar sum = sum_ + v;
    if constexpr (has_accurate_sums<Scalar>()) {
      const Scalar part = sum - sum_;
      error_ += (sum_ - (sum - part)) + (v - part);
    }
    sum_ = sum;
  }

  /// Adds a · b.
  void add_product(const Scalar& a, const Scalar& b) {
    const Scalar product = a * b;
    if constexpr (has_accurate_sums<Scalar>()) error_ += std::fma(a, b, -product);
    add(product);
  }

  /// Subtracts another sum.
  void subtract(const AccurateSum& other) {
    add(-other.sum_);
    error_ -= other.error_;
  }

  /// Returns the sum. It is not finite when a term is not finite or overflows.
  Scalar value() const { return sum_ + error_; }

 private:
  Scalar sum_ = Scalar(0), error_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI
