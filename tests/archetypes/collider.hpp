#pragma once

// The least type that satisfies Collider.

#include <span>

#include "clothctl/concepts/collider.hpp"

namespace clothctl_test {

/// A type with only what Collider names: the half-space below z = 0.
template <class Scalar>
class ColliderArchetype {
 public:
  explicit ColliderArchetype(int) {}
  ColliderArchetype(const ColliderArchetype&) = delete;
  ColliderArchetype& operator=(const ColliderArchetype&) = delete;

  clothctl::QueryStatus distance(const clothctl::PointsView<Scalar>& x,
                                 Eigen::Ref<clothctl::VectorX<Scalar>> out) const {
    if (out.size() != x.cols()) return clothctl::QueryStatus::InvalidArgument;
    for (clothctl::Index i = 0; i < x.cols(); ++i)
      out[i] = finite(x, i) ? x(2, i) : clothctl::scalar_traits<Scalar>::infinity();
    return status_of(x);
  }
  clothctl::QueryStatus closest(const clothctl::PointsView<Scalar>& x,
                                std::span<clothctl::SurfacePoint<Scalar>> out) const {
    if (static_cast<clothctl::Index>(out.size()) != x.cols())
      return clothctl::QueryStatus::InvalidArgument;
    for (clothctl::Index i = 0; i < x.cols(); ++i) {
      clothctl::SurfacePoint<Scalar>& s = out[static_cast<std::size_t>(i)];
      s = {};
      if (!finite(x, i)) continue;
      s.distance = x(2, i);
      s.point << x(0, i), x(1, i), Scalar(0);
      s.normal[2] = Scalar(1);
      s.body = 3;
    }
    return status_of(x);
  }
  clothctl::QueryStatus sweep(const clothctl::PointsView<Scalar>& from,
                              const clothctl::PointsView<Scalar>& to, const Scalar& radius,
                              const Scalar& dt, Eigen::Ref<clothctl::VectorX<Scalar>> out) const {
    const bool numbers = clothctl::is_finite(radius) && radius >= Scalar(0) &&
                         clothctl::is_finite(dt) && dt >= Scalar(0);
    if (!numbers || from.cols() != to.cols() || out.size() != to.cols())
      return clothctl::QueryStatus::InvalidArgument;
    for (clothctl::Index i = 0; i < from.cols(); ++i) {
      out[i] = clothctl::no_impact<Scalar>();
      if (!finite(from, i) || !finite(to, i)) continue;
      const Scalar above = from(2, i) - radius, end = to(2, i) - radius;
      if (above <= Scalar(0)) {
        out[i] = Scalar(0);
      } else if (end <= Scalar(0)) {
        out[i] = above / (above - end);
      }
    }
    const clothctl::QueryStatus first = status_of(from);
    return first == clothctl::QueryStatus::Answered ? status_of(to) : first;
  }
  /// A type that only converts to a box.
  struct Everywhere {
    operator clothctl::BoundingBox<Scalar>() const { return {}; }
  };
  Everywhere bounds(Scalar) const { return {}; }

 private:
  static bool finite(const clothctl::PointsView<Scalar>& x, clothctl::Index i) {
    return clothctl::all_finite(x.col(i));
  }
  static clothctl::QueryStatus status_of(const clothctl::PointsView<Scalar>& x) {
    return clothctl::all_finite(x) ? clothctl::QueryStatus::Answered
                                   : clothctl::QueryStatus::InvalidPoint;
  }
};

}  // namespace clothctl_test
