#pragma once

// A model of a right hand with 34 joints: a base that translates along x, y, z and rotates about z,
// y, x; a wrist with two joints; four fingers with five joints each (metacarpal, abduction at the
// knuckle, and three of flexion); a thumb with six joints. At q = 0 the fingers point along +x, the
// palm faces -z and the thumb is on the +y side. Positive flexion curls a finger to the palm,
// positive abduction turns it to the thumb's side. Units: m, rad, kg.
//
// Sizes and masses of its parts are in detail/hand34_parts.hpp.

#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/math/rotation.hpp"
#include "clothctl/robot/detail/hand34_parts.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A capsule on a link: all points within `radius` of a segment.
template <RealScalar Scalar>
struct Capsule {
  /// Name of the link that carries it.
  std::string link;
  /// One end of the segment, in the link's frame (m).
  Vector3<Scalar> from;
  /// The other end, in the link's frame (m). A ball has both ends at the same point.
  Vector3<Scalar> to;
  /// Radius (m).
  Scalar radius;
};

/// The contact point of a finger.
template <RealScalar Scalar>
struct FingerTip {
  /// Name of the finger: thumb, index, middle, ring or little.
  std::string finger;
  /// Name of the link whose frame is at the contact point.
  std::string link;
  /// Name of the link of the last bone.
  std::string contact_link;
  /// Contact point on the finger's pad, in the last bone's frame (m).
  Vector3<Scalar> contact_point;
};

/// Returns a builder with the hand's links and joints, to which more can be added. The root is the
/// link "world". Links named "thumb_tip", "index_tip" and so on have their frames at the contact
/// points. Allocates.
template <RealScalar Scalar>
KinematicTreeBuilder<Scalar> hand34_builder() {
  detail::Assembly<Scalar> hand;
  detail::add_base_and_palm(hand);
  for (const detail::FingerPart& finger : detail::kFingers) detail::add_finger(hand, finger);
  detail::add_thumb(hand);
  return std::move(hand.robot);
}

/// Returns the hand as a tree. Allocates.
template <RealScalar Scalar>
KinematicTree<Scalar> hand34() {
  return hand34_builder<Scalar>().build().value();
}

/// Returns the contact points of thumb, index, middle, ring and little finger, in this order.
/// Allocates.
template <RealScalar Scalar>
std::vector<FingerTip<Scalar>> hand34_tips() {
  std::vector<FingerTip<Scalar>> tips;
  const auto add = [&tips](const std::string& name, const detail::Pad& pad) {
    tips.push_back({name, name + "_tip", name + "_distal", detail::point_of<Scalar>(pad)});
  };
  add("thumb", detail::kThumbPad);
  for (const detail::FingerPart& finger : detail::kFingers) add(finger.name, finger.pad);
  return tips;
}

/// Returns the shape of the hand as capsules: the forearm, three across the palm, one for each
/// bone. Allocates.
template <RealScalar Scalar>
std::vector<Capsule<Scalar>> hand34_capsules() {
  using detail::vector;
  const Vector3<Scalar> origin = vector<Scalar>(0.0, 0.0, 0.0);
  std::vector<Capsule<Scalar>> shape;
  shape.push_back({"forearm", vector<Scalar>(-0.11, 0.0, 0.0), vector<Scalar>(-0.035, 0.0, 0.0),
                   Scalar(0.027)});
  shape.push_back({"palm", vector<Scalar>(0.012, 0.018, 0.0), vector<Scalar>(0.048, 0.022, 0.0),
                   Scalar(0.013)});
  shape.push_back({"palm", vector<Scalar>(0.012, 0.002, 0.0), vector<Scalar>(0.048, 0.004, 0.0),
                   Scalar(0.013)});
  shape.push_back({"palm", vector<Scalar>(0.012, -0.015, 0.0), vector<Scalar>(0.046, -0.02, 0.0),
                   Scalar(0.013)});
  const auto add = [&](const std::string& link, const detail::Bone& bone) {
    shape.push_back({link, origin, vector<Scalar>(bone.length, 0.0, 0.0), Scalar(bone.radius)});
  };
  for (const detail::FingerPart& finger : detail::kFingers) {
    for (std::size_t k = 0; k < finger.bones.size(); ++k)
      add(std::string(finger.name) + detail::kBoneNames[k], finger.bones[k]);
  }
  for (std::size_t k = 0; k < detail::kThumb.size(); ++k)
    add(detail::kThumbNames[k], detail::kThumb[k]);
  return shape;
}

namespace detail {

/// Returns the body of a joint with one position of its own, or null where the tree has none of
/// that name, or it is free or follows another.
template <RealScalar Scalar>
const Body<Scalar>* driven_joint(const KinematicTree<Scalar>& tree, const std::string& joint) {
  const int k = tree.find_joint(joint);
  if (k < 0) return nullptr;
  const Body<Scalar>& body = tree.bodies()[static_cast<std::size_t>(k)];
  return body.type == JointType::Free || body.follows ? nullptr : &body;
}

/// Sets the position of such a joint; of others nothing.
template <RealScalar Scalar>
void set_joint(const KinematicTree<Scalar>& tree, const std::string& joint, const Scalar& value,
               VectorX<Scalar>& q) {
  if (const Body<Scalar>* body = driven_joint(tree, joint)) q[body->position] = value;
}

}  // namespace detail

/// Returns positions (nq) of a relaxed hand: 0.2 m above the origin, pitched 0.3 rad down, fingers
/// and thumb half curled. The hand's joints are found by name, so `tree` may be a larger robot that
/// contains the hand. Joints that `tree` does not have, or that follow others there, are skipped.
/// All other coordinates are neutral. Values are clamped to the limits. Allocates.
template <RealScalar Scalar>
VectorX<Scalar> hand34_home(const KinematicTree<Scalar>& tree) {
  VectorX<Scalar> q = tree.neutral();
  const auto set = [&](const std::string& joint, double value) {
    detail::set_joint(tree, joint, Scalar(value), q);
  };
  set("base_tz", 0.2);
  set("base_ry", 0.3);
  for (const detail::FingerPart& finger : detail::kFingers) {
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

/// Returns positions (nq) of a hand that pinches: the tips of thumb and index face each other, 10
/// mm apart, below the palm; the other fingers are stretched and out of the way. The line from
/// thumb to index is mostly along +x of the palm, so that a sheet between them is mostly across x.
/// What is said of `hand34_home` is true here, too. Allocates.
template <RealScalar Scalar>
VectorX<Scalar> hand34_pinch(const KinematicTree<Scalar>& tree) {
  VectorX<Scalar> q = hand34_home(tree);
  const std::pair<const char*, double> joints[] = {
      {"base_ry", 0.0},    {"index_mcp_flex", 0.8},   {"index_pip", 0.8},
      {"index_dip", 0.5},  {"middle_mcp_flex", -0.3}, {"middle_pip", 0.1},
      {"middle_dip", 0.0}, {"ring_mcp_flex", -0.3},   {"ring_pip", 0.1},
      {"ring_dip", 0.0},   {"little_mcp_flex", -0.3}, {"little_pip", 0.1},
      {"little_dip", 0.0}, {"thumb_cmc_flex", 0.4}};
  for (const auto& [joint, value] : joints) detail::set_joint(tree, joint, Scalar(value), q);
  return q.cwiseMax(tree.lower()).cwiseMin(tree.upper());
}

/// Puts the base of a hand34, in positions q (nq), at `origin` (m, world), turned by `R` (from the
/// palm to the world, for a straight wrist). Limits of the joints are not looked at. Returns false,
/// and changes nothing, when the tree has no such base, a number is not finite, or R is no
/// rotation. Allocates.
template <RealScalar Scalar>
bool hand34_place_base(const KinematicTree<Scalar>& tree, const Matrix3<Scalar>& R,
                       const Vector3<Scalar>& origin, VectorX<Scalar>& q) {
  if (!all_finite(R) || !all_finite(origin) || q.size() != tree.nq()) return false;
  if (!is_rotation<Scalar>(R, Scalar(1e-2))) return false;
  const Vector3<Scalar> turn = roll_pitch_yaw_from_rotation<Scalar>(R);
  const std::pair<const char*, Scalar> joints[] = {{"base_tx", origin[0]}, {"base_ty", origin[1]},
                                                   {"base_tz", origin[2]}, {"base_rz", turn[2]},
                                                   {"base_ry", turn[1]},   {"base_rx", turn[0]}};
  for (const auto& [joint, value] : joints) {
    if (detail::driven_joint(tree, joint) == nullptr) return false;
  }
  for (const auto& [joint, value] : joints) detail::set_joint(tree, joint, value, q);
  return true;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(KinematicTreeBuilder<double> hand34_builder<double>());
CLOTHCTL_INSTANTIATE(KinematicTree<double> hand34<double>());

}  // namespace clothctl::inline CLOTHCTL_ABI
