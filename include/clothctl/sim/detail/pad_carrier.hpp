#pragma once

// What carries pads: as a side of the problem that their contacts are solved in, and how it moves
// against a sheet.

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "clothctl/contact/impulse_responses.hpp"
#include "clothctl/sim/detail/world_parts.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A hand, whatever links of it carry pads, or else an obstacle or a body that carries one. A
/// carrier that no impulse moves has neither hand nor `rigid`.
template <RealScalar Scalar>
struct PadCarrier {
  int hand, carrier;
  std::vector<int> frames;
  Points<Scalar> points;
  Index count = 0;
  KinematicResponse<Scalar> kinematic;
  std::optional<RigidBodyResponse<Scalar>> rigid;

  /// Makes that of a hand (-1: none), or else of an obstacle or, as -1 - b, of body b.
  static PadCarrier make(const WorldParts<Scalar>& parts, int hand, int carrier) {
    PadCarrier out{hand, carrier, {}, {}, 0, KinematicResponse<Scalar>(), {}};
    const int body = -1 - carrier;
    if (body >= 0 && Scalar(0) < parts.bodies.mass(body))
      out.rigid =
          RigidBodyResponse<Scalar>::create(parts.bodies.mass(body), parts.bodies.inertia(body))
              .value();
    return out;
  }
  /// The motion of an obstacle, or of a body.
  static RigidMotion<Scalar> motion(const WorldParts<Scalar>& parts, int carrier) {
    if (carrier < 0) return parts.bodies.motion(-1 - carrier);
    return parts.obstacles[static_cast<std::size_t>(carrier)]->motion();
  }

  /// Makes room for `most` points. Allocates.
  void reserve(WorldParts<Scalar>& parts, std::size_t most) {
    points = Points<Scalar>::Constant(3, static_cast<Index>(most), Scalar(0));
    frames.reserve(most);
    kinematic = KinematicResponse<Scalar>(static_cast<Index>(most));
    if (hand >= 0) parts.hands[static_cast<std::size_t>(hand)]->reserve(static_cast<Index>(most));
    if (rigid) (void)rigid->set_points(points);  // makes room
  }
  /// Takes its motion and the first `count` points. Returns false where it refuses.
  bool attach(WorldParts<Scalar>& parts) {
    const auto now = points.leftCols(count);
    if (hand >= 0)
      return parts.hands[static_cast<std::size_t>(hand)]->attach(frames, now) ==
             ArticulatedStatus::Updated;
    const RigidMotion<Scalar> moves = motion(parts, carrier);
    if (rigid) {
      parts.bodies.wake(-1 - carrier);
      return rigid->set_motion(moves).empty() && rigid->set_points(now) == QueryStatus::Answered;
    }
    return kinematic.set_motion(moves).empty() &&
           kinematic.set_points(now) == QueryStatus::Answered;
  }
  /// Its answer to impulses.
  ImpulseResponseRef<Scalar> side(WorldParts<Scalar>& parts) {
    if (hand >= 0) return parts.hands[static_cast<std::size_t>(hand)]->side();
    if (rigid) return ImpulseResponseRef<Scalar>(*rigid);
    return ImpulseResponseRef<Scalar>(kinematic);
  }
};

/// Whether a contact of a sheet with a pad was closed, or closes in a step of `dt` s as the sheet
/// and the carrier of the pad move now.
template <RealScalar Scalar>
bool closes(const ContactSample<Scalar>& c, const ClothState<Scalar>& sheet,
            const RigidMotion<Scalar>& carrier, const Scalar& dt) {
  if (c.state != ContactState::Open) return true;
  Vector3<Scalar> place = Vector3<Scalar>::Constant(Scalar(0)), velocity = place;
  for (std::size_t k = 0; k < 3; ++k) {
    place += c.a.weight[static_cast<Index>(k)] * sheet.positions.col(c.a.point[k]);
    velocity += c.a.weight[static_cast<Index>(k)] * sheet.velocities.col(c.a.point[k]);
  }
  const Vector3<Scalar> arm = place - carrier.position;
  velocity -= carrier.velocity + carrier.angular_velocity.cross(arm);
  return c.gap + dt * c.normal.dot(velocity) < Scalar(0);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
