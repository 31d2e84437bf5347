#pragma once

// What of a hand touches: capsules on its links, and the pads of its fingertips. One description
// serves the world, where capsules become obstacles and pads become soft pads, and the planner of
// paths (robot_clearance.hpp).

#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/shapes.hpp"
#include "clothctl/grasp/grasp_poses.hpp"
#include "clothctl/grasp/robot_clearance.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "clothctl/sim/world.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The shape of a hand.
template <RealScalar Scalar>
struct HandGeometry {
  /// Its links.
  std::vector<LinkCapsule<Scalar>> capsules;
  /// Its fingertips. The pad of a finger is on the capsule of its frame that is closest to it.
  std::vector<FingerPad<Scalar>> fingers;

  /// Returns the number of the finger with this name, or -1.
  int find_finger(const std::string& name) const {
    for (std::size_t i = 0; i < fingers.size(); ++i) {
      if (fingers[i].name == name) return static_cast<int>(i);
    }
    return -1;
  }
};

/// Returns the shape of `hand34`, or of a larger robot that contains it: its capsules, and pads on
/// thumb, index, middle, ring and little finger. Parts whose links `tree` does not have are left
/// out. Allocates.
template <RealScalar Scalar>
HandGeometry<Scalar> hand34_geometry(const KinematicTree<Scalar>& tree) {
  HandGeometry<Scalar> out;
  for (const Capsule<Scalar>& c : hand34_capsules<Scalar>()) {
    if (const int link = tree.find_link(c.link); link >= 0)
      out.capsules.push_back({link, c.from, c.to, c.radius});
  }
  for (const FingerTip<Scalar>& tip : hand34_tips<Scalar>()) {
    if (const int link = tree.find_link(tip.contact_link); link >= 0)
      out.fingers.push_back({tip.finger, link, tip.contact_point, {}});
  }
  for (FingerPad<Scalar>& f : out.fingers) {
    f.normal = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-1));
    f.radius = -f.point[2];  // a point of the capsule of its bone, which lies on the x axis
  }
  return out;
}

/// Returns positions (nq) of a `hand34` that pinches (hand34_pinch) at `place` (m, world): the line
/// from its thumb to its index is along `axis`, and its palm faces `approach`, as far as that is
/// across the axis. Where the directions are within 0.6 degrees of parallel or not finite, or
/// `tree` is no whole hand34, the base stays where hand34_pinch has it. Allocates.
template <RealScalar Scalar>
VectorX<Scalar> hand34_pinch_at(const KinematicTree<Scalar>& tree, const Vector3<Scalar>& place,
                                const Vector3<Scalar>& axis, const Vector3<Scalar>& approach) {
  using std::sqrt;
  using Traits = articulated_traits<KinematicTree<Scalar>>;
  using Vec = Vector3<Scalar>;
  const Vec origin(Scalar(0), Scalar(0), Scalar(0)), palm(Scalar(0), Scalar(0), Scalar(-1));
  VectorX<Scalar> given = hand34_pinch(tree);
  VectorX<Scalar> q = given;
  const Scalar product = axis.dot(approach);
  const Scalar most = Scalar(0.9999) * axis.squaredNorm() * approach.squaredNorm();
  if (!is_finite(most) || !(product * product < most)) return given;
  if (!hand34_place_base<Scalar>(tree, Matrix3<Scalar>::Identity(), origin, q)) return given;
  const HandGeometry<Scalar> hand = hand34_geometry(tree);
  const int thumb = hand.find_finger("thumb"), index = hand.find_finger("index");
  if (thumb < 0 || index < 0) return given;
  auto work = Traits::make_workspace(tree);
  Traits::forward_kinematics(tree, q, work);
  const auto tip = [&](int finger) {
    Matrix3<Scalar> R;
    Vec p;
    const FingerPad<Scalar>& f = hand.fingers[static_cast<std::size_t>(finger)];
    Traits::frame_pose(tree, work, f.frame, R, p);
    return Vec(p + R * f.centre());
  };
  const auto frame = [](const Vec& x, const Vec& along) {
    const Vec a = x / sqrt(x.squaredNorm());
    Vec b = along - along.dot(a) * a;
    b /= sqrt(b.squaredNorm());
    Matrix3<Scalar> out;
    out.col(0) = a;
    out.col(1) = b;
    out.col(2) = a.cross(b);
    return out;
  };
  const Vec from = tip(thumb), to = tip(index);
  const Matrix3<Scalar> R = frame(axis, approach) * frame(to - from, palm).transpose();
  (void)hand34_place_base<Scalar>(tree, R, Vec(place - R * (Scalar(0.5) * (from + to))), q);
  return q;
}

/// The samples of a fingertip's pad.
template <RealScalar Scalar>
struct FingertipSamples {
  /// Radius of the outermost ring along the surface, m; at most 1.5 times that of a round one.
  Scalar radius = Scalar(6e-3);
  /// Rings of 4, 8, 12, … samples; with more than one also a sample in the middle.
  int rings = 2;

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    if (!is_finite(radius) || !(Scalar(0) < radius))
      return "the radius " + number_text(radius) + " m, must be finite and positive";
    if (rings < 1 || rings > 16) return std::to_string(rings) + " rings, must be 1 to 16";
    return {};
  }
};

/// Returns samples around the middle of a finger's pad, in the finger's frame. Allocates. Fails
/// when: `shape.validate()` does, or point or normal are not finite or the normal is zero.
template <RealScalar Scalar>
Result<std::vector<PadSample<Scalar>>> fingertip_samples(
    const FingerPad<Scalar>& finger, const FingertipSamples<Scalar>& shape = {}) {
  using std::cos;
  using std::sin;
  using std::sqrt;
  if (const std::string bad = shape.validate(); !bad.empty())
    return Error{"the pad of finger " + finger.name + " has " + bad};
  const Scalar square = finger.normal.squaredNorm();
  if (!all_finite(finger.point) || !is_finite(square) || !(Scalar(0) < square))
    return Error{"finger " + finger.name + " has a point or a normal that cannot be"};
  if (!is_finite(finger.radius) || finger.radius < Scalar(0))
    return Error{"finger " + finger.name + " has the radius " + number_text(finger.radius) +
                 " m, must be finite and not negative"};
  const Vector3<Scalar> n = finger.normal / sqrt(square);
  // Any two directions across the normal: the first across the axis it leans to least.
  Index least = 0;
  for (Index i = 1; i < 3; ++i) {
    if (n[i] * n[i] < n[least] * n[least]) least = i;
  }
  Vector3<Scalar> u = n.cross(Vector3<Scalar>(Vector3<Scalar>::Unit(least)));
  u /= sqrt(u.squaredNorm());
  const Vector3<Scalar> v = n.cross(u);
  std::vector<PadSample<Scalar>> out;
  if (shape.rings > 1) out.push_back({finger.point, n});
  const Scalar pi = Scalar(3.14159265358979323846), R = finger.radius;
  const bool flat = !(Scalar(0) < R);
  Scalar outermost = shape.radius;
  if (!flat && Scalar(1.5) * R < outermost) outermost = Scalar(1.5) * R;
  for (int ring = 1; ring <= shape.rings; ++ring) {
    const Scalar way = outermost * Scalar(ring) / Scalar(shape.rings);
    const Scalar angle = flat ? Scalar(0) : Scalar(way / R);
    const Scalar out_by = flat ? way : Scalar(R * sin(angle));
    const Scalar down_by = flat ? Scalar(0) : Scalar(R - R * cos(angle));
    for (int k = 0; k < 4 * ring; ++k) {
      const Scalar turn = (Scalar(k) + Scalar(0.5)) * pi / Scalar(2 * ring);
      const Vector3<Scalar> across = cos(turn) * u + sin(turn) * v;
      const Vector3<Scalar> normal = cos(angle) * n + sin(angle) * across;
      out.push_back({finger.point - down_by * n + out_by * across, normal});
    }
  }
  return out;
}

/// Where a hand and its parts are in a world.
struct HandInWorld {
  /// The hand.
  int hand = -1;
  /// The obstacle that each capsule is.
  std::vector<int> shapes;
  /// For each finger the obstacle that carries its pad, and the pad; -1 where it has none.
  std::vector<int> segments, pads;
};

/// Of what the parts of a hand are made (add_hand_geometry).
template <RealScalar Scalar>
struct HandSurface {
  /// Its pads. The stiffness is that of all samples, of which half touch.
  PadSettings<Scalar> pad = default_pad();
  /// Their samples.
  FingertipSamples<Scalar> samples = {};
  /// Friction of everything else.
  ColliderSurface<Scalar> links = {};
  /// The fingers (numbers) that get pads; empty for all. The links of others touch with their whole
  /// capsules.
  std::vector<int> with_pads = {};

  /// Returns the defaults of `pad`.
  static PadSettings<Scalar> default_pad() {
    PadSettings<Scalar> pad;
    pad.stiffness = pad.tangential_stiffness = Scalar(10000);
    return pad;
  }
};

/// Adds the shape of hand `hand` to a world: each capsule as an obstacle on its link, and the pads.
/// Allocates. Fails when: the hand does not exist, a capsule or a pad is not valid, a finger with a
/// pad has no capsule on its frame, or there are no fingers. The world is then as it was.
template <RealScalar Scalar>
Result<HandInWorld> add_hand_geometry(World<Scalar>& world, int hand,
                                      const HandGeometry<Scalar>& geometry,
                                      const HandSurface<Scalar>& surface = {}) {
  HandInWorld out;
  out.hand = hand;
  if (geometry.fingers.empty()) return Error{"the hand has no finger pads"};
  out.segments.assign(geometry.fingers.size(), -1);
  out.pads.assign(geometry.fingers.size(), -1);
  // Everything is checked before anything is added.
  std::vector<CapsuleCollider<Scalar>> shapes;
  for (std::size_t i = 0; i < geometry.capsules.size(); ++i) {
    const LinkCapsule<Scalar>& c = geometry.capsules[i];
    const std::string name = "capsule " + std::to_string(i) + ": ";
    auto shape = CapsuleCollider<Scalar>::create(c.from, c.to, c.radius);
    if (!shape) return Error{name + shape.error()};
    if (std::string bad = world.check_link_shape(hand, c.frame, surface.links); !bad.empty())
      return Error{name + bad};
    shapes.push_back(std::move(shape).value());
  }
  std::vector<int> wanted = surface.with_pads;
  for (std::size_t f = 0; wanted.size() < geometry.fingers.size() && surface.with_pads.empty(); ++f)
    wanted.push_back(static_cast<int>(f));
  std::vector<std::vector<PadSample<Scalar>>> samples;
  for (const int f : wanted) {
    if (f < 0 || static_cast<std::size_t>(f) >= geometry.fingers.size())
      return Error{"there is no finger " + std::to_string(f)};
    const FingerPad<Scalar>& finger = geometry.fingers[static_cast<std::size_t>(f)];
    int& segment = out.segments[static_cast<std::size_t>(f)];
    if (segment >= 0) return Error{"finger " + finger.name + " gets two pads"};
    Scalar least = scalar_traits<Scalar>::infinity();
    for (std::size_t i = 0; i < geometry.capsules.size(); ++i) {
      const LinkCapsule<Scalar>& c = geometry.capsules[i];
      const Scalar far_away =
          detail::offset_from_segment<Scalar>(c.from, c.to, finger.point).squaredNorm();
      if (c.frame != finger.frame || !(far_away < least)) continue;
      least = far_away;
      segment = static_cast<int>(i);
    }
    if (segment < 0) return Error{"finger " + finger.name + " has no capsule on its frame"};
    auto of_finger = fingertip_samples<Scalar>(finger, surface.samples);
    if (!of_finger) return Error{of_finger.error()};
    std::string bad = validate_pad_samples<Scalar>(*of_finger);
    if (bad.empty()) bad = surface.pad.validate();
    if (!bad.empty()) return Error{"finger " + finger.name + ": the pad has " + bad};
    samples.push_back(std::move(of_finger).value());
  }
  for (std::size_t i = 0; i < shapes.size(); ++i)
    out.shapes.push_back(
        world.add_link_shape(hand, geometry.capsules[i].frame, std::move(shapes[i]), surface.links)
            .value());
  for (std::size_t k = 0; k < wanted.size(); ++k) {
    const std::size_t f = static_cast<std::size_t>(wanted[k]);
    out.segments[f] = out.shapes[static_cast<std::size_t>(out.segments[f])];
    out.pads[f] = world.add_pad(out.segments[f], std::move(samples[k]), surface.pad).value();
  }
  return out;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(HandGeometry<double> hand34_geometry(const KinematicTree<double>&));
CLOTHCTL_INSTANTIATE(VectorX<double> hand34_pinch_at(const KinematicTree<double>&,
                                                     const Vector3<double>&, const Vector3<double>&,
                                                     const Vector3<double>&));
CLOTHCTL_INSTANTIATE(Result<HandInWorld> add_hand_geometry(World<double>&, int,
                                                           const HandGeometry<double>&,
                                                           const HandSurface<double>&));

}  // namespace clothctl::inline CLOTHCTL_ABI
