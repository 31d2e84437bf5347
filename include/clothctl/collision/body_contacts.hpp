#pragma once

// Where a rigid body touches another one, or an obstacle: points, normals and gaps, also of bodies
// that are apart by up to a margin. Pairs of convex shapes are exact (detail/polytope_contacts.hpp,
// detail/rounded_contacts.hpp); any other collider is asked about points of the body
// (detail/collider_contacts.hpp).

#include <cstdint>

#include "clothctl/collision/convex_shape.hpp"
#include "clothctl/collision/detail/collider_contacts.hpp"
#include "clothctl/collision/detail/rounded_contacts.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Returns the core of a sphere or capsule in a pose.
template <RealScalar Scalar>
RoundedSegment<Scalar> posed_segment(const ConvexShape<Scalar>& shape, const Matrix3<Scalar>& R,
                                     const Vector3<Scalar>& position) {
  const Polytope<Scalar>& core = shape.core();
  const Vector3<Scalar> a = R * core.corners.col(0);
  Vector3<Scalar> u = Vector3<Scalar>::Constant(Scalar(0));
  if (core.corner_count() > 1) u = R * Vector3<Scalar>(core.corners.col(1) - core.corners.col(0));
  return {position + a, u, shape.radius()};
}

}  // namespace detail

/// Returns the points of the contact of shape A, which has the pose (R_a, p_a), and shape B whose
/// gap is at most `margin` (m, not negative). Up to 4. For shapes that are apart the gap is at most
/// their distance. Deterministic; never allocates. Needs finite poses.
template <RealScalar Scalar>
BodyContacts<Scalar> find_body_contacts(const ConvexShape<Scalar>& A, const Matrix3<Scalar>& R_a,
                                        const Vector3<Scalar>& p_a, const ConvexShape<Scalar>& B,
                                        const Matrix3<Scalar>& R_b, const Vector3<Scalar>& p_b,
                                        const Scalar& margin) {
  BodyContacts<Scalar> out;
  const Scalar size = A.inner_radius() < B.inner_radius() ? A.inner_radius() : B.inner_radius();
  const bool round_a = A.core().face_count() == 0, round_b = B.core().face_count() == 0;
  const Vector3<Scalar> origin = Vector3<Scalar>::Constant(Scalar(0)), apart = p_b - p_a;
  if (round_a && round_b) {
    detail::segment_contacts<Scalar>(detail::posed_segment<Scalar>(A, R_a, origin),
                                     detail::posed_segment<Scalar>(B, R_b, apart), margin, out);
  } else if (round_a) {
    const detail::PosedPolytope<Scalar> P(B.core(), R_b, apart);
    const detail::RoundedSegment<Scalar> S = detail::posed_segment<Scalar>(A, R_a, origin);
    detail::SegmentOnPolytope<Scalar>(S, P).add(margin, size, false, out);
  } else if (round_b) {
    const detail::PosedPolytope<Scalar> P(A.core(), R_a, origin);
    const detail::RoundedSegment<Scalar> S = detail::posed_segment<Scalar>(B, R_b, apart);
    detail::SegmentOnPolytope<Scalar>(S, P).add(margin, size, true, out);
  } else {
    const detail::PosedPolytope<Scalar> P(A.core(), R_a, origin), Q(B.core(), R_b, apart);
    detail::polytope_contacts<Scalar>(P, Q, margin, size, out);
  }
  for (int i = 0; i < out.count; ++i) out.points[static_cast<std::size_t>(i)].position += p_a;
  return out;
}

/// Returns the points of the contact of a shape, which has the pose (R, p), and a collider whose
/// gap is at most `margin` (m, not negative). Up to 8; normals point to the shape. The parts of a
/// union are asked one by one. The shape's inside is known by its surface only: a collider that
/// lies wholly within a box, touching no edge and no face, is not found. Never allocates. Needs a
/// finite pose.
template <RealScalar Scalar>
BodyContacts<Scalar> find_collider_contacts(const ConvexShape<Scalar>& shape,
                                            const Matrix3<Scalar>& R, const Vector3<Scalar>& p,
                                            const ColliderRef<Scalar>& collider,
                                            const Scalar& margin) {
  BodyContacts<Scalar> out;
  const detail::PosedPolytope<Scalar> body(shape.core(), R, p);
  const auto find = [&](const ColliderRef<Scalar>& part, std::uint32_t label) {
    detail::ColliderContacts<Scalar, ColliderRef<Scalar>>(body, shape.radius(), part, margin)
        .find(shape.outer_radius(), label, out);
  };
  const Index parts = collider.part_count();
  if (parts == 0) find(collider, 0);
  for (Index i = 0; i < parts; ++i) find(collider.part(i), static_cast<std::uint32_t>(i + 1) << 10);
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
