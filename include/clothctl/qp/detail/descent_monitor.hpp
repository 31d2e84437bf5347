#pragma once

// Tells whether the objective of an active-set method still falls. Values of the objective would
// hide small changes behind a large constant, so the changes are summed instead. A step from x' to
// x changes a quadratic with gradients s' at x' and s at x by ½ (s + s')ᵀ(x - x').

#include <cmath>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Sums the changes of an objective from step to step.
template <RealScalar Scalar>
class DescentMonitor {
 public:
  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) {
    last_x_.setZero(n);
    last_slope_.setZero(n);
    restart();
  }

  /// Makes the next iterate the reference for later ones.
  void restart() { fresh_ = true; }

  /// Adds the change of the quadratic part over the first n unknowns. `slope(i)` is its gradient at
  /// x, and `size(i)` the sum of the absolute values of the gradient's terms, for the rounding
  /// error.
  template <class Slope, class Size>
  void add_quadratic(Index n, const VectorX<Scalar>& x, Slope slope, Size size) {
    using std::abs;
    change_ = size_ = Scalar(0);
    for (Index i = 0; i < n; ++i) {
      const Scalar s = slope(i), step = x[i] - last_x_[i];
      change_ += Scalar(0.5) * (s + last_slope_[i]) * step;
      size_ += size(i) * abs(step);
      last_slope_[i] = s;
      last_x_[i] = x[i];
    }
  }

  /// Adds the change of another term; `size` is the magnitude that its rounding error is relative
  /// to. Call it after `add_quadratic`.
  void add_term(const Scalar& change, const Scalar& size) {
    change_ += change;
    size_ += size;
  }

  /// Ends the step. Returns true for the first step since the restart, and when the objective is
  /// lower than after all earlier ones by more than rounding.
  bool is_lowest() {
    if (fresh_) {
      fresh_ = false;
      total_ = least_ = Scalar(0);
      return true;
    }
    total_ += change_;
    if (!(total_ < least_ - scalar_traits<Scalar>::epsilon() * size_)) return false;
    least_ = total_;
    return true;
  }

 private:
  VectorX<Scalar> last_x_, last_slope_;
  Scalar change_ = Scalar(0), size_ = Scalar(0), total_ = Scalar(0), least_ = Scalar(0);
  bool fresh_ = true;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
