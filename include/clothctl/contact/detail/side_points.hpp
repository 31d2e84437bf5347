#pragma once

// The points of a rigid side at which impulses may act, and the inverse of an inertia.

#include <cassert>
#include <cmath>

#include "clothctl/concepts/collider.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Points of a side. The memory only grows.
template <RealScalar Scalar>
class SidePoints {
 public:
  explicit SidePoints(Index capacity) : x_(Points<Scalar>::Constant(3, capacity, Scalar(0))) {}

  /// Takes the points (3×n, m). InvalidPoint: one is not finite; nothing is changed then.
  QueryStatus set(const PointsView<Scalar>& x) {
    if (!all_finite(x)) return QueryStatus::InvalidPoint;
    if (x_.cols() < x.cols()) x_.resize(3, x.cols());
    count_ = x.cols();
    x_.leftCols(count_) = x;
    return QueryStatus::Answered;
  }
  Index count() const { return count_; }
  Vector3<Scalar> at(Index i) const { return x_.col(i); }

  /// Writes v + w × (x_i - p) for each point (3n, m/s).
  void rigid_velocities(const Vector3<Scalar>& p, const Vector3<Scalar>& v,
                        const Vector3<Scalar>& w, Eigen::Ref<VectorX<Scalar>> u) const {
    assert(u.size() == 3 * count_);
    for (Index i = 0; i < count_; ++i) {
      const Vector3<Scalar> r = at(i) - p;
      u.template segment<3>(3 * i) = v + w.cross(r);
    }
  }

 private:
  Points<Scalar> x_;
  Index count_ = 0;
};

/// Writes the inverse of an inertia (kg m²). Returns false when the inertia is not finite, not
/// symmetric to 1e-5 of its largest entry, or not positive definite.
template <RealScalar Scalar>
bool invert_inertia(const Matrix3<Scalar>& inertia, Matrix3<Scalar>& inverse) {
  using std::abs;
  if (!all_finite(inertia)) return false;
  const Matrix3<Scalar> J = Scalar(0.5) * (inertia + inertia.transpose());
  Scalar largest(0), skew(0);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      if (largest < abs(J(i, j))) largest = abs(J(i, j));
      if (skew < abs(inertia(i, j) - J(i, j))) skew = abs(inertia(i, j) - J(i, j));
    }
  }
  if (Scalar(1e-5) * largest < skew) return false;
  const Vector3<Scalar> a = J.col(0), b = J.col(1), c = J.col(2);
  const Vector3<Scalar> bc = b.cross(c), ca = c.cross(a), ab = a.cross(b);
  const Scalar det = a.dot(bc), tiny = scalar_traits<Scalar>::epsilon();
  const bool positive = Scalar(0) < J(0, 0) && Scalar(0) < ab[2] &&
                        Scalar(8) * tiny * largest * largest * largest < det;
  if (!positive) return false;
  Matrix3<Scalar> out;
  out.col(0) = bc / det;
  out.col(1) = ca / det;
  out.col(2) = ab / det;
  inverse = Scalar(0.5) * (out + out.transpose());
  return all_finite(inverse);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
