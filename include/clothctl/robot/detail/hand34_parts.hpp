#pragma once

// The parts of the hand of hand34.hpp: bone lengths and radii, joints with their limits, masses and
// inertias.
//
// Bones are capsules of density ρ: cylinders of length L along x with half balls of radius r at
// both ends,
//
//   m_c = ρ π r² L,   m_s = 4/3 ρ π r³,   m = m_c + m_s,   centre of mass at L/2
//   I_along = m_c r²/2 + 2/5 m_s r²
//   I_across = m_c (L²/12 + r²/4) + m_s (2/5 r² + L²/4 + 3/8 L r)
//
// The palm is a box. Two or three joints of knuckles and wrist share a point. The links between
// them have small masses instead of none, so that the mass matrix is positive definite.

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>

#include "clothctl/math/rotation.hpp"
#include "clothctl/robot/kinematic_tree_builder.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

inline constexpr double kDensity = 1100.0;  // kg/m³

/// A bone: length between its joints, and radius (m).
struct Bone {
  double length, radius;
};

/// Contact point on a finger's pad: `reach` along the last bone, `depth` from its axis to the
/// palm's side (m).
struct Pad {
  double reach, depth;
};

/// A finger with four bones: its y on the palm (`side`, m), the yaw of its metacarpal (`splay`,
/// rad) and the upper limit of its metacarpal joint (`arch`, rad).
struct FingerPart {
  const char* name;
  double side, splay, arch;
  std::array<Bone, 4> bones;
  Pad pad;
};

inline constexpr std::array<FingerPart, 4> kFingers{
    {{"index",
      0.025,
      0.06,
      0.06,
      {{{0.045, 0.009}, {0.044, 0.0092}, {0.026, 0.0088}, {0.016, 0.008}}},
      {0.018, 0.0068}},
     {"middle",
      0.003,
      0.0,
      0.05,
      {{{0.045, 0.009}, {0.048, 0.0094}, {0.031, 0.0088}, {0.0168, 0.0082}}},
      {0.019, 0.00697}},
     {"ring",
      -0.0175,
      -0.06,
      0.2,
      {{{0.042, 0.009}, {0.044, 0.009}, {0.029, 0.0084}, {0.0172, 0.0078}}},
      {0.019, 0.00663}},
     {"little",
      -0.0365,
      -0.13,
      0.4,
      {{{0.036, 0.0085}, {0.035, 0.0082}, {0.02, 0.0076}, {0.016, 0.007}}},
      {0.017, 0.00595}}}};
inline constexpr std::array<const char*, 4> kBoneNames{"_metacarpal", "_proximal", "_middle",
                                                       "_distal"};

inline constexpr std::array<Bone, 3> kThumb{{{0.046, 0.0125}, {0.034, 0.011}, {0.022, 0.01}}};
inline constexpr std::array<const char*, 3> kThumbNames{"thumb_metacarpal", "thumb_proximal",
                                                        "thumb_distal"};
inline constexpr Pad kThumbPad{0.024, 0.0085};

/// Type, axis and limits of a joint (m, rad, N, N m, s).
struct JointRange {
  JointType type;
  int axis;
  double lower, upper, effort, velocity;
};

template <RealScalar Scalar>
Vector3<Scalar> vector(double x, double y, double z) {
  return Vector3<Scalar>(Scalar(x), Scalar(y), Scalar(z));
}

/// Returns the pose at (x, y, z), rotated by roll, pitch and yaw: Rz Ry Rx.
template <RealScalar Scalar>
Pose<Scalar> at(double x, double y = 0.0, double z = 0.0, double yaw = 0.0, double pitch = 0.0,
                double roll = 0.0) {
  Pose<Scalar> pose;
  pose.R = rotation_from_roll_pitch_yaw<Scalar>(Scalar(roll), Scalar(pitch), Scalar(yaw));
  pose.p = vector<Scalar>(x, y, z);
  return pose;
}

template <RealScalar Scalar>
Inertia<Scalar> point_body(double mass, double moment) {
  Inertia<Scalar> body;
  body.mass = Scalar(mass);
  body.about_com.diagonal().setConstant(Scalar(moment));
  return body;
}

/// Returns the inertia of a capsule from the origin along x.
template <RealScalar Scalar>
Inertia<Scalar> capsule_body(const Bone& bone) {
  const Scalar L = Scalar(bone.length), r = Scalar(bone.radius), density = Scalar(kDensity);
  const Scalar area = Scalar(std::numbers::pi) * r * r;
  const Scalar cylinder = density * area * L, ball = density * area * r * Scalar(4) / Scalar(3);
  Inertia<Scalar> body;
  body.mass = cylinder + ball;
  body.com = Vector3<Scalar>(Scalar(0.5) * L, Scalar(0), Scalar(0));
  const Scalar along = r * r * (cylinder / Scalar(2) + ball * Scalar(2) / Scalar(5));
  const Scalar across =
      cylinder * (L * L / Scalar(12) + r * r / Scalar(4)) +
      ball * (r * r * Scalar(2) / Scalar(5) + L * L / Scalar(4) + L * r * Scalar(3) / Scalar(8));
  body.about_com.diagonal() = Vector3<Scalar>(along, across, across);
  return body;
}

/// Returns the inertia of a box around `centre`.
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

/// Builds the hand: adds links, each with the joint that moves it.
template <RealScalar Scalar>
class Assembly {
 public:
  KinematicTreeBuilder<Scalar> robot;

  void add(const std::string& name, const std::string& parent, const std::string& child,
           const Pose<Scalar>& origin, const JointRange& range, const Inertia<Scalar>& inertia) {
    Joint<Scalar> joint = between(name, range.type, parent, child, origin);
    joint.axis = Vector3<Scalar>::Constant(Scalar(0));
    joint.axis[range.axis] = Scalar(1);
    joint.limits = {Scalar(range.lower), Scalar(range.upper), Scalar(range.velocity),
                    Scalar(range.effort)};
    robot.add_link(child, inertia).add_joint(joint);
  }
  /// Adds a link whose frame is at the contact point of a finger's pad.
  void add_tip(const std::string& finger, const Pad& pad) {
    Pose<Scalar> origin;
    origin.p = point_of<Scalar>(pad);
    robot.add_link(finger + "_tip");
    robot.add_joint(between(finger + "_tip_fixed", JointType::Fixed, finger + "_distal",
                            finger + "_tip", origin));
  }

 private:
  static Joint<Scalar> between(const std::string& name, JointType type, const std::string& parent,
                               const std::string& child, const Pose<Scalar>& origin) {
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
  const Inertia<Scalar> carriage = point_body<Scalar>(0.05, 2e-5),
                        gimbal = point_body<Scalar>(0.02, 1e-5);
  hand.robot.add_link("world");
  hand.add("base_tx", "world", "carriage_x", here, {kSlide, 0, -1.5, 1.5, 250.0, 3.0}, carriage);
  hand.add("base_ty", "carriage_x", "carriage_y", here, {kSlide, 1, -1.5, 1.5, 250.0, 3.0},
           carriage);
  hand.add("base_tz", "carriage_y", "carriage_z", here, {kSlide, 2, -1.5, 1.5, 250.0, 3.0},
           carriage);
  hand.add("base_rz", "carriage_z", "gimbal_z", here, {kTurn, 2, -3.1, 3.1, 40.0, 6.0}, gimbal);
  hand.add("base_ry", "gimbal_z", "gimbal_y", here, {kTurn, 1, -1.45, 1.45, 40.0, 6.0}, gimbal);
  Inertia<Scalar> forearm = capsule_body<Scalar>(Bone{0.1, 0.027});
  forearm.com = vector<Scalar>(-0.06, 0.0, 0.0);
  hand.add("base_rx", "gimbal_y", "forearm", here, {kTurn, 0, -3.1, 3.1, 40.0, 6.0}, forearm);
  hand.add("wrist_dev", "forearm", "carpus_a", here, {kTurn, 2, -0.52, 0.35, 12.0, 8.0},
           point_body<Scalar>(0.03, 6e-6));
  hand.add(
      "wrist_flex", "carpus_a", "palm", here, {kTurn, 1, -1.2, 1.3, 12.0, 8.0},
      box_body<Scalar>(0.2, vector<Scalar>(0.05, 0.066, 0.026), vector<Scalar>(0.03, 0.002, 0.0)));
}

/// Adds a finger. Its knuckle undoes the splay of its metacarpal, so fingers are parallel at q = 0.
template <RealScalar Scalar>
void add_finger(Assembly<Scalar>& hand, const FingerPart& finger) {
  constexpr JointType kTurn = JointType::Revolute;
  const std::string name = finger.name;
  const auto origin = [&](std::size_t bone) { return at<Scalar>(finger.bones[bone].length); };
  const auto body = [&](std::size_t bone) { return capsule_body<Scalar>(finger.bones[bone]); };
  const auto link = [&](std::size_t bone) { return name + kBoneNames[bone]; };
  hand.add(name + "_cmc", "palm", link(0), at<Scalar>(0.046, finger.side, 0.0, finger.splay),
           {kTurn, 1, 0.0, finger.arch, 8.0, 6.0}, body(0));
  hand.add(name + "_mcp_abd", link(0), name + "_knuckle",
           at<Scalar>(finger.bones[0].length, 0.0, 0.0, -finger.splay),
           {kTurn, 2, -0.35, 0.35, 3.0, 10.0}, point_body<Scalar>(0.004, 3e-7));
  hand.add(name + "_mcp_flex", name + "_knuckle", link(1), at<Scalar>(0.0),
           {kTurn, 1, -0.5, 1.57, 5.0, 10.0}, body(1));
  hand.add(name + "_pip", link(1), link(2), origin(1), {kTurn, 1, 0.0, 1.8, 4.0, 10.0}, body(2));
  hand.add(name + "_dip", link(2), link(3), origin(2), {kTurn, 1, -0.1, 1.4, 2.0, 10.0}, body(3));
  hand.add_tip(name, finger.pad);
}

template <RealScalar Scalar>
void add_thumb(Assembly<Scalar>& hand) {
  constexpr JointType kTurn = JointType::Revolute;
  const Inertia<Scalar> saddle = point_body<Scalar>(0.004, 4e-7),
                        knuckle = point_body<Scalar>(0.004, 3e-7);
  const auto body = [](std::size_t bone) { return capsule_body<Scalar>(kThumb[bone]); };
  const Pose<Scalar> here, root = at<Scalar>(0.014, 0.026, -0.01, 0.75, 0.35, -1.05);
  hand.add("thumb_cmc_abd", "palm", "thumb_cmc_a", root, {kTurn, 2, -0.35, 0.9, 6.0, 8.0}, saddle);
  hand.add("thumb_cmc_flex", "thumb_cmc_a", "thumb_cmc_b", here, {kTurn, 1, -0.6, 0.9, 6.0, 8.0},
           saddle);
  hand.add("thumb_cmc_rot", "thumb_cmc_b", kThumbNames[0], here, {kTurn, 0, -0.5, 0.5, 4.0, 8.0},
           body(0));
  hand.add("thumb_mcp_abd", kThumbNames[0], "thumb_knuckle", at<Scalar>(kThumb[0].length),
           {kTurn, 2, -0.25, 0.25, 3.0, 8.0}, knuckle);
  hand.add("thumb_mcp_flex", "thumb_knuckle", kThumbNames[1], here,
           {kTurn, 1, -0.2, 1.0, 4.0, 10.0}, body(1));
  hand.add("thumb_ip", kThumbNames[1], kThumbNames[2], at<Scalar>(kThumb[1].length),
           {kTurn, 1, -0.3, 1.4, 3.0, 10.0}, body(2));
  hand.add_tip("thumb", kThumbPad);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
