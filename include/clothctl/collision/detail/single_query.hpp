#pragma once

// The queries of any collider for one point, without allocation.

#include <span>

#include "clothctl/concepts/collider.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A view of one point as n = 1 points.
template <RealScalar Scalar>
using OnePoint = Eigen::Map<const Points<Scalar>>;

/// Returns the signed distance of a point; infinity() when the collider has no answer.
template <RealScalar Scalar, class C>
Scalar distance_of(const C& collider, const Vector3<Scalar>& x) {
  const OnePoint<Scalar> point(x.data(), 3, 1);
  Scalar out = scalar_traits<Scalar>::infinity();
  Eigen::Map<VectorX<Scalar>> value(&out, 1);
  const PointsView<Scalar> view(point);
  const Eigen::Ref<VectorX<Scalar>> values(value);
  if (collider_traits<C>::distance(collider, view, values) != QueryStatus::Answered)
    return scalar_traits<Scalar>::infinity();
  return out;
}

/// Writes the answer about one point; the default when the collider has none.
template <RealScalar Scalar, class C>
QueryStatus ask_closest(const C& collider, const Vector3<Scalar>& x, SurfacePoint<Scalar>& out) {
  const OnePoint<Scalar> point(x.data(), 3, 1);
  const PointsView<Scalar> view(point);
  out = {};
  const std::span<SurfacePoint<Scalar>> answers(&out, 1);
  const QueryStatus status = collider_traits<C>::closest(collider, view, answers);
  if (status != QueryStatus::Answered) out = {};
  return status;
}

/// Returns the answer about one point; the default when the collider has none.
template <RealScalar Scalar, class C>
SurfacePoint<Scalar> closest_of(const C& collider, const Vector3<Scalar>& x) {
  SurfacePoint<Scalar> out;
  (void)ask_closest<Scalar>(collider, x, out);
  return out;
}

/// Returns the time of impact of one ball; `no_impact()` when the collider has no answer.
template <RealScalar Scalar, class C>
Scalar sweep_of(const C& collider, const Vector3<Scalar>& from, const Vector3<Scalar>& to,
                const Scalar& radius, const Scalar& dt) {
  const OnePoint<Scalar> start(from.data(), 3, 1), end(to.data(), 3, 1);
  Scalar out = no_impact<Scalar>();
  Eigen::Map<VectorX<Scalar>> value(&out, 1);
  const PointsView<Scalar> start_view(start), end_view(end);
  const Eigen::Ref<VectorX<Scalar>> values(value);
  if (collider_traits<C>::sweep(collider, start_view, end_view, radius, dt, values) !=
      QueryStatus::Answered)
    return no_impact<Scalar>();
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
