#pragma once

// A right hand of 34 joints: a base that slides along x, y, z and turns about z, y, x, a wrist of two, four fingers of five
// (metacarpal, knuckle sideways, then three that curl) and a thumb of six. At q = 0 the fingers point along +x, the palm faces
// -z and the thumb lies on the +y side; positive flexion curls to the palm, positive abduction turns to the thumb's side.
//
// Bones are capsules: cylinders of length L along x with half balls of radius r at both ends, of density ρ,
//
//   m_c = ρ π r² L,  m_s = 4/3 ρ π r³,  m = m_c + m_s,  centre L/2
//   I_along = m_c r²/2 + 2/5 m_s r²,  I_across = m_c (L²/12 + r²/4) + m_s (2/5 r² + L²/4 + 3/8 L r)
//
// The palm is a box. Links between joints that share a point weigh little, but not nothing: the mass matrix stays definite.

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/robot/tree_builder.hpp"

namespace clothctl::robot {

/// All points within a radius of a segment, on a link.
template <RealScalar Scalar>
struct Capsule {
  /// The link that carries it.
  std::string link;
  /// One end of the segment, in the link's frame (m).
  Vector3<Scalar> from;
  /// The other end; the same for a ball.
  Vector3<Scalar> to;
  /// The radius (m).
  Scalar radius;
};

/// Where a finger touches.
template <RealScalar Scalar>
struct FingerTip {
  /// The finger: thumb, index, middle, ring or little.
  std::string finger;
  /// The link whose frame stands at the contact point.
  std::string link;
  /// The last bone.
  std::string contact_link;
  /// The contact point on its pad, in the last bone's frame (m).
  Vector3<Scalar> contact_point;
};

namespace hand34_detail {

inline constexpr double kDensity = 1100.0;  // kg/m³

/// Length between joints and radius (m).
struct Bone {
  double length, radius;
};

/// Contact point of a finger's pad: how far along the last bone, and how far from its axis, on the palm's side (m).
struct Pad {
  double reach, depth;
};

/// A finger of four bones: where it stands on the palm (m), how far it splays and how far the palm may arch there (rad).
struct Finger {
  const char* name;
  double side, splay, arch;
  std::array<Bone, 4> bones;
  Pad pad;
};

inline constexpr std::array<Finger, 4> kFingers{
    {{"index", 0.025, 0.06, 0.06, {{{0.045, 0.009}, {0.044, 0.0092}, {0.026, 0.0088}, {0.016, 0.008}}}, {0.018, 0.0068}},
     {"middle", 0.003, 0.0, 0.05, {{{0.045, 0.009}, {0.048, 0.0094}, {0.031, 0.0088}, {0.0168, 0.0082}}}, {0.019, 0.00697}},
     {"ring", -0.0175, -0.06, 0.2, {{{0.042, 0.009}, {0.044, 0.009}, {0.029, 0.0084}, {0.0172, 0.0078}}}, {0.019, 0.00663}},
     {"little", -0.0365, -0.13, 0.4, {{{0.036, 0.0085}, {0.035, 0.0082}, {0.02, 0.0076}, {0.016, 0.007}}}, {0.017, 0.00595}}}};
inline constexpr std::array<const char*, 4> kBoneNames{"_metacarpal", "_proximal", "_middle", "_distal"};

inline constexpr std::array<Bone, 3> kThumb{{{0.046, 0.0125}, {0.034, 0.011}, {0.022, 0.01}}};
inline constexpr std::array<const char*, 3> kThumbNames{"thumb_metacarpal", "thumb_proximal", "thumb_distal"};
inline constexpr Pad kThumbPad{0.024, 0.0085};

/// How a joint moves and how far, how strong and how fast.
struct Move {
  JointType type;
  int axis;
  double lower, upper, effort, velocity;
};

template <RealScalar Scalar>
Vector3<Scalar> vector(double x, double y, double z) {
  return Vector3<Scalar>(Scalar(x), Scalar(y), Scalar(z));
}

/// A place, turned by roll, pitch and yaw: Rz Ry Rx.
template <RealScalar Scalar>
Pose<Scalar> at(double x, double y = 0.0, double z = 0.0, double yaw = 0.0, double pitch = 0.0, double roll = 0.0) {
  using std::cos;
  using std::sin;
  const Scalar cz = cos(Scalar(yaw)), sz = sin(Scalar(yaw)), cy = cos(Scalar(pitch)), sy = sin(Scalar(pitch));
  const Scalar cx = cos(Scalar(roll)), sx = sin(Scalar(roll)), zero(0), one(1);
  Matrix3<Scalar> Rz, Ry, Rx;
  Rz << cz, -sz, zero, sz, cz, zero, zero, zero, one;
  Ry << cy, zero, sy, zero, one, zero, -sy, zero, cy;
  Rx << one, zero, zero, zero, cx, -sx, zero, sx, cx;
  Pose<Scalar> pose;
  pose.R = Rz * Ry * Rx;
  pose.p = vector<Scalar>(x, y, z);
  return pose;
}

template <RealScalar Scalar>
Inertia<Scalar> small_body(double mass, double moment) {
  Inertia<Scalar> body;
  body.mass = Scalar(mass);
  body.about_com.diagonal().setConstant(Scalar(moment));
  return body;
}

/// A capsule from the origin along x.
template <RealScalar Scalar>
Inertia<Scalar> capsule_body(const Bone& bone) {
  const Scalar L = Scalar(bone.length), r = Scalar(bone.radius), density = Scalar(kDensity);
  const Scalar area = Scalar(std::numbers::pi) * r * r;
  const Scalar cylinder = density * area * L, ball = density * area * r * Scalar(4) / Scalar(3);
  Inertia<Scalar> body;
  body.mass = cylinder + ball;
  body.com = Vector3<Scalar>(Scalar(0.5) * L, Scalar(0), Scalar(0));
  const Scalar along = r * r * (cylinder / Scalar(2) + ball * Scalar(2) / Scalar(5));
  const Scalar across = cylinder * (L * L / Scalar(12) + r * r / Scalar(4)) +
                        ball * (r * r * Scalar(2) / Scalar(5) + L * L / Scalar(4) + L * r * Scalar(3) / Scalar(8));
  body.about_com.diagonal() = Vector3<Scalar>(along, across, across);
  return body;
}

/// A box about a centre.
template <RealScalar Scalar>
Inertia<Scalar> box_body(double mass, const Vector3<Scalar>& sides, const Vector3<Scalar>& centre) {
  Inertia<Scalar> body;
  body.mass = Scalar(mass);
  body.com = centre;
  const Vector3<Scalar> s = sides.cwiseProduct(sides) * (Scalar(mass) / Scalar(12));
  body.about_com.diagonal() = Vector3<Scalar>(s[1] + s[2], s[0] + s[2], s[0] + s[1]);
  return body;
}

template <RealScalar Scalar>
Vector3<Scalar> point_of(const Pad& pad) {
  return vector<Scalar>(pad.reach, 0.0, -pad.depth);
}

/// Adds links, each with the joint that moves it.
template <RealScalar Scalar>
class Assembly {
 public:
  TreeBuilder<Scalar> robot;

  void add(const std::string& name, const std::string& parent, const std::string& child, const Pose<Scalar>& origin,
           const Move& move, const Inertia<Scalar>& inertia) {
    Joint<Scalar> joint = between(name, move.type, parent, child, origin);
    joint.axis = Vector3<Scalar>::Constant(Scalar(0));
    joint.axis[move.axis] = Scalar(1);
    joint.limits = {Scalar(move.lower), Scalar(move.upper), Scalar(move.velocity), Scalar(move.effort)};
    robot.add_link(child, inertia).add_joint(joint);
  }
  /// A frame at the contact point of a finger's pad.
  void add_tip(const std::string& finger, const Pad& pad) {
    Pose<Scalar> origin;
    origin.p = point_of<Scalar>(pad);
    robot.add_link(finger + "_tip");
    robot.add_joint(between(finger + "_tip_fixed", JointType::Fixed, finger + "_distal", finger + "_tip", origin));
  }

 private:
  static Joint<Scalar> between(const std::string& name, JointType type, const std::string& parent, const std::string& child,
                               const Pose<Scalar>& origin) {
    Joint<Scalar> joint;
    joint.name = name;
    joint.type = type;
    joint.parent = parent;
    joint.child = child;
    joint.origin = origin;
    return joint;
  }
};

template <RealScalar Scalar>
void add_base_and_palm(Assembly<Scalar>& hand) {
  constexpr JointType kSlide = JointType::Prismatic, kTurn = JointType::Revolute;
  const Pose<Scalar> here;
  const Inertia<Scalar> carriage = small_body<Scalar>(0.05, 2e-5), gimbal = small_body<Scalar>(0.02, 1e-5);
  hand.robot.add_link("world");
  hand.add("base_tx", "world", "carriage_x", here, {kSlide, 0, -1.5, 1.5, 250.0, 3.0}, carriage);
  hand.add("base_ty", "carriage_x", "carriage_y", here, {kSlide, 1, -1.5, 1.5, 250.0, 3.0}, carriage);
  hand.add("base_tz", "carriage_y", "carriage_z", here, {kSlide, 2, -1.5, 1.5, 250.0, 3.0}, carriage);
  hand.add("base_rz", "carriage_z", "gimbal_z", here, {kTurn, 2, -3.1, 3.1, 40.0, 6.0}, gimbal);
  hand.add("base_ry", "gimbal_z", "gimbal_y", here, {kTurn, 1, -1.45, 1.45, 40.0, 6.0}, gimbal);
  Inertia<Scalar> forearm = capsule_body<Scalar>(Bone{0.1, 0.027});
  forearm.com = vector<Scalar>(-0.06, 0.0, 0.0);
  hand.add("base_rx", "gimbal_y", "forearm", here, {kTurn, 0, -3.1, 3.1, 40.0, 6.0}, forearm);
  hand.add("wrist_dev", "forearm", "carpus_a", here, {kTurn, 2, -0.52, 0.35, 12.0, 8.0}, small_body<Scalar>(0.03, 6e-6));
  hand.add("wrist_flex", "carpus_a", "palm", here, {kTurn, 1, -1.2, 1.3, 12.0, 8.0},
           box_body<Scalar>(0.2, vector<Scalar>(0.05, 0.066, 0.026), vector<Scalar>(0.03, 0.002, 0.0)));
}

/// The knuckles undo the splay of the metacarpals: at rest the fingers are parallel.
template <RealScalar Scalar>
void add_finger(Assembly<Scalar>& hand, const Finger& finger) {
  constexpr JointType kTurn = JointType::Revolute;
  const std::string name = finger.name;
  const auto origin = [&](std::size_t bone) { return at<Scalar>(finger.bones[bone].length); };
  const auto body = [&](std::size_t bone) { return capsule_body<Scalar>(finger.bones[bone]); };
  const auto link = [&](std::size_t bone) { return name + kBoneNames[bone]; };
  hand.add(name + "_cmc", "palm", link(0), at<Scalar>(0.046, finger.side, 0.0, finger.splay),
           {kTurn, 1, 0.0, finger.arch, 8.0, 6.0}, body(0));
  hand.add(name + "_mcp_abd", link(0), name + "_knuckle", at<Scalar>(finger.bones[0].length, 0.0, 0.0, -finger.splay),
           {kTurn, 2, -0.35, 0.35, 3.0, 10.0}, small_body<Scalar>(0.004, 3e-7));
  hand.add(name + "_mcp_flex", name + "_knuckle", link(1), at<Scalar>(0.0), {kTurn, 1, -0.5, 1.57, 5.0, 10.0}, body(1));
  hand.add(name + "_pip", link(1), link(2), origin(1), {kTurn, 1, 0.0, 1.8, 4.0, 10.0}, body(2));
  hand.add(name + "_dip", link(2), link(3), origin(2), {kTurn, 1, -0.1, 1.4, 2.0, 10.0}, body(3));
  hand.add_tip(name, finger.pad);
}

template <RealScalar Scalar>
void add_thumb(Assembly<Scalar>& hand) {
  constexpr JointType kTurn = JointType::Revolute;
  const Inertia<Scalar> saddle = small_body<Scalar>(0.004, 4e-7), knuckle = small_body<Scalar>(0.004, 3e-7);
  const auto body = [](std::size_t bone) { return capsule_body<Scalar>(kThumb[bone]); };
  const Pose<Scalar> here, root = at<Scalar>(0.014, 0.026, -0.01, 0.75, 0.35, -1.05);
  hand.add("thumb_cmc_abd", "palm", "thumb_cmc_a", root, {kTurn, 2, -0.35, 0.9, 6.0, 8.0}, saddle);
  hand.add("thumb_cmc_flex", "thumb_cmc_a", "thumb_cmc_b", here, {kTurn, 1, -0.6, 0.9, 6.0, 8.0}, saddle);
  hand.add("thumb_cmc_rot", "thumb_cmc_b", kThumbNames[0], here, {kTurn, 0, -0.5, 0.5, 4.0, 8.0}, body(0));
  hand.add("thumb_mcp_abd", kThumbNames[0], "thumb_knuckle", at<Scalar>(kThumb[0].length), {kTurn, 2, -0.25, 0.25, 3.0, 8.0},
           knuckle);
  hand.add("thumb_mcp_flex", "thumb_knuckle", kThumbNames[1], here, {kTurn, 1, -0.2, 1.0, 4.0, 10.0}, body(1));
  hand.add("thumb_ip", kThumbNames[1], kThumbNames[2], at<Scalar>(kThumb[1].length), {kTurn, 1, -0.3, 1.4, 3.0, 10.0}, body(2));
  hand.add_tip("thumb", kThumbPad);
}

}  // namespace hand34_detail

/// Lists the hand's links and joints, so that more can be added before it is built. Its root is the link "world"; frames named
/// "index_tip" and so on stand at the contact points. Allocates.
template <RealScalar Scalar>
TreeBuilder<Scalar> hand34_builder() {
  hand34_detail::Assembly<Scalar> hand;
  hand34_detail::add_base_and_palm(hand);
  for (const hand34_detail::Finger& finger : hand34_detail::kFingers) hand34_detail::add_finger(hand, finger);
  hand34_detail::add_thumb(hand);
  return std::move(hand.robot);
}

/// Builds the hand. Allocates.
template <RealScalar Scalar>
Tree<Scalar> hand34() {
  return hand34_builder<Scalar>().build().value();
}

/// Lists where the fingers touch: thumb, index, middle, ring, little. Allocates.
template <RealScalar Scalar>
std::vector<FingerTip<Scalar>> hand34_tips() {
  std::vector<FingerTip<Scalar>> tips;
  const auto add = [&tips](const std::string& name, const hand34_detail::Pad& pad) {
    tips.push_back({name, name + "_tip", name + "_distal", hand34_detail::point_of<Scalar>(pad)});
  };
  add("thumb", hand34_detail::kThumbPad);
  for (const hand34_detail::Finger& finger : hand34_detail::kFingers) add(finger.name, finger.pad);
  return tips;
}

/// Lists the capsules that are the hand's shape: forearm, three across the palm, one for each bone. Allocates.
template <RealScalar Scalar>
std::vector<Capsule<Scalar>> hand34_capsules() {
  using hand34_detail::vector;
  const Vector3<Scalar> origin = vector<Scalar>(0.0, 0.0, 0.0);
  std::vector<Capsule<Scalar>> shape;
  shape.push_back({"forearm", vector<Scalar>(-0.11, 0.0, 0.0), vector<Scalar>(-0.035, 0.0, 0.0), Scalar(0.027)});
  shape.push_back({"palm", vector<Scalar>(0.012, 0.018, 0.0), vector<Scalar>(0.048, 0.022, 0.0), Scalar(0.013)});
  shape.push_back({"palm", vector<Scalar>(0.012, 0.002, 0.0), vector<Scalar>(0.048, 0.004, 0.0), Scalar(0.013)});
  shape.push_back({"palm", vector<Scalar>(0.012, -0.015, 0.0), vector<Scalar>(0.046, -0.02, 0.0), Scalar(0.013)});
  const auto add = [&](const std::string& link, const hand34_detail::Bone& bone) {
    shape.push_back({link, origin, vector<Scalar>(bone.length, 0.0, 0.0), Scalar(bone.radius)});
  };
  for (const hand34_detail::Finger& finger : hand34_detail::kFingers) {
    for (std::size_t k = 0; k < finger.bones.size(); ++k)
      add(std::string(finger.name) + hand34_detail::kBoneNames[k], finger.bones[k]);
  }
  for (std::size_t k = 0; k < hand34_detail::kThumb.size(); ++k) add(hand34_detail::kThumbNames[k], hand34_detail::kThumb[k]);
  return shape;
}

/// Places the hand as it would hang relaxed: 0.2 m up, a little nose down, fingers and thumb half curled. The hand's joints are
/// found by name, in a larger robot too; joints that are not there, or that follow others, are passed over, and all others are
/// neutral. Values are moved into the limits. Allocates.
template <RealScalar Scalar>
VectorX<Scalar> hand34_home(const Tree<Scalar>& tree) {
  VectorX<Scalar> q = tree.neutral();
  const auto set = [&](const std::string& joint, double value) {
    const int k = tree.find_joint(joint);
    if (k < 0) return;
    const Body<Scalar>& body = tree.bodies()[static_cast<std::size_t>(k)];
    if (body.type != JointType::Free && !body.follows) q[body.position] = Scalar(value);
  };
  set("base_tz", 0.2);
  set("base_ry", 0.3);
  for (const hand34_detail::Finger& finger : hand34_detail::kFingers) {
    const std::string name = finger.name;
    set(name + "_mcp_flex", 0.5);
    set(name + "_pip", 0.6);
    set(name + "_dip", 0.35);
  }
  set("thumb_cmc_abd", 0.2);
  set("thumb_cmc_flex", 0.1);
  set("thumb_mcp_flex", 0.3);
  set("thumb_ip", 0.3);
  return q.cwiseMax(tree.lower()).cwiseMin(tree.upper());
}

}  // namespace clothctl::robot
