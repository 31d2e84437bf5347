#pragma once

// The batched queries of a collider, from its answers about one point: the lengths and numbers that
// a query may have, and what a point that is not finite gets.

#include <cstddef>
#include <span>
#include <string>

#include "clothctl/concepts/collider.hpp"
#include "clothctl/core/number_text.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// What the surface of a collider is like.
template <RealScalar Scalar>
struct ColliderSurface {
  /// Friction coefficient μ.
  Scalar friction = Scalar(0.5);
  /// The body that the surface belongs to, a number of the caller's.
  int body = 0;

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    if (is_finite(friction) && !(friction < Scalar(0))) return {};
    return "the friction coefficient " + number_text(friction) +
           ", must be finite and not negative";
  }
};

namespace detail {

/// The closest point of a surface and the signed distance from it.
template <RealScalar Scalar>
struct NearestPoint {
  Scalar distance;
  Vector3<Scalar> point, normal;
};

/// Base of a collider `Shape` that answers one point at a time, by the members `distance_at(x)`,
/// `closest_at(x)` and `sweep_at(from, to, radius, dt)`. They are called with finite numbers only.
template <class Shape, RealScalar Scalar>
class PointQueries {
 public:
  /// See `collider_traits::distance`.
  QueryStatus distance(const PointsView<Scalar>& points, Eigen::Ref<VectorX<Scalar>> out) const {
    if (out.size() != points.cols()) return QueryStatus::InvalidArgument;
    QueryStatus status = QueryStatus::Answered;
    for (Index i = 0; i < points.cols(); ++i) {
      const Vector3<Scalar> x = points.col(i);
      if (all_finite(x)) {
        out[i] = shape().distance_at(x);
      } else {
        out[i] = scalar_traits<Scalar>::infinity();
        status = QueryStatus::InvalidPoint;
      }
    }
    return status;
  }

  /// See `collider_traits::closest`.
  QueryStatus closest(const PointsView<Scalar>& points, std::span<SurfacePoint<Scalar>> out) const {
    if (static_cast<Index>(out.size()) != points.cols()) return QueryStatus::InvalidArgument;
    QueryStatus status = QueryStatus::Answered;
    for (Index i = 0; i < points.cols(); ++i) {
      const Vector3<Scalar> x = points.col(i);
      if (all_finite(x)) {
        out[static_cast<std::size_t>(i)] = shape().closest_at(x);
      } else {
        out[static_cast<std::size_t>(i)] = SurfacePoint<Scalar>();
        status = QueryStatus::InvalidPoint;
      }
    }
    return status;
  }

  /// See `collider_traits::sweep`.
  QueryStatus sweep(const PointsView<Scalar>& from, const PointsView<Scalar>& to,
                    const Scalar& radius, const Scalar& dt, Eigen::Ref<VectorX<Scalar>> out) const {
    const bool numbers =
        is_finite(radius) && !(radius < Scalar(0)) && is_finite(dt) && !(dt < Scalar(0));
    if (!numbers || to.cols() != from.cols() || out.size() != from.cols())
      return QueryStatus::InvalidArgument;
    QueryStatus status = QueryStatus::Answered;
    for (Index i = 0; i < from.cols(); ++i) {
      const Vector3<Scalar> a = from.col(i), b = to.col(i);
      if (all_finite(a) && all_finite(b)) {
        out[i] = shape().sweep_at(a, b, radius, dt);
      } else {
        out[i] = no_impact<Scalar>();
        status = QueryStatus::InvalidPoint;
      }
    }
    return status;
  }

 private:
  const Shape& shape() const { return static_cast<const Shape&>(*this); }
};

}  // namespace detail
}  // namespace clothctl::inline CLOTHCTL_ABI
