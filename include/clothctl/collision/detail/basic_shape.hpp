#pragma once

// What the basic shapes have in common: they rest, are convex, and have one surface.

#include <cmath>
#include <string>

#include "clothctl/collision/detail/convex_sweep.hpp"
#include "clothctl/collision/detail/direction.hpp"
#include "clothctl/core/number_text.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Base of a shape at rest. `Shape` has `nearest(x)`, the NearestPoint of x, and is convex.
template <class Shape, RealScalar Scalar>
class BasicShape : public PointQueries<Shape, Scalar> {
 public:
  /// Friction and body of the surface.
  const ColliderSurface<Scalar>& surface() const { return surface_; }
  /// Always true.
  bool is_convex() const { return true; }

  /// See PointQueries.
  Scalar distance_at(const Vector3<Scalar>& x) const { return shape().nearest(x).distance; }
  SurfacePoint<Scalar> closest_at(const Vector3<Scalar>& x) const {
    const NearestPoint<Scalar> near_x = shape().nearest(x);
    SurfacePoint<Scalar> out;
    out.distance = near_x.distance;
    out.point = near_x.point;
    out.normal = near_x.normal;
    out.friction = surface_.friction;
    out.body = surface_.body;
    return out;
  }
  Scalar sweep_at(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& radius,
                  const Scalar&) const {
    return convex_sweep<Scalar>([this](const Vector3<Scalar>& x) { return shape().nearest(x); },
                                from, to, radius);
  }

 protected:
  explicit BasicShape(const ColliderSurface<Scalar>& surface) : surface_(surface) {}

 private:
  const Shape& shape() const { return static_cast<const Shape&>(*this); }

  ColliderSurface<Scalar> surface_;
};

/// Returns an empty string, or what is wrong with a length that must be positive.
template <RealScalar Scalar>
std::string validate_size(const char* name, const Scalar& value) {
  if (is_finite(value) && Scalar(0) < value && !is_unbounded(value)) return {};
  return std::string("the ") + name + " " + number_text(value) + " m, must be finite and positive" +
         unbounded_text(value);
}

/// Returns an empty string, or the coordinate that is not finite. `name` is the point's.
template <RealScalar Scalar>
std::string validate_point(const char* name, const Vector3<Scalar>& x) {
  for (int i = 0; i < 3; ++i) {
    if (!is_finite(x[i]) || is_unbounded(x[i]))
      return std::string("the ") + name + " with the coordinate " + std::to_string(i) + " = " +
             number_text(x[i]) + ", must be finite" + unbounded_text(x[i]);
  }
  return {};
}

/// Returns an empty string, or why R is not a rotation to 1e-5, which a pose from single precision
/// is. `name` is the rotation's.
template <RealScalar Scalar>
std::string validate_rotation(const char* name, const Matrix3<Scalar>& R) {
  using std::abs;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      if (is_finite(R(i, j))) continue;
      return std::string("the ") + name + " with the entry (" + std::to_string(i) + ", " +
             std::to_string(j) + ") = " + number_text(R(i, j)) + ", must be finite";
    }
  }
  const Matrix3<Scalar> product = R.transpose() * R;
  Scalar worst(0);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      const Scalar off = abs(product(i, j) - (i == j ? Scalar(1) : Scalar(0)));
      if (worst < off) worst = off;
    }
  }
  if (Scalar(1e-5) < worst)
    return std::string("the ") + name + " with columns that are off by " + number_text(worst) +
           ", must be a rotation";
  const Vector3<Scalar> x = R.col(0), y = R.col(1), z = R.col(2);
  if (x.cross(y).dot(z) < Scalar(0))
    return std::string("the ") + name + " of a reflection, must be a rotation";
  return {};
}

/// Returns the rotation near R whose columns are orthonormal to rounding: its first column keeps
/// its direction.
template <RealScalar Scalar>
Matrix3<Scalar> orthonormal_rotation(const Matrix3<Scalar>& R) {
  const Vector3<Scalar> x = unit_or_zero<Scalar>(R.col(0)), y = R.col(1);
  Matrix3<Scalar> out;
  out.col(0) = x;
  out.col(1) = unit_or_zero<Scalar>(y - x.dot(y) * x);
  out.col(2) = x.cross(Vector3<Scalar>(out.col(1)));
  return out;
}

/// Returns a unit vector that is orthogonal to the unit vector `u`.
template <RealScalar Scalar>
Vector3<Scalar> unit_orthogonal(const Vector3<Scalar>& u) {
  using std::abs;
  using std::sqrt;
  int least = 0;
  for (int i = 1; i < 3; ++i) {
    if (abs(u[i]) < abs(u[least])) least = i;
  }
  Vector3<Scalar> side = Vector3<Scalar>::Constant(Scalar(0));
  side[least] = Scalar(1);
  side -= u[least] * u;
  return side / sqrt(side.squaredNorm());
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
