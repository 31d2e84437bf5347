#pragma once

// The shapes of rigid bodies: sphere, capsule, box and convex hull, each about its centre of mass.
// A shape is a core and a radius r: all points within r of a point (sphere), a segment (capsule) or
// a polytope (box and hull, r = 0). Contacts of two shapes are those of their cores, r_A + r_B
// closer.
//
//   sphere   V = 4/3 π r³                  J = 2/5 m r²
//   capsule  a cylinder of length 2l and two halves of a ball, of masses m_c and m_s:
//            J_z = m_c r²/2 + 2/5 m_s r²
//            J_x = m_c (r²/4 + l²/3) + m_s (2/5 r² + l² + 3/4 l r)
//   box      V = 8 a b c                   J_x = m (b² + c²)/3
//   hull     by signed tetrahedra (detail/polytope.hpp)

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <variant>

#include "clothctl/collision/detail/polytope.hpp"
#include "clothctl/collision/mesh_collider.hpp"
#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/collision/shapes.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// What a convex shape is.
enum class ShapeKind {
  /// A ball about the origin.
  Sphere,
  /// A capsule along the z axis.
  Capsule,
  /// A box along the axes.
  Box,
  /// The convex hull of points.
  Hull
};

/// The shape of a rigid body, in the body's frame, whose origin is the centre of mass. Copies share
/// the corners. Reference: see the top of the header.
template <RealScalar Scalar>
class ConvexShape {
 public:
  /// A sphere of `radius` (m). Allocates. Fails when: the radius is not finite and positive.
  static Result<ConvexShape> sphere(const Scalar& radius);
  /// A capsule about the segment from (0, 0, -half_length) to (0, 0, half_length) (m). Allocates.
  /// Fails when: a length is not finite and positive.
  static Result<ConvexShape> capsule(const Scalar& half_length, const Scalar& radius);
  /// A box with half the edge lengths `half` (m). Allocates. Fails when: one is not finite and
  /// positive.
  static Result<ConvexShape> box(const Vector3<Scalar>& half);
  /// The convex hull of points (3×n, m), moved so that its centre of mass is the origin; `origin()`
  /// tells where it was. Allocates. Fails when: `HullCollider` refuses the points (flat, too few,
  /// not finite), or the hull has more than 64 corners.
  static Result<ConvexShape> hull(const PointsView<Scalar>& points);

  /// What it is.
  ShapeKind kind() const { return kind_; }
  /// The radius of a sphere or capsule, m; 0 for box and hull.
  const Scalar& radius() const { return radius_; }
  /// The core: one corner (sphere), two corners (capsule) or a polytope.
  const detail::Polytope<Scalar>& core() const { return *core_; }
  /// Volume, m³.
  const Scalar& volume() const { return moments_.volume; }
  /// Inertia about the centre of mass for a density of 1 kg/m³, kg m².
  const Matrix3<Scalar>& unit_inertia() const { return moments_.inertia; }
  /// Where the centre of mass was in the coordinates of the points of a hull, m; else 0.
  const Vector3<Scalar>& origin() const { return moments_.centre; }
  /// The radius of a ball about the origin inside of the shape, m.
  const Scalar& inner_radius() const { return inner_; }
  /// The radius of a ball about the origin that holds the shape, m.
  const Scalar& outer_radius() const { return outer_; }

  /// The box along the world's axes around the shape in a pose.
  BoundingBox<Scalar> bounds(const Matrix3<Scalar>& R_world_body,
                             const Vector3<Scalar>& position) const;

 private:
  using Core = detail::Polytope<Scalar>;

  ConvexShape(ShapeKind kind, const Scalar& radius, Core core,
              const detail::SolidMoments<Scalar>& moments);

  ShapeKind kind_;
  Scalar radius_, inner_, outer_;
  std::shared_ptr<const Core> core_;
  detail::SolidMoments<Scalar> moments_;
};

template <RealScalar Scalar>
ConvexShape<Scalar>::ConvexShape(ShapeKind kind, const Scalar& radius, Core core,
                                 const detail::SolidMoments<Scalar>& moments)
    : kind_(kind), radius_(radius), inner_(radius), outer_(radius), moments_(moments) {
  for (int i = 0; i < core.corner_count(); ++i) {
    const Scalar reach = radius + detail::length_of<Scalar>(core.corners.col(i));
    if (outer_ < reach) outer_ = reach;
  }
  for (int f = 0; f < core.face_count(); ++f) {
    if (f == 0 || core.offsets[f] < inner_) inner_ = core.offsets[f];
  }
  core_ = std::make_shared<const Core>(std::move(core));
}

template <RealScalar Scalar>
Result<ConvexShape<Scalar>> ConvexShape<Scalar>::sphere(const Scalar& radius) {
  const std::string bad = detail::validate_size<Scalar>("radius", radius);
  if (!bad.empty()) return Error{"the sphere has " + bad};
  Core core;
  core.corners.setConstant(3, 1, Scalar(0));
  detail::SolidMoments<Scalar> m;
  const Scalar pi = Scalar(3.14159265358979323846), square = radius * radius;
  m.volume = Scalar(4) / Scalar(3) * pi * square * radius;
  for (int i = 0; i < 3; ++i) m.inertia(i, i) = Scalar(0.4) * m.volume * square;
  return ConvexShape(ShapeKind::Sphere, radius, std::move(core), m);
}

template <RealScalar Scalar>
Result<ConvexShape<Scalar>> ConvexShape<Scalar>::capsule(const Scalar& half_length,
                                                         const Scalar& radius) {
  std::string bad = detail::validate_size<Scalar>("half length", half_length);
  if (bad.empty()) bad = detail::validate_size<Scalar>("radius", radius);
  if (!bad.empty()) return Error{"the capsule has " + bad};
  Core core;
  core.corners.setConstant(3, 2, Scalar(0));
  core.corners(2, 0) = -half_length;
  core.corners(2, 1) = half_length;
  detail::SolidMoments<Scalar> m;
  const Scalar pi = Scalar(3.14159265358979323846), square = radius * radius, l = half_length;
  const Scalar tube = pi * square * Scalar(2) * l,
               ball = Scalar(4) / Scalar(3) * pi * square * radius;
  m.volume = tube + ball;
  const Scalar across = tube * (square / Scalar(4) + l * l / Scalar(3)) +
                        ball * (Scalar(0.4) * square + l * l + Scalar(0.75) * l * radius);
  m.inertia(0, 0) = m.inertia(1, 1) = across;
  m.inertia(2, 2) = Scalar(0.5) * tube * square + Scalar(0.4) * ball * square;
  return ConvexShape(ShapeKind::Capsule, radius, std::move(core), m);
}

template <RealScalar Scalar>
Result<ConvexShape<Scalar>> ConvexShape<Scalar>::box(const Vector3<Scalar>& half) {
  std::string bad;
  for (int i = 0; i < 3 && bad.empty(); ++i)
    bad = detail::validate_size<Scalar>("half length", half[i]);
  if (!bad.empty()) return Error{"the box has " + bad};
  detail::SolidMoments<Scalar> m;
  m.volume = Scalar(8) * half[0] * half[1] * half[2];
  for (int i = 0; i < 3; ++i) {
    const Scalar b = half[(i + 1) % 3], c = half[(i + 2) % 3];
    m.inertia(i, i) = m.volume * (b * b + c * c) / Scalar(3);
  }
  return ConvexShape(ShapeKind::Box, Scalar(0), detail::box_polytope<Scalar>(half), m);
}

template <RealScalar Scalar>
Result<ConvexShape<Scalar>> ConvexShape<Scalar>::hull(const PointsView<Scalar>& points) {
  const Result<HullCollider<Scalar>> made = HullCollider<Scalar>::create(points);
  if (!made) return Error{made.error()};
  if (made->vertices().cols() > detail::kMostCorners)
    return Error{"the hull has " + std::to_string(made->vertices().cols()) +
                 " corners; a rigid body may have up to 64"};
  const detail::SolidMoments<Scalar> m =
      detail::solid_moments<Scalar>(made->vertices(), made->triangles());
  if (!is_finite(m.volume) || !(Scalar(0) < m.volume)) return Error{"the hull has no volume"};
  Points<Scalar> x = made->vertices();
  for (Index i = 0; i < x.cols(); ++i) x.col(i) -= m.centre;
  return ConvexShape(ShapeKind::Hull, Scalar(0),
                     detail::hull_polytope<Scalar>(x, made->triangles()), m);
}

template <RealScalar Scalar>
BoundingBox<Scalar> ConvexShape<Scalar>::bounds(const Matrix3<Scalar>& R_world_body,
                                                const Vector3<Scalar>& position) const {
  const Vector3<Scalar> first = R_world_body * core_->corners.col(0);
  BoundingBox<Scalar> box{first, first};
  for (int i = 1; i < core_->corner_count(); ++i) {
    const Vector3<Scalar> x = R_world_body * core_->corners.col(i);
    box.include(x);
  }
  const Vector3<Scalar> reach = Vector3<Scalar>::Constant(radius_);
  return {position + box.lower - reach, position + box.upper + reach};
}

/// A convex shape as a collider that moves, for sheets and sweeps.
template <RealScalar Scalar>
class MovingShape {
 public:
  /// Makes the shape move. Allocates. Fails when: see MovingCollider.
  static Result<MovingShape> create(const ConvexShape<Scalar>& shape,
                                    const RigidMotion<Scalar>& motion,
                                    const ColliderSurface<Scalar>& surface = {}) {
    const Points<Scalar>& x = shape.core().corners;
    switch (shape.kind()) {
      case ShapeKind::Sphere:
        return make(SphereCollider<Scalar>::create(x.col(0), shape.radius()), motion, surface);
      case ShapeKind::Capsule:
        return make(CapsuleCollider<Scalar>::create(x.col(0), x.col(1), shape.radius()), motion,
                    surface);
      case ShapeKind::Box: {
        const Vector3<Scalar> centre = Vector3<Scalar>::Constant(Scalar(0));
        return make(BoxCollider<Scalar>::create(centre, x.col(7)), motion, surface);
      }
      case ShapeKind::Hull: break;
    }
    return make(HullCollider<Scalar>::create(x), motion, surface);
  }

  /// Gives it the motion of the next step. Returns an empty string, or what is wrong.
  std::string set_motion(const RigidMotion<Scalar>& motion) {
    if (Sphere* s = std::get_if<Sphere>(&shape_)) return s->set_motion(motion);
    if (Capsule* s = std::get_if<Capsule>(&shape_)) return s->set_motion(motion);
    if (Box* s = std::get_if<Box>(&shape_)) return s->set_motion(motion);
    return std::get_if<Hull>(&shape_)->set_motion(motion);
  }
  /// The motion that it answers with.
  const RigidMotion<Scalar>& motion() const {
    return std::visit([](const auto& s) -> const RigidMotion<Scalar>& { return s.motion(); },
                      shape_);
  }
  /// Refers to the collider; valid while this lives where it is.
  ColliderRef<Scalar> collider() const {
    if (const Sphere* s = std::get_if<Sphere>(&shape_)) return ColliderRef<Scalar>(*s);
    if (const Capsule* s = std::get_if<Capsule>(&shape_)) return ColliderRef<Scalar>(*s);
    if (const Box* s = std::get_if<Box>(&shape_)) return ColliderRef<Scalar>(*s);
    return ColliderRef<Scalar>(*std::get_if<Hull>(&shape_));
  }

 private:
  using Sphere = MovingCollider<Scalar, SphereCollider<Scalar>>;
  using Capsule = MovingCollider<Scalar, CapsuleCollider<Scalar>>;
  using Box = MovingCollider<Scalar, BoxCollider<Scalar>>;
  using Hull = MovingCollider<Scalar, HullCollider<Scalar>>;
  using Shape = std::variant<Sphere, Capsule, Box, Hull>;

  explicit MovingShape(Shape&& shape) : shape_(std::move(shape)) {}
  template <class C>
  static Result<MovingShape> make(Result<C>&& shape, const RigidMotion<Scalar>& motion,
                                  const ColliderSurface<Scalar>& surface) {
    if (!shape) return Error{shape.error()};
    Result<MovingCollider<Scalar, C>> made =
        MovingCollider<Scalar, C>::create(std::move(*shape), motion, surface);
    if (!made) return Error{made.error()};
    return MovingShape(Shape(std::move(*made)));
  }

  Shape shape_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
