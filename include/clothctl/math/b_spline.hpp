#pragma once

// Cubic B-spline curves in space, twice continuously differentiable, with clamped ends.
//
//   p(t) = Σ_j N_j(t) c_j,    knots τ_0 ≤ τ_1 ≤ … ≤ τ_{n+3}
//   τ_0 = … = τ_3 = start,    τ_n = … = τ_{n+3} = end
//
// N_j is the cubic basis function on τ_j … τ_{j+4}. A point is evaluated by de Boor's algorithm. On
// the span τ_k ≤ t < τ_{k+1} the point depends only on d_j = c_{k-3+j}, j = 0 … 3. For l = 1, 2, 3
//
//   d_j ← (1 - α) d_{j-1} + α d_j,    α = (t - τ_{k-3+j}) / (τ_{k+j-l+1} - τ_{k-3+j}),
//
// and p(t) = d_3. The derivative is the B-spline of degree 2 with control points
// 3 (c_{j+1} - c_j) / (τ_{j+4} - τ_{j+1}).
//
// Samples (t_i, y_i) with h_i = t_{i+1} - t_i are interpolated by the natural spline. Its second
// derivatives M_i at t_i are zero at both ends, and solve the diagonally dominant tridiagonal
// system
//
//   h_{i-1} M_{i-1} + 2 (h_{i-1} + h_i) M_i + h_i M_{i+1}
//     = 6 ((y_{i+1} - y_i)/h_i - (y_i - y_{i-1})/h_{i-1}).
//
// The control points are the polar forms of the pieces at three successive knots (v_i is the
// velocity at t_i):
//
//   c_{i+1} = y_i + v_i (h_i - h_{i-1})/3 - M_i h_{i-1} h_i/6,    h_{-1} = h_{last} = 0.

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Returns an error message for the first column of `points` that is not finite, or "". The message
/// starts with `name` and the index.
template <class Scalar>
std::string non_finite_point(const PointsView<Scalar>& points, const char* name) {
  for (Index j = 0; j < points.cols(); ++j) {
    for (Index i = 0; i < 3; ++i) {
      if (is_finite(points(i, j))) continue;
      return std::string(name) + " " + std::to_string(j) + ": " + "xyz"[i] + " is " +
             number_text(points(i, j)) + ", expected a finite number";
    }
  }
  return {};
}

}  // namespace detail

/// A cubic C² curve from time (s) to position (m) on [start_time, end_time] with clamped ends.
///
/// Outside this interval the position is that of the nearer end, and both derivatives are zero.
template <RealScalar Scalar>
class CubicBSpline {
 public:
  /// Makes the curve with the given control points (3×n, n ≥ 4, m) on uniform clamped knots over
  /// [start_time, end_time] (s). The curve starts at the first control point and ends at the last.
  /// Allocates. Complexity: O(n). Fails when: n < 4, a value is not finite, end_time ≤ start_time,
  /// or two knots coincide in Scalar.
  static Result<CubicBSpline> from_control_points(const PointsView<Scalar>& control,
                                                  Scalar start_time, Scalar end_time) {
    const Index n = control.cols();
    if (n < 4) return Error{"control points: expected at least 4, found " + std::to_string(n)};
    if (std::string bad = detail::non_finite_point<Scalar>(control, "control point"); !bad.empty())
      return Error{bad};
    if (!is_finite(start_time))
      return Error{"start time is " + number_text(start_time) + ", expected a finite number"};
    if (!is_finite(end_time))
      return Error{"end time is " + number_text(end_time) + ", expected a finite number"};
    const Scalar length = end_time - start_time;
    if (!(start_time < end_time) || !is_finite(length)) {
      return Error{"end time " + number_text(end_time) + " does not come after start time " +
                   number_text(start_time)};
    }
    CubicBSpline curve;
    curve.control_ = control;
    curve.knots_.assign(static_cast<std::size_t>(n) + 4, start_time);
    const Scalar spans = Scalar(static_cast<double>(n - 3));
    for (Index k = 4; k < n; ++k)
      curve.knot(k) = start_time + length * (Scalar(static_cast<double>(k - 3)) / spans);
    for (Index k = n; k < n + 4; ++k) curve.knot(k) = end_time;
    for (Index k = 4; k <= n; ++k) {
      if (curve.knot(k - 1) < curve.knot(k)) continue;
      return Error{"knot " + std::to_string(k) + ": time " + number_text(curve.knot(k)) +
                   " does not come after " + number_text(curve.knot(k - 1)) +
                   ", too many control points for the interval"};
    }
    return curve;
  }

  /// Makes the curve through all samples: `times` (n ≥ 2, strictly increasing, s) and `points`
  /// (3×n, m), with zero acceleration at both ends. The curve has n + 2 control points. Allocates.
  /// Complexity: O(n). Fails when: counts differ, n < 2, a value is not finite, the times do not
  /// increase, or a control point overflows.
  static Result<CubicBSpline> interpolate(const Eigen::Ref<const VectorX<Scalar>>& times,
                                          const PointsView<Scalar>& points) {
    const Index n = times.size();
    if (points.cols() != n) {
      return Error{"samples: " + std::to_string(n) + " times but " + std::to_string(points.cols()) +
                   " points"};
    }
    if (n < 2) return Error{"samples: expected at least 2, found " + std::to_string(n)};
    for (Index i = 0; i < n; ++i) {
      const std::string where = "sample " + std::to_string(i) + ": time ";
      if (!is_finite(times[i]))
        return Error{where + "is " + number_text(times[i]) + ", expected a finite number"};
      if (i > 0 && !(times[i - 1] < times[i])) {
        return Error{where + number_text(times[i]) + " does not come after " +
                     number_text(times[i - 1])};
      }
    }
    if (std::string bad = detail::non_finite_point<Scalar>(points, "sample"); !bad.empty())
      return Error{bad};

    CubicBSpline curve;
    curve.knots_.assign(static_cast<std::size_t>(n) + 6, times[0]);
    for (Index i = 1; i < n; ++i) curve.knot(i + 3) = times[i];
    for (Index k = n + 3; k < n + 6; ++k) curve.knot(k) = times[n - 1];
    const VectorX<Scalar> h = times.tail(n - 1) - times.head(n - 1);
    Points<Scalar> slope(3, n - 1);
    for (Index i = 0; i + 1 < n; ++i) slope.col(i) = (points.col(i + 1) - points.col(i)) / h[i];
    const Points<Scalar> bend = natural_second_derivatives(h, slope);

    curve.control_.resize(3, n + 2);
    curve.control_.col(0) = points.col(0);
    curve.control_.col(n + 1) = points.col(n - 1);
    for (Index i = 0; i < n; ++i) {
      const Scalar before = i > 0 ? h[i - 1] : Scalar(0);
      const Scalar after = i + 1 < n ? h[i] : Scalar(0);
      Vector3<Scalar> velocity;
      if (i + 1 < n) {
        velocity = slope.col(i) - (after / Scalar(6)) * (Scalar(2) * bend.col(i) + bend.col(i + 1));
      } else {
        velocity =
            slope.col(i - 1) + (before / Scalar(6)) * (Scalar(2) * bend.col(i) + bend.col(i - 1));
      }
      curve.control_.col(i + 1) = points.col(i) + ((after - before) / Scalar(3)) * velocity -
                                  (before * after / Scalar(6)) * bend.col(i);
    }
    if (!all_finite(curve.control_))
      return Error{"samples: times are too close together for these points"};
    return curve;
  }

  /// Returns the position at time t (m). Complexity: O(log n). No allocation.
  Vector3<Scalar> position(Scalar t) const {
    if (t < start_time()) return control_.col(0);
    if (end_time() < t) return control_.col(control_.cols() - 1);
    return evaluate<0>(t);
  }
  /// Returns the velocity at time t (m/s): one-sided at the ends, zero outside. Complexity: O(log
  /// n). No allocation.
  Vector3<Scalar> velocity(Scalar t) const {
    if (t < start_time() || end_time() < t) return Vector3<Scalar>::Constant(Scalar(0));
    return evaluate<1>(t);
  }
  /// Returns the acceleration at time t (m/s²): one-sided at the ends, zero outside. Complexity:
  /// O(log n). No allocation.
  Vector3<Scalar> acceleration(Scalar t) const {
    if (t < start_time() || end_time() < t) return Vector3<Scalar>::Constant(Scalar(0));
    return evaluate<2>(t);
  }

  /// First time of the curve (s).
  Scalar start_time() const { return knots_.front(); }
  /// Last time of the curve (s).
  Scalar end_time() const { return knots_.back(); }
  /// The control points (3×n, m).
  const Points<Scalar>& control_points() const { return control_; }
  /// Moves the whole curve by `offset` (m). Complexity: O(n). No allocation.
  void translate(const Vector3<Scalar>& offset) { control_.colwise() += offset; }

 private:
  CubicBSpline() = default;

  Scalar& knot(Index k) { return knots_[static_cast<std::size_t>(k)]; }
  const Scalar& knot(Index k) const { return knots_[static_cast<std::size_t>(k)]; }

  /// Returns the span k with τ_k ≤ t < τ_{k+1}, one of the n - 3 spans of positive length. The last
  /// span includes t = end.
  Index span(const Scalar& t) const {
    const auto first = knots_.begin() + 4;
    const auto last = knots_.begin() + control_.cols();
    return static_cast<Index>(std::upper_bound(first, last, t) - knots_.begin()) - 1;
  }

  /// Returns the derivative of order kOrder at t in [start, end].
  template <int kOrder>
  Vector3<Scalar> evaluate(const Scalar& t) const {
    constexpr int kDegree = 3 - kOrder;
    const Index k = span(t);
    std::array<Vector3<Scalar>, 4> d;
    for (int j = 0; j <= 3; ++j) d[static_cast<std::size_t>(j)] = control_.col(k - 3 + j);
    for (int r = 1; r <= kOrder; ++r) {
      for (int j = 0; j <= 3 - r; ++j) {
        const auto at = static_cast<std::size_t>(j);
        const Scalar factor =
            Scalar(static_cast<double>(4 - r)) / (knot(k + j + 1) - knot(k - 3 + j + r));
        d[at] = (d[at + 1] - d[at]) * factor;
      }
    }
    for (int l = 1; l <= kDegree; ++l) {
      for (int j = kDegree; j >= l; --j) {
        const auto at = static_cast<std::size_t>(j);
        const Scalar& from = knot(k - kDegree + j);
        const Scalar alpha = (t - from) / (knot(k + j - l + 1) - from);
        d[at] = d[at - 1] * (Scalar(1) - alpha) + d[at] * alpha;
      }
    }
    return d[static_cast<std::size_t>(kDegree)];
  }

  /// Returns the second derivatives of the natural spline at the n samples, by Gaussian elimination
  /// of the tridiagonal system without pivoting, for all three coordinates at once.
  static Points<Scalar> natural_second_derivatives(const VectorX<Scalar>& h,
                                                   const Points<Scalar>& slope) {
    const Index n = h.size() + 1;
    Points<Scalar> bend = Points<Scalar>::Constant(3, n, Scalar(0));
    VectorX<Scalar> pivot = VectorX<Scalar>::Constant(n, Scalar(1));
    for (Index i = 1; i + 1 < n; ++i) {
      pivot[i] = Scalar(2) * (h[i - 1] + h[i]);
      bend.col(i) = (slope.col(i) - slope.col(i - 1)) * Scalar(6);
      if (i == 1) continue;
      const Scalar ratio = h[i - 1] / pivot[i - 1];
      pivot[i] -= ratio * h[i - 1];
      bend.col(i) -= ratio * bend.col(i - 1);
    }
    for (Index i = n - 2; i > 0; --i)
      bend.col(i) = (bend.col(i) - h[i] * bend.col(i + 1)) / pivot[i];
    return bend;
  }

  std::vector<Scalar> knots_;
  Points<Scalar> control_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
