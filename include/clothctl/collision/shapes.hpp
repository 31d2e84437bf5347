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

#include "clothctl/collision/detail/basic_shape.hpp"
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
    std::string bad = detail::validate_point("point", point);
    if (bad.empty()) bad = detail::validate_point("normal", normal);
    const detail::Direction<Scalar> out = detail::direction_of<Scalar>(normal, normal);
    if (bad.empty()) bad = detail::validate_size("normal of length", out.length);
    if (bad.empty()) bad = surface.validate();
    if (!bad.empty()) return Error{"the plane has " + bad};
    return PlaneCollider(point, out.unit, surface);
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
    Scalar along = axis_.dot(Vector3<Scalar>(x - a_));
    if (along < Scalar(0)) along = Scalar(0);
    if (length_ < along) along = length_;
    const Vector3<Scalar> centre = a_ + along * axis_;
    const detail::Direction<Scalar> out = detail::direction_of<Scalar>(x - centre, side_);
    return {out.length - radius_, centre + radius_ * out.unit, out.unit};
  }
  /// The box of the capsule.
  BoundingBox<Scalar> bounds(const Scalar&) const {
    BoundingBox<Scalar> box{a_, a_};
    box.include(Vector3<Scalar>(a_ + length_ * axis_));
    return box.grown(radius_);
  }

 private:
  CapsuleCollider(const Vector3<Scalar>& a, const Vector3<Scalar>& b, const Scalar& radius,
                  const ColliderSurface<Scalar>& surface)
      : detail::BasicShape<CapsuleCollider, Scalar>(surface),
        a_(a),
        axis_(Scalar(1), Scalar(0), Scalar(0)),
        radius_(radius) {
    const detail::Direction<Scalar> way = detail::direction_of<Scalar>(b - a, axis_);
    axis_ = way.unit;
    length_ = way.length;
    side_ = detail::unit_orthogonal<Scalar>(axis_);
  }

  /// One end, and the unit vector towards the other; any for a capsule that is a ball.
  Vector3<Scalar> a_, axis_;
  /// The normal of points on the axis.
  Vector3<Scalar> side_;
  Scalar radius_, length_;
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
    const Vector3<Scalar> top(Scalar(0), Scalar(0), Scalar(1));
    const detail::Direction<Scalar> out = detail::direction_of<Scalar>(x - centre_, top);
    return {out.length - radius_, centre_ + radius_ * out.unit, out.unit};
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
    const Vector3<Scalar> y = R_.transpose() * Vector3<Scalar>(x - centre_);
    Vector3<Scalar> closest = y;
    int face = 0;
    for (int i = 0; i < 3; ++i) {
      if (half_[i] < y[i]) closest[i] = half_[i];
      if (y[i] < -half_[i]) closest[i] = -half_[i];
      if (abs(y[face]) - half_[face] < abs(y[i]) - half_[i]) face = i;
    }
    if (half_[face] < abs(y[face])) {
      const detail::Direction<Scalar> out = detail::direction_of<Scalar>(y - closest, y);
      return {out.length, centre_ + R_ * closest, R_ * out.unit};
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
    std::string bad = detail::validate_point("end a", a);
    if (bad.empty()) bad = detail::validate_point("end b", b);
    const Scalar length = detail::length_of<Scalar>(b - a);
    if (bad.empty()) bad = detail::validate_size("length", length);
    if (bad.empty()) bad = detail::validate_size("radius", radius);
    if (bad.empty()) bad = surface.validate();
    if (!bad.empty()) return Error{"the cylinder has " + bad};
    return CylinderCollider(a, b, radius, surface);
  }

  /// Returns the closest point of the surface; for a point on the axis one of them.
  detail::NearestPoint<Scalar> nearest(const Vector3<Scalar>& x) const {
    using std::abs;
    const Vector3<Scalar> y = x - centre_;
    const Scalar z = axis_.dot(y), sign = z < Scalar(0) ? Scalar(-1) : Scalar(1);
    Vector3<Scalar> radial = y - z * axis_;
    radial -= axis_.dot(radial) * axis_;  // far along the axis, the first difference is rounding
    const auto [s, side] = detail::direction_of<Scalar>(radial, side_);
    const Scalar beyond_side = s - radius_, beyond_end = abs(z) - half_;
    if (Scalar(0) < beyond_side && Scalar(0) < beyond_end) {
      const Vector3<Scalar> beyond(beyond_side, sign * beyond_end, Scalar(0));
      const auto [d, part] = detail::direction_of<Scalar>(beyond, beyond);
      return {d, centre_ + radius_ * side + sign * half_ * axis_, part[0] * side + part[1] * axis_};
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
      // Not √(1 - axis_i²), which is all rounding for an axis that is nearly along i.
      const Scalar y = axis_[(i + 1) % 3], z = axis_[(i + 2) % 3];
      reach[i] = half_ * abs(axis_[i]) + radius_ * sqrt(y * y + z * z);
    }
    return {centre_ - reach, centre_ + reach};
  }

 private:
  CylinderCollider(const Vector3<Scalar>& a, const Vector3<Scalar>& b, const Scalar& radius,
                   const ColliderSurface<Scalar>& surface)
      : detail::BasicShape<CylinderCollider, Scalar>(surface),
        centre_(Scalar(0.5) * (a + b)),
        radius_(radius) {
    const detail::Direction<Scalar> way = detail::direction_of<Scalar>(b - a, b - a);
    axis_ = way.unit;
    half_ = Scalar(0.5) * way.length;
    side_ = detail::unit_orthogonal<Scalar>(axis_);
  }

  Vector3<Scalar> centre_, axis_;
  /// The normal of points on the axis.
  Vector3<Scalar> side_;
  Scalar radius_, half_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
