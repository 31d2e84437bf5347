#pragma once

// The points of a segment and of a triangle in space that are closest to a given point.

#include <array>
#include <cstddef>

#include "clothctl/core/types.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// A point on a triangle.
template <RealScalar Scalar>
struct PointOnTriangle {
  /// The triangle of a mesh, for who looks at several; -1: none.
  int triangle = -1;
  /// The weights of the corners. On an edge or a corner, those of the other corners are exactly
  /// zero.
  std::array<Scalar, 3> weights{};
  /// Squared distance from the given point, m².
  Scalar squared_distance = Scalar(0);
};

/// Returns the point of the segment a-b that is closest to `p` (m), as its share of the way from a
/// to b, in [0, 1]. Never allocates.
template <RealScalar Scalar>
Scalar closest_on_segment(const Vector3<Scalar>& p, const Vector3<Scalar>& a,
                          const Vector3<Scalar>& b) {
  const Vector3<Scalar> d = b - a;
  const Scalar length = d.squaredNorm(), along = d.dot(p - a);
  if (!(Scalar(0) < along)) return Scalar(0);
  return along < length ? along / length : Scalar(1);
}

/// Returns the point of the triangle with corners `x` (m) that is closest to `p` (m): its
/// projection if that is inside, else the closest point of the three sides. Never allocates.
template <RealScalar Scalar>
PointOnTriangle<Scalar> closest_on_triangle(const Vector3<Scalar>& p,
                                            const std::array<Vector3<Scalar>, 3>& x) {
  PointOnTriangle<Scalar> best;
  const Vector3<Scalar> normal = (x[1] - x[0]).cross(x[2] - x[0]);
  const Scalar size = normal.squaredNorm();
  bool inside = Scalar(0) < size;
  for (std::size_t i = 0; i < 3 && inside; ++i) {
    const Vector3<Scalar>&a = x[(i + 1) % 3], &b = x[(i + 2) % 3];
    best.weights[i] = normal.dot((b - a).cross(p - a)) / size;
    inside = Scalar(0) < best.weights[i];
  }
  const auto place = [&] {
    return Vector3<Scalar>(best.weights[0] * x[0] + best.weights[1] * x[1] +
                           best.weights[2] * x[2]);
  };
  if (inside) {
    best.squared_distance = (place() - p).squaredNorm();
    return best;
  }
  for (std::size_t i = 0; i < 3; ++i) {
    const Vector3<Scalar>&a = x[(i + 1) % 3], &b = x[(i + 2) % 3];
    const Scalar t = closest_on_segment(p, a, b);
    const Scalar squared = (a + t * (b - a) - p).squaredNorm();
    if (i > 0 && !(squared < best.squared_distance)) continue;
    best.weights[i] = Scalar(0);
    best.weights[(i + 1) % 3] = Scalar(1) - t;
    best.weights[(i + 2) % 3] = t;
    best.squared_distance = squared;
  }
  return best;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
