#pragma once

// The basic shapes that a sheet may touch: half-space, sphere, capsule, box and cylinder. All are
// convex and at rest; `MovingCollider` moves them. Their signed distances are exact (d < 0 inside):
//
//   half-space   d = n·x - o
//   sphere       d = |x - c| - r
//   capsule      d = |x - s(x)| - r, s(x) the closest point of the segment
//   box          with y = Rᵀ(x - c), e = |y| - half:  d = |max(e, 0)| + min(max(e_1, e_2, e_3), 0)
//   cylinder     the same in the plane of its axis: e = (√(y_1² + y_2²) - r, |y_3| - half)

#include <cmath>
#include <string>
#include <utility>

#include "clothctl/contact/detail/basic_shape.hpp"
#include "clothctl/core/result.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// All that lies on one side of a plane: a floor or a wall, infinitely thick. Models Collider.
template <RealScalar Scalar>
class PlaneCollider : public detail::BasicShape<PlaneCollider<Scalar>, Scalar> {
 public:
  /// Makes the half-space below a plane through `point` (m). `normal` points out of the solid; its
  /// length does not matter. Fails when: a number is not finite, the normal is zero, or the
  /// friction coefficient is negative.
  static Result<PlaneCollider> create(const Vector3<Scalar>& point, const Vector3<Scalar>& normal,
                                      const ColliderSurface<Scalar>& surface = {}) {
    using std::sqrt;
    std::string bad = detail::validate_point("point", point);
    if (bad.empty()) bad = detail::validate_point("normal", normal);
    const Scalar length = sqrt(normal.squaredNorm());
    if (bad.empty()) bad = detail::validate_size("normal of length", length);
    if (bad.empty()) bad = surface.validate();
    if (!bad.empty()) return Error{"the plane has " + bad};
    return PlaneCollider(point, normal / length, surface);
  }

  /// Returns the closest point of the plane.
  detail::NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const {
    const Scalar d = normal_.dot(Vector3<Scalar>(x - point_));
    return {d, x - d * normal_, normal_};
  }
  /// The half-space has no bound, so neither has the box.
  BoundingBox<Scalar> bounds(const Scalar&) const {
    BoundingBox<Scalar> box;
    for (int i = 0; i < 3; ++i) {  // a plane across an axis has one bound
      if (normal_[i] == Scalar(1)) box.upper[i] = point_[i];
      if (normal_[i] == Scalar(-1)) box.lower[i] = point_[i];
    }
    return box;
  }

 private:
  PlaneCollider(const Vector3<Scalar>& point, const Vector3<Scalar>& normal,
                const ColliderSurface<Scalar>& surface)
      : detail::BasicShape<PlaneCollider, Scalar>(surface), point_(point), normal_(normal) {}

  Vector3<Scalar> point_, normal_;
};

/// A capsule: all points within `radius` of a segment. A finger, an arm. Models Collider.
template <RealScalar Scalar>
class CapsuleCollider : public detail::BasicShape<CapsuleCollider<Scalar>, Scalar> {
 public:
  /// Makes a capsule about the segment from `a` to `b` (m), which may be one point. Fails when: a
  /// number is not finite, the radius is not positive, or the friction coefficient is negative.
  static Result<CapsuleCollider> create(const Vector3<Scalar>& a, const Vector3<Scalar>& b,
                                        const Scalar& radius,
                                        const ColliderSurface<Scalar>& surface = {}) {
    std::string bad = detail::validate_point("end a", a);
    if (bad.empty()) bad = detail::validate_point("end b", b);
    if (bad.empty()) bad = detail::validate_size("radius", radius);
    if (bad.empty()) bad = surface.validate();
    if (!bad.empty()) return Error{"the capsule has " + bad};
    return CapsuleCollider(a, b, radius, surface);
  }

  /// Returns the closest point of the surface; for a point on the axis one of them.
  detail::NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const {
    using std::sqrt;
    const Vector3<Scalar> from_a = x - a_;
    Scalar share = from_a.dot(axis_) * inverse_square_;
    if (share < Scalar(0)) share = Scalar(0);
    if (Scalar(1) < share) share = Scalar(1);
    const Vector3<Scalar> centre = a_ + share * axis_, out = x - centre;
    const Scalar length = sqrt(out.squaredNorm());
    const Vector3<Scalar> normal =
        Scalar(0) < length ? Vector3<Scalar>(out / length) : Vector3<Scalar>(side_);
    return {length - radius_, centre + radius_ * normal, normal};
  }
  /// The box of the capsule.
  BoundingBox<Scalar> bounds(const Scalar&) const {
    BoundingBox<Scalar> box{a_, a_};
    box.include(Vector3<Scalar>(a_ + axis_));
    return box.grown(radius_);
  }

 private:
  CapsuleCollider(const Vector3<Scalar>& a, const Vector3<Scalar>& b, const Scalar& radius,
                  const ColliderSurface<Scalar>& surface)
      : detail::BasicShape<CapsuleCollider, Scalar>(surface),
        a_(a),
        axis_(b - a),
        side_(Scalar(0), Scalar(0), Scalar(1)),
        radius_(radius),
        inverse_square_(Scalar(0)) {
    using std::sqrt;
    const Scalar square = axis_.squaredNorm();
    if (!(Scalar(0) < square)) return;
    inverse_square_ = Scalar(1) / square;
    side_ = detail::unit_orthogonal<Scalar>(axis_ / sqrt(square));
  }

  Vector3<Scalar> a_, axis_;
  /// The normal of points on the axis.
  Vector3<Scalar> side_;
  Scalar radius_;
  /// 1/|axis|², 0 for a capsule that is a ball.
  Scalar inverse_square_;
};

/// A ball. Models Collider.
template <RealScalar Scalar>
class SphereCollider : public detail::BasicShape<SphereCollider<Scalar>, Scalar> {
 public:
  /// Makes a ball about `centre` (m). Fails when: a number is not finite, the radius is not
  /// positive, or the friction coefficient is negative.
  static Result<SphereCollider> create(const Vector3<Scalar>& centre, const Scalar& radius,
                                       const ColliderSurface<Scalar>& surface = {}) {
    std::string bad = detail::validate_point("centre", centre);
    if (bad.empty()) bad = detail::validate_size("radius", radius);
    if (bad.empty()) bad = surface.validate();
    if (!bad.empty()) return Error{"the sphere has " + bad};
    return SphereCollider(centre, radius, surface);
  }

  /// Returns the closest point of the surface; the top for the centre.
  detail::NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const {
    using std::sqrt;
    const Vector3<Scalar> out = x - centre_;
    const Scalar length = sqrt(out.squaredNorm());
    Vector3<Scalar> normal(Scalar(0), Scalar(0), Scalar(1));
    if (Scalar(0) < length) normal = out / length;
    return {length - radius_, centre_ + radius_ * normal, normal};
  }
  /// The box of the ball.
  BoundingBox<Scalar> bounds(const Scalar&) const {
    return BoundingBox<Scalar>{centre_, centre_}.grown(radius_);
  }

 private:
  SphereCollider(const Vector3<Scalar>& centre, const Scalar& radius,
                 const ColliderSurface<Scalar>& surface)
      : detail::BasicShape<SphereCollider, Scalar>(surface), centre_(centre), radius_(radius) {}

  Vector3<Scalar> centre_;
  Scalar radius_;
};

/// A box in any orientation. Models Collider.
template <RealScalar Scalar>
class BoxCollider : public detail::BasicShape<BoxCollider<Scalar>, Scalar> {
 public:
  /// Makes a box about `centre` (m) with half the edge lengths `half` (m) along the columns of
  /// `R_world_box`. Fails when: a number is not finite, a half length is not positive, the matrix
  /// is no rotation, or the friction coefficient is negative.
  static Result<BoxCollider> create(
      const Vector3<Scalar>& centre, const Vector3<Scalar>& half,
      const Matrix3<Scalar>& R_world_box = Matrix3<Scalar>::Identity(),
      const ColliderSurface<Scalar>& surface = {}) {
    std::string bad = detail::validate_point("centre", centre);
    const char* const names[] = {"half length along x", "half length along y",
                                 "half length along z"};
    for (int i = 0; i < 3 && bad.empty(); ++i) bad = detail::validate_size(names[i], half[i]);
    if (bad.empty()) bad = detail::validate_rotation("orientation", R_world_box);
    if (bad.empty()) bad = surface.validate();
    if (!bad.empty()) return Error{"the box has " + bad};
    return BoxCollider(centre, half, detail::orthonormal_rotation<Scalar>(R_world_box), surface);
  }

  /// Returns the closest point of the surface; inside, on the closest face.
  detail::NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const {
    using std::abs;
    using std::sqrt;
    const Vector3<Scalar> y = R_.transpose() * Vector3<Scalar>(x - centre_);
    Vector3<Scalar> closest = y;
    int face = 0;
    Scalar outside(0);
    for (int i = 0; i < 3; ++i) {
      if (half_[i] < y[i]) closest[i] = half_[i];
      if (y[i] < -half_[i]) closest[i] = -half_[i];
      outside += (y[i] - closest[i]) * (y[i] - closest[i]);
      if (abs(y[face]) - half_[face] < abs(y[i]) - half_[i]) face = i;
    }
    if (Scalar(0) < outside) {
      const Scalar d = sqrt(outside);
      const Vector3<Scalar> normal = (y - closest) / d;
      return {d, centre_ + R_ * closest, R_ * normal};
    }
    const Scalar sign = y[face] < Scalar(0) ? Scalar(-1) : Scalar(1);
    closest[face] = sign * half_[face];
    return {abs(y[face]) - half_[face], centre_ + R_ * closest, sign * R_.col(face)};
  }
  /// The box along the axes around this one.
  BoundingBox<Scalar> bounds(const Scalar&) const {
    const Vector3<Scalar> reach = R_.cwiseAbs() * half_;
    return {centre_ - reach, centre_ + reach};
  }

 private:
  BoxCollider(const Vector3<Scalar>& centre, const Vector3<Scalar>& half, const Matrix3<Scalar>& R,
              const ColliderSurface<Scalar>& surface)
      : detail::BasicShape<BoxCollider, Scalar>(surface), centre_(centre), half_(half), R_(R) {}

  Vector3<Scalar> centre_, half_;
  Matrix3<Scalar> R_;
};

/// A cylinder with flat ends. Models Collider.
template <RealScalar Scalar>
class CylinderCollider : public detail::BasicShape<CylinderCollider<Scalar>, Scalar> {
 public:
  /// Makes a cylinder between the centres `a` and `b` of its ends (m). Fails when: a number is not
  /// finite, radius or length is not positive, or the friction coefficient is negative.
  static Result<CylinderCollider> create(const Vector3<Scalar>& a, const Vector3<Scalar>& b,
                                         const Scalar& radius,
                                         const ColliderSurface<Scalar>& surface = {}) {
    using std::sqrt;
    std::string bad = detail::validate_point("end a", a);
    if (bad.empty()) bad = detail::validate_point("end b", b);
    const Scalar length = sqrt(Vector3<Scalar>(b - a).squaredNorm());
    if (bad.empty()) bad = detail::validate_size("length", length);
    if (bad.empty()) bad = detail::validate_size("radius", radius);
    if (bad.empty()) bad = surface.validate();
    if (!bad.empty()) return Error{"the cylinder has " + bad};
    return CylinderCollider(a, b, radius, surface);
  }

  /// Returns the closest point of the surface; for a point on the axis one of them.
  detail::NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const {
    using std::abs;
    using std::sqrt;
    const Vector3<Scalar> y = x - centre_;
    const Scalar z = axis_.dot(y), sign = z < Scalar(0) ? Scalar(-1) : Scalar(1);
    Vector3<Scalar> radial = y - z * axis_;
    radial -= axis_.dot(radial) * axis_;  // far along the axis, the first difference is rounding
    const Scalar s = sqrt(radial.squaredNorm());
    const Vector3<Scalar> side =
        Scalar(0) < s ? Vector3<Scalar>(radial / s) : Vector3<Scalar>(side_);
    const Scalar beyond_side = s - radius_, beyond_end = abs(z) - half_;
    if (Scalar(0) < beyond_side && Scalar(0) < beyond_end) {
      const Scalar d = sqrt(beyond_side * beyond_side + beyond_end * beyond_end);
      return {d, centre_ + radius_ * side + sign * half_ * axis_,
              (beyond_side / d) * side + (sign * beyond_end / d) * axis_};
    }
    if (beyond_side < beyond_end)
      return {beyond_end, centre_ + radial + sign * half_ * axis_, sign * axis_};
    return {beyond_side, centre_ + radius_ * side + z * axis_, side};
  }
  /// The box of the cylinder.
  BoundingBox<Scalar> bounds(const Scalar&) const {
    using std::abs;
    using std::sqrt;
    Vector3<Scalar> reach;
    for (int i = 0; i < 3; ++i) {
      const Scalar rest = Scalar(1) - axis_[i] * axis_[i];
      reach[i] = half_ * abs(axis_[i]) + radius_ * (Scalar(0) < rest ? sqrt(rest) : Scalar(0));
    }
    return {centre_ - reach, centre_ + reach};
  }

 private:
  CylinderCollider(const Vector3<Scalar>& a, const Vector3<Scalar>& b, const Scalar& radius,
                   const ColliderSurface<Scalar>& surface)
      : detail::BasicShape<CylinderCollider, Scalar>(surface),
        centre_(Scalar(0.5) * (a + b)),
        axis_(b - a),
        radius_(radius) {
    using std::sqrt;
    const Scalar length = sqrt(axis_.squaredNorm());
    axis_ /= length;
    half_ = Scalar(0.5) * length;
    side_ = detail::unit_orthogonal<Scalar>(axis_);
  }

  Vector3<Scalar> centre_, axis_;
  /// The normal of points on the axis.
  Vector3<Scalar> side_;
  Scalar radius_, half_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
