#pragma once

// What counts as zero in each entry of a gradient q = H x + g:
//
//   threshold j:  max(relative · max(|g_j|, |H x|_j), rounding · terms_j)
//   terms_j:      |g_j| + Σ_k √H_jj √H_kk |x_k|, but at most the largest |g_i| or |H x|_i of all
//                 entries (at least 1)
//
// The first part is relative to the entry's own size: a huge slope of another unknown must not hide
// it. The second part is the rounding error of the sum; Σ_k is an upper bound on Σ_k |H_jk x_k|. An
// entry whose |g_j| and |H x|_j are no larger than this error has no size of its own. Its threshold
// is relative · terms_j. All thresholds scale with q_j when unknowns are scaled.

#include <algorithm>
#include <cmath>

#include "clothctl/core/types.hpp"
#include "clothctl/linalg/vector_kernels.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Thresholds below which entries of a gradient count as zero, and a scale of each unknown.
template <RealScalar Scalar>
class ZeroGradient {
 public:
  using Vector = VectorX<Scalar>;

  /// Times the spacing of numbers: what rounding may add to a gradient, relative to its terms.
  static constexpr int kRounding = 32;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) { set_zero<Scalar>({&scale_, &threshold_, &root_}, n); }

  /// Takes the diagonal of the Hessian of n unknowns: diagonal(j) = H_jj.
  template <class Diagonal>
  void set_diagonal(Index n, Diagonal diagonal) {
    using std::sqrt;
    steepest_ = Scalar(0);
    for (Index j = 0; j < n; ++j) {
      const Scalar own = diagonal(j);
      scale_[j] = own > Scalar(0) ? Scalar(1) / sqrt(own) : Scalar(1);
      root_[j] = own > Scalar(0) ? sqrt(own) : Scalar(0);
      steepest_ = (std::max)(steepest_, root_[j]);
    }
  }

  /// Computes the thresholds at x, where `product` = H x. `relative` must be at least kRounding
  /// epsilon.
  void update(Index n, const Vector& g, const Vector& x, const Vector& product,
              const Scalar& relative) {
    using std::abs;
    Scalar largest(1), length(0);
    for (Index i = 0; i < n; ++i) {
      largest = (std::max)(largest, (std::max)(Scalar(abs(g[i])), Scalar(abs(product[i]))));
      length += root_[i] * abs(x[i]);
    }
    largest_terms_ = steepest_ * length;
    // Smaller slopes always count as zero: without this floor the thresholds would vanish with x
    // when g = 0.
    const Scalar least = Scalar(1e-30);
    const Scalar rounding = Scalar(kRounding) * scalar_traits<Scalar>::epsilon();
    for (Index i = 0; i < n; ++i) {
      const Scalar terms = (std::min)(Scalar(abs(g[i]) + length * root_[i]), largest);
      const Scalar own = (std::max)(Scalar(abs(g[i])), Scalar(abs(product[i])));
      const Scalar error = rounding * terms;
      const Scalar zero =
          own > error ? (std::max)(Scalar(relative * own), error) : relative * terms;
      threshold_[i] = (std::max)(zero, least);
    }
  }

  /// Returns the threshold of entry i.
  const Scalar& operator[](Index i) const { return threshold_[i]; }
  /// Returns 1/√H_ii, or 1 where H_ii is not positive. q_i times this scale does not depend on the
  /// unit of x_i.
  const Scalar& scale(Index i) const { return scale_[i]; }
  /// Returns an upper bound on Σ_k |H_jk x_k| for every j.
  const Scalar& largest_terms() const { return largest_terms_; }

 private:
  Vector scale_, threshold_, root_;
  Scalar steepest_ = Scalar(0), largest_terms_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
