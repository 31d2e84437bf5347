#pragma once

// A collider that moves as a rigid body. With the pose (R, p) of the body's frame at the start of a
// step, the velocity v of its origin p and the angular velocity w, both constant during the step,
//
//   x_body(s) = R(s)ᵀ (x - p - s v),     R(s) = exp(s [w]) R     a point x seen after the time s
//   v + w × (q - p)                                              the material's velocity at q
//
// A point on a straight path in the world follows a curve in the body's frame. A sweep replaces the
// curve by k chords. The acceleration along the curve is at most a = |w| (2 |u - v| + |w| ρ), with
// u the velocity of the point and ρ its largest distance from the body's origin, so curve and chord
// differ by at most a (h/k)²/8. The ball is made larger by that, and k chosen so that it is at most
// 1e-5 of ρ + h |u - v|, or k is 128. Where a sweep is early, it is so by at most twice that
// length.

#include <cmath>
#include <string>
#include <utility>

#include "clothctl/collision/detail/basic_shape.hpp"
#include "clothctl/collision/detail/single_query.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/math/rotation.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// The pose and the velocity of a rigid body. The orientation may be a rotation to 1e-5 only, as
/// one from single precision; a collider makes it orthonormal.
template <RealScalar Scalar>
struct RigidMotion {
  /// Orientation of the body's frame.
  Matrix3<Scalar> R_world_body = Matrix3<Scalar>::Identity();
  /// Origin of the body's frame, m.
  Vector3<Scalar> position = Vector3<Scalar>::Constant(Scalar(0));
  /// Velocity of the origin, m/s.
  Vector3<Scalar> velocity = Vector3<Scalar>::Constant(Scalar(0));
  /// Angular velocity in world axes, rad/s.
  Vector3<Scalar> angular_velocity = Vector3<Scalar>::Constant(Scalar(0));

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    std::string bad = detail::validate_rotation("orientation", R_world_body);
    if (bad.empty()) bad = detail::validate_point("position", position);
    if (bad.empty()) bad = detail::validate_point("velocity", velocity);
    if (bad.empty()) bad = detail::validate_point("angular velocity", angular_velocity);
    return bad;
  }
};

/// A collider that moves as a rigid body; what moves is given in the body's frame and must rest
/// there. (Its surface may slide, as that of a belt does: its velocity is added.) It has one
/// friction coefficient and one body number, in place of those of `C`. Models Collider.
template <RealScalar Scalar, Collider<Scalar> C>
class MovingCollider : public detail::PointQueries<MovingCollider<Scalar, C>, Scalar> {
 public:
  /// Makes `shape` move. Fails when: a number is not finite, the orientation is no rotation, or the
  /// friction coefficient is negative.
  static Result<MovingCollider> create(C shape, const RigidMotion<Scalar>& motion,
                                       const ColliderSurface<Scalar>& surface = {}) {
    std::string bad = motion.validate();
    if (bad.empty()) bad = surface.validate();
    if (!bad.empty()) return Error{"the moving collider has " + bad};
    return MovingCollider(std::move(shape), motion, surface);
  }

  /// Gives it the motion of the next step. Returns an empty string, or what is wrong with the
  /// motion; nothing is changed then. Allocates only in the second case.
  std::string set_motion(const RigidMotion<Scalar>& motion) {
    std::string bad = motion.validate();
    if (!bad.empty()) return bad;
    motion_ = motion;
    motion_.R_world_body = detail::orthonormal_rotation<Scalar>(motion.R_world_body);
    return {};
  }
  /// Its motion.
  const RigidMotion<Scalar>& motion() const { return motion_; }
  /// What moves.
  const C& shape() const { return shape_; }
  /// Friction and body of the surface.
  const ColliderSurface<Scalar>& surface() const { return surface_; }

  /// Whether the shape is convex; false where it does not tell.
  bool is_convex() const {
    if constexpr (requires { collider_traits<C>::is_convex(shape_); })
      return collider_traits<C>::is_convex(shape_);
    else
      return false;
  }
  /// A box that holds the collider during a step of `dt` (s).
  BoundingBox<Scalar> bounds(const Scalar& dt) const;
  /// Returns the signed distance of a finite point, m.
  Scalar distance_at(const Vector3<Scalar>& x) const {
    return detail::distance_of<Scalar>(shape_, to_body(x));
  }
  /// Returns everything about the surface closest to a finite point. The distance is not a number
  /// where the shape does not answer.
  SurfacePoint<Scalar> closest_at(const Vector3<Scalar>& x) const;
  /// Returns the time of impact of a ball with a finite path.
  Scalar sweep_at(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& radius,
                  const Scalar& dt) const;

 private:
  MovingCollider(C&& shape, const RigidMotion<Scalar>& motion,
                 const ColliderSurface<Scalar>& surface)
      : shape_(std::move(shape)), motion_(motion), surface_(surface) {
    motion_.R_world_body = detail::orthonormal_rotation<Scalar>(motion.R_world_body);
  }

  Vector3<Scalar> to_body(const Vector3<Scalar>& x) const {
    return motion_.R_world_body.transpose() * Vector3<Scalar>(x - motion_.position);
  }

  C shape_;
  RigidMotion<Scalar> motion_;
  ColliderSurface<Scalar> surface_;
};

template <RealScalar Scalar, Collider<Scalar> C>
SurfacePoint<Scalar> MovingCollider<Scalar, C>::closest_at(const Vector3<Scalar>& x) const {
  const Vector3<Scalar> local = to_body(x);
  SurfacePoint<Scalar> out;
  if (detail::ask_closest<Scalar>(shape_, local, out) != QueryStatus::Answered) {
    out.distance -= out.distance;  // infinity less infinity: not a number
    return out;
  }
  const Matrix3<Scalar>& R = motion_.R_world_body;
  const Vector3<Scalar> arm = R * out.point;
  out.point = motion_.position + arm;
  out.normal = R * out.normal;
  out.velocity = motion_.velocity + motion_.angular_velocity.cross(arm) + R * out.velocity;
  out.friction = surface_.friction;
  out.body = surface_.body;
  return out;
}

template <RealScalar Scalar, Collider<Scalar> C>
BoundingBox<Scalar> MovingCollider<Scalar, C>::bounds(const Scalar& dt) const {
  using std::abs;
  using std::sqrt;
  const BoundingBox<Scalar> local = collider_traits<C>::bounds(shape_, Scalar(0));
  const Vector3<Scalar> middle = Scalar(0.5) * (local.lower + local.upper);
  const Vector3<Scalar> half = Scalar(0.5) * (local.upper - local.lower);
  const Vector3<Scalar> centre = motion_.position + motion_.R_world_body * middle;
  const Vector3<Scalar> reach = motion_.R_world_body.cwiseAbs() * half;
  BoundingBox<Scalar> box{centre - reach, centre + reach};
  const Vector3<Scalar> way = dt * motion_.velocity;
  const BoundingBox<Scalar> end{box.lower + way, box.upper + way};
  box.include(end);
  // A rotation by the angle θ moves a point at the distance ρ by at most min(θ, 2) ρ.
  const Scalar rho = sqrt(Scalar(3)) * detail::largest_coordinate<Scalar>(local.lower, local.upper);
  Scalar angle = dt * sqrt(motion_.angular_velocity.squaredNorm());
  if (Scalar(2) < angle) angle = Scalar(2);
  return Scalar(0) < angle ? box.grown(angle * rho) : box;
}

template <RealScalar Scalar, Collider<Scalar> C>
Scalar MovingCollider<Scalar, C>::sweep_at(const Vector3<Scalar>& from, const Vector3<Scalar>& to,
                                           const Scalar& radius, const Scalar& dt) const {
  using std::sqrt;
  constexpr int kMostChords = 128;
  const Vector3<Scalar> start = from - motion_.position;
  const Vector3<Scalar> end = to - motion_.position - dt * motion_.velocity;
  const Scalar way = sqrt(Vector3<Scalar>(end - start).squaredNorm());
  const Scalar angle = dt * sqrt(motion_.angular_velocity.squaredNorm());
  Scalar rho = sqrt(start.squaredNorm());
  if (rho < sqrt(end.squaredNorm())) rho = sqrt(end.squaredNorm());
  // The largest distance of the whole curve from a single chord.
  const Scalar whole = angle * (Scalar(2) * way + angle * rho) / Scalar(8);
  const Scalar allowed = Scalar(1e-5) * (rho + way);
  int chords = 1;
  while (chords < kMostChords && allowed * Scalar(static_cast<double>(chords * chords)) < whole)
    ++chords;
  const Scalar count = Scalar(static_cast<double>(chords));
  const Scalar grown = radius + whole / (count * count);
  Vector3<Scalar> a = motion_.R_world_body.transpose() * start;
  for (int k = 0; k < chords; ++k) {
    const Scalar share = Scalar(static_cast<double>(k + 1)) / count;
    const Vector3<Scalar> turn = (-share * dt) * motion_.angular_velocity;
    const Vector3<Scalar> at =
        rotation_exp<Scalar>(turn) * Vector3<Scalar>(start + share * (end - start));
    const Vector3<Scalar> b = motion_.R_world_body.transpose() * at;
    const Scalar t = detail::sweep_of<Scalar>(shape_, a, b, grown, Scalar(0));
    if (t <= Scalar(1)) return (Scalar(static_cast<double>(k)) + t) / count;
    a = b;
  }
  return no_impact<Scalar>();
}

}  // namespace clothctl::inline CLOTHCTL_ABI
