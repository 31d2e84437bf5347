#pragma once

// The time at which a ball first touches a convex solid.
//
// The distance d from a convex solid is a convex function, and so is g(t) = d(a + t v) - r on the
// straight path of the ball's centre. Newton's method from the left,
//
//   t ← t - g(t) / g'(t),     g'(t) = n·v
//
// therefore never passes the first root, and the ball is leaving for good where g' >= 0. It
// converges quadratically, and linearly where the path only grazes the solid. Unlike steps of the
// length of the distance ("sphere tracing") it does not slow down beside a surface.

#include <cmath>

#include "clothctl/collision/detail/point_queries.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns the largest magnitude of a coordinate of two points.
template <RealScalar Scalar>
Scalar largest_coordinate(const Vector3<Scalar>& a, const Vector3<Scalar>& b) {
  using std::abs;
  Scalar most(0);
  for (int i = 0; i < 3; ++i) {
    if (most < abs(a[i])) most = abs(a[i]);
    if (most < abs(b[i])) most = abs(b[i]);
  }
  return most;
}

/// Returns the distance at which a ball counts as touching: rounding could hide a smaller gap.
template <RealScalar Scalar>
Scalar touch_tolerance(const Vector3<Scalar>& from, const Vector3<Scalar>& to,
                       const Scalar& radius) {
  return Scalar(32) * scalar_traits<Scalar>::epsilon() *
         (largest_coordinate<Scalar>(from, to) + radius);
}

/// Returns the time of impact, 0 to `latest`, of a ball with a convex solid, or `no_impact()`.
/// `nearest(x)` is the NearestPoint of x; its normal must be the gradient of the distance. Where
/// the distance is unsigned, `extent` must be the largest coordinate of the solid: rounding of that
/// size could take a step to the other side, where the ball would seem to leave.
template <RealScalar Scalar, class Nearest>
Scalar convex_sweep(const Nearest& nearest, const Vector3<Scalar>& from, const Vector3<Scalar>& to,
                    const Scalar& radius, const Scalar& latest = Scalar(1),
                    const Scalar& extent = Scalar(0)) {
  // A path that grazes halves its gap in each step; after 100 the gap is below rounding.
  constexpr int kMostSteps = 100;
  const Scalar tolerance = touch_tolerance<Scalar>(from, to, radius + extent);
  const Vector3<Scalar> v = to - from;
  Scalar t(0);
  for (int step = 0; step < kMostSteps; ++step) {
    const Vector3<Scalar> x = from + t * v;
    const NearestPoint<Scalar> at = nearest(x);
    const Scalar gap = at.distance - radius;
    if (gap <= tolerance) return t;
    const Scalar closing = -at.normal.dot(v);
    if (!(Scalar(0) < closing)) return no_impact<Scalar>();
    if (!(gap <= (latest - t) * closing + tolerance)) return no_impact<Scalar>();
    t += gap / closing;
    if (latest < t) t = latest;
  }
  return t;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
