#pragma once

// Minimises a convex function of one variable on [0, end] whose slope is piecewise linear: the
// objective of a line search with one-sided quadratic penalties. The slope bends at breakpoints.

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The breakpoints of a piecewise quadratic function.
template <RealScalar Scalar>
class PiecewiseQuadratic {
 public:
  /// Makes room for `most` breakpoints. Allocates.
  void reserve(Index most) {
    points_.assign(static_cast<std::size_t>(most), {Scalar(0), Scalar(0)});
    count_ = 0;
  }

  /// Forgets the breakpoints.
  void clear() { count_ = 0; }

  /// Adds a breakpoint, at most as many as reserved: from t on the curvature is larger by `change`.
  void add(const Scalar& t, const Scalar& change) { points_[count_++] = {t, change}; }

  /// Returns the first minimiser on [0, end], given the slope < 0 and the curvature at 0. Returns
  /// `end` when the function falls on all of [0, end].
  Scalar minimiser(const Scalar& slope, const Scalar& curvature, const Scalar& end) {
    const auto end_of_points = points_.begin() + static_cast<std::ptrdiff_t>(count_);
    std::sort(points_.begin(), end_of_points,
              [](const Point& a, const Point& b) { return a.first < b.first; });
    Scalar t(0), s = slope, bend = curvature;
    for (std::size_t k = 0; k < count_; ++k) {
      const Scalar next = s + bend * (points_[k].first - t);
      if (!(next < Scalar(0))) break;
      s = next;
      t = points_[k].first;
      bend += points_[k].second;
    }
    if (!(bend > Scalar(0))) return end;
    return (std::min)(end, Scalar(t - s / bend));
  }

 private:
  using Point = std::pair<Scalar, Scalar>;
  std::vector<Point> points_;
  std::size_t count_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
