#pragma once

// Reads what of a hand touches, its home and its grasps from JSON (m, rad). Links and joints are
// those of a tree, by name. What is in […] may be missing; other keys are not read.
//
//   {["model": NAME],
//    "capsules": [{"link": LINK, "p0": [x, y, z], "p1": [x, y, z], "radius": r}, …],
//    ["tips": [{"finger": NAME, "contact_link": LINK, "contact_point": [x, y, z]}, …]],
//    ["home": {JOINT: q, …}],
//    ["ignore_pairs": [[LINK, LINK], …]]}
//
//   {["pad_points": {FINGER: {"link": LINK, "point": [x, y, z]}, …}],
//    "grasps": [{"name": NAME, "fingers": [FINGER, …],
//                "pre_shape": {JOINT: q, …}, "grip": {JOINT: q, …}}, …]}
//
// The pad of a finger belongs to the capsule whose surface is nearest to its point c, among those
// that are rigidly connected to the link. Its frame is that of the capsule, and its outward normal
// is the direction to c from the nearest point of the capsule's axis, p0 to p1. It is as round as
// the capsule, or less where c is closer to the axis.
//
// Needs nlohmann-json 3.9 or later (headers only).

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/bridge/detail/json_reader.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/quoted_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/grasp/hand_geometry.hpp"
#include "clothctl/io/file.hpp"
#include "clothctl/robot/kinematic_tree.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A hand from a JSON file.
template <RealScalar Scalar>
struct HandDescription {
  /// Its name in the file; may be empty.
  std::string name;
  /// Its capsules and fingertips.
  HandGeometry<Scalar> geometry;
  /// Positions (nq) at rest: neutral where the file does not say.
  VectorX<Scalar> home;
  /// Pairs of links whose capsules are never to be tested against each other, the smaller number
  /// first.
  std::vector<std::pair<int, int>> ignore_pairs;
  /// Contact points that are over 5 mm off the surfaces of all capsules of their body. One line
  /// each, with the file, the path to the value, and the distance.
  std::vector<std::string> warnings;
};

/// A grasp that has a name.
template <RealScalar Scalar>
struct NamedGrasp {
  /// Its name.
  std::string name;
  /// Numbers of the fingers that it uses.
  std::vector<int> fingers;
  /// Positions (nq) before and after the fingers close.
  VectorX<Scalar> pre_shape, grip;
};

/// The grasps of a hand from a JSON file.
template <RealScalar Scalar>
struct HandGrasps {
  /// The fingers of the hand, in its order, with the pads that grasps use.
  std::vector<FingerPad<Scalar>> fingers;
  /// The grasps, in the order of the file.
  std::vector<NamedGrasp<Scalar>> grasps;
  /// As those of HandDescription, about the pads of this file.
  std::vector<std::string> warnings;

  /// Returns the number of the grasp with this name, or -1.
  int find_grasp(std::string_view name) const {
    for (std::size_t i = 0; i < grasps.size(); ++i) {
      if (grasps[i].name == name) return static_cast<int>(i);
    }
    return -1;
  }
};

namespace detail {

/// Reads the parts of a hand.
template <RealScalar Scalar>
class HandJsonReader : public JsonReader<Scalar> {
  using Base = JsonReader<Scalar>;
  using Base::at, Base::fail, Base::find, Base::for_each, Base::is_list, Base::is_object,
      Base::kLargest, Base::line, Base::link, Base::load, Base::number, Base::point, Base::root,
      Base::shown, Base::tree, Base::word;

 public:
  using Base::Base;

  /// Unusual contents that were read nevertheless.
  std::vector<std::string> warnings;

  /// Reads a hand.
  bool read(std::string_view text, HandDescription<Scalar>& out);
  /// Reads grasps; `out.fingers` holds the tips of the hand on entry.
  bool read(std::string_view text, const HandDescription<Scalar>& hand, HandGrasps<Scalar>& out);

 private:
  /// How far positions may be beyond limits, as they are where they were rounded for printing.
  static constexpr double kRounding = 1e-4;
  /// How far a contact point may be off its capsule without a warning, m.
  static constexpr double kOff = 5e-3;

  /// Sets the positions of the joints that an object names.
  bool positions(const Json& joints, const std::string& where, VectorX<Scalar>& q);
  bool capsule(const Json& value, const std::string& where, LinkCapsule<Scalar>& out);
  bool tip(const Json& value, const std::string& where, HandGeometry<Scalar>& hand);
  bool pair(const Json& value, const std::string& where, std::pair<int, int>& out);
  bool grasp(const Json& value, const std::string& where, const VectorX<Scalar>& home,
             HandGrasps<Scalar>& out);
  /// Puts the pad of a finger, given by a link in `pad.frame` and a point on it, on its capsule.
  bool place_pad(const std::string& where, const std::vector<LinkCapsule<Scalar>>& capsules,
                 FingerPad<Scalar>& pad);
};

template <RealScalar Scalar>
bool HandJsonReader<Scalar>::positions(const Json& joints, const std::string& where,
                                       VectorX<Scalar>& q) {
  if (!is_object(joints, where)) return false;
  for (auto item = joints.begin(); item != joints.end(); ++item) {
    const std::string place = at(where, item.key());
    const int k = tree().find_joint(item.key());
    if (k < 0)
      return fail(where, "the robot has no joint " + quoted_text(item.key()) + " that moves");
    const Body<Scalar>& body = tree().bodies()[static_cast<std::size_t>(k)];
    if (body.type == JointType::Free) return fail(place, "the joint is free, must be one number");
    Scalar value(0);
    if (!number(item.value(), place, value)) return false;
    if (body.follows) continue;  // the leader's position counts
    const Scalar low = tree().lower()[body.position], high = tree().upper()[body.position];
    if (value < low - Scalar(kRounding) || high + Scalar(kRounding) < value)
      return fail(place, "is " + shown(item.value()) + ", the joint goes from " + number_text(low) +
                             " to " + number_text(high));
    if (value < low) value = low;
    if (high < value) value = high;
    q[body.position] = value;
  }
  return true;
}

template <RealScalar Scalar>
bool HandJsonReader<Scalar>::capsule(const Json& value, const std::string& where,
                                     LinkCapsule<Scalar>& out) {
  if (!link(value, where, "link", out.frame) || !point(value, where, "p0", out.from) ||
      !point(value, where, "p1", out.to))
    return false;
  const Json* radius = find(value, where, "radius", true);
  if (radius == nullptr || !number(*radius, at(where, "radius"), out.radius)) return false;
  return Scalar(0) < out.radius ||
         fail(at(where, "radius"), "is " + shown(*radius) + ", must be positive");
}

template <RealScalar Scalar>
bool HandJsonReader<Scalar>::tip(const Json& value, const std::string& where,
                                 HandGeometry<Scalar>& hand) {
  FingerPad<Scalar> pad;
  if (!word(value, where, "finger", pad.name)) return false;
  if (0 <= hand.find_finger(pad.name))
    return fail(at(where, "finger"), quoted_text(pad.name) + " is there twice");
  if (!link(value, where, "contact_link", pad.frame) ||
      !point(value, where, "contact_point", pad.point) ||
      !place_pad(at(where, "contact_point"), hand.capsules, pad))
    return false;
  hand.fingers.push_back(std::move(pad));
  return true;
}

template <RealScalar Scalar>
bool HandJsonReader<Scalar>::pair(const Json& value, const std::string& where,
                                  std::pair<int, int>& out) {
  if (!value.is_array() || value.size() != 2)
    return fail(where, "is " + shown(value) + ", must be a list of 2 links");
  if (!link(*value.begin(), at(where, 0), out.first) ||
      !link(*(value.begin() + 1), at(where, 1), out.second))
    return false;
  if (out.second < out.first) std::swap(out.first, out.second);
  return true;
}

template <RealScalar Scalar>
bool HandJsonReader<Scalar>::place_pad(const std::string& where,
                                       const std::vector<LinkCapsule<Scalar>>& capsules,
                                       FingerPad<Scalar>& pad) {
  using std::sqrt;
  const auto link_of = [this](int frame) -> const Link<Scalar>& {
    return tree().links()[static_cast<std::size_t>(frame)];
  };
  const Link<Scalar>& own = link_of(pad.frame);
  const Vector3<Scalar> given = pad.point;
  Scalar least = scalar_traits<Scalar>::infinity(), height(0);
  std::size_t found = capsules.size();
  for (std::size_t i = 0; i < capsules.size(); ++i) {
    const LinkCapsule<Scalar>& c = capsules[i];
    const Link<Scalar>& other = link_of(c.frame);
    if (other.body != own.body) continue;
    const Vector3<Scalar> x =
        &other == &own ? given
                       : Vector3<Scalar>(other.placement.inverse() * (own.placement * given));
    const Vector3<Scalar> offset = detail::offset_from_segment<Scalar>(c.from, c.to, x);
    const Scalar length = sqrt(offset.squaredNorm());
    const Scalar off = length < c.radius ? c.radius - length : length - c.radius;
    if (!(off < least)) continue;
    least = off;
    height = length;
    found = i;
    pad.frame = c.frame;
    pad.point = x;
    pad.normal = offset;
  }
  if (found == capsules.size())
    return fail(where, "no capsule is rigidly connected to link " + quoted_text(own.name));
  const std::string name = "capsules[" + std::to_string(found) + ']';
  if (!(Scalar(1e-6) < height))
    return fail(where, "lies on the axis of " + name + ", from which there is no direction to it");
  pad.normal /= height;
  const Scalar& round = capsules[found].radius;
  pad.radius = height < round ? height : round;
  if (Scalar(kOff) < least)
    warnings.push_back(line(where, "is " + number_text(least) + " m off the surface of " + name));
  return true;
}

template <RealScalar Scalar>
bool HandJsonReader<Scalar>::read(std::string_view text, HandDescription<Scalar>& out) {
  if (!load(text)) return false;
  if (find(root(), "", "model", false) != nullptr && !word(root(), "", "model", out.name))
    return false;
  const auto read_capsule = [&](const Json& item, const std::string& where) {
    out.geometry.capsules.emplace_back();
    return capsule(item, where, out.geometry.capsules.back());
  };
  const auto read_tip = [&](const Json& item, const std::string& where) {
    return tip(item, where, out.geometry);
  };
  const auto read_pair = [&](const Json& item, const std::string& where) {
    out.ignore_pairs.emplace_back();
    return pair(item, where, out.ignore_pairs.back());
  };
  if (!for_each("capsules", true, read_capsule) || !for_each("tips", false, read_tip) ||
      !for_each("ignore_pairs", false, read_pair))
    return false;
  out.home = tree().neutral();
  const Json* home = find(root(), "", "home", false);
  return home == nullptr || positions(*home, "home", out.home);
}

template <RealScalar Scalar>
bool HandJsonReader<Scalar>::grasp(const Json& value, const std::string& where,
                                   const VectorX<Scalar>& home, HandGrasps<Scalar>& out) {
  NamedGrasp<Scalar> read;
  if (!word(value, where, "name", read.name)) return false;
  if (0 <= out.find_grasp(read.name))
    return fail(at(where, "name"), quoted_text(read.name) + " is there twice");
  const std::string place = at(where, "fingers");
  const Json* fingers = find(value, where, "fingers", true);
  if (fingers == nullptr || !is_list(*fingers, place)) return false;
  for (const Json& item : *fingers) {
    const std::string here = at(place, read.fingers.size());
    const auto* name = item.template get_ptr<const Json::string_t*>();
    if (name == nullptr) return fail(here, "is " + shown(item) + ", must be the name of a finger");
    const auto pad = std::find_if(out.fingers.begin(), out.fingers.end(),
                                  [&](const FingerPad<Scalar>& f) { return f.name == *name; });
    if (pad == out.fingers.end()) return fail(here, "the hand has no finger " + quoted_text(*name));
    const int finger = static_cast<int>(pad - out.fingers.begin());
    if (std::count(read.fingers.begin(), read.fingers.end(), finger) > 0)
      return fail(here, quoted_text(*name) + " is there twice");
    read.fingers.push_back(finger);
  }
  read.pre_shape = read.grip = home;
  for (auto [key, q] : {std::pair<const char*, VectorX<Scalar>*>("pre_shape", &read.pre_shape),
                        std::pair<const char*, VectorX<Scalar>*>("grip", &read.grip)}) {
    const Json* joints = find(value, where, key, true);
    if (joints == nullptr || !positions(*joints, at(where, key), *q)) return false;
  }
  out.grasps.push_back(std::move(read));
  return true;
}

template <RealScalar Scalar>
bool HandJsonReader<Scalar>::read(std::string_view text, const HandDescription<Scalar>& hand,
                                  HandGrasps<Scalar>& out) {
  if (!load(text)) return false;
  const Json none = Json::object();
  const Json* pads = find(root(), "", "pad_points", false);
  if (pads == nullptr) pads = &none;
  if (!is_object(*pads, "pad_points")) return false;
  for (auto item = pads->begin(); item != pads->end(); ++item) {
    const int finger = hand.geometry.find_finger(item.key());
    if (finger < 0) return fail("pad_points", "the hand has no finger " + quoted_text(item.key()));
    const std::string where = at("pad_points", item.key());
    FingerPad<Scalar>& pad = out.fingers[static_cast<std::size_t>(finger)];
    if (!link(*item, where, "link", pad.frame) || !point(*item, where, "point", pad.point) ||
        !place_pad(at(where, "point"), hand.geometry.capsules, pad))
      return false;
  }
  return for_each("grasps", true, [&](const Json& item, const std::string& where) {
    return grasp(item, where, hand.home, out);
  });
}

}  // namespace detail

/// Parses the capsules, fingertips and home of a hand whose links and joints are those of `tree`.
/// The tree may be a larger robot that contains the hand. Messages call the file `name`. Joints
/// that follow others are skipped. Allocates. Fails when:
///
/// * the text is not JSON, a key occurs twice, is missing or of another type
/// * the tree has no such link, or no such joint that moves
/// * a radius is not positive, or a number is beyond 1e6
/// * a position is beyond the limits of its joint by over 1e-4 (by less, it is clamped)
/// * a finger is there twice, no capsule is on the body of its link, or its contact point lies on
///   the axis of a capsule
/// * the text is longer than 4 MiB, nested deeper than 32, or a list has over 4096 entries
///
/// The error names the file, the path to the value as in `capsules[3].radius`, and the value.
template <RealScalar Scalar>
Result<HandDescription<Scalar>> parse_hand_json(const KinematicTree<Scalar>& tree,
                                                std::string_view text, const std::string& name) {
  detail::HandJsonReader<Scalar> reader(tree, name);
  HandDescription<Scalar> out;
  if (!reader.read(text, out)) return Error{reader.error()};
  out.warnings = std::move(reader.warnings);
  return out;
}

/// Reads a hand from a file; see `parse_hand_json`. Allocates. Fails when: the file cannot be read,
/// or `parse_hand_json` fails.
template <RealScalar Scalar>
Result<HandDescription<Scalar>> read_hand_json(const KinematicTree<Scalar>& tree,
                                               const std::string& path) {
  const Result<std::string> text = read_file(path, detail::kLargestJson);
  if (!text) return Error{text.error()};
  return parse_hand_json<Scalar>(tree, *text, path);
}

/// Parses the grasps of a hand. Where the file has a pad for a finger, it takes the place of the
/// hand's fingertip. Joints that a grasp does not name keep the hand's home position. Allocates.
/// Fails as `parse_hand_json` does, and when: a grasp is there twice, a finger is not one of the
/// hand, or the hand is not one of the tree.
template <RealScalar Scalar>
Result<HandGrasps<Scalar>> parse_grasps_json(const KinematicTree<Scalar>& tree,
                                             const HandDescription<Scalar>& hand,
                                             std::string_view text, const std::string& name) {
  const std::span<const LinkCapsule<Scalar>> capsules(hand.geometry.capsules);
  const std::string bad = detail::find_bad_capsule<KinematicTree<Scalar>, Scalar>(tree, capsules);
  if (!bad.empty()) return Error{"the hand is not of this robot: " + bad};
  if (hand.home.size() != tree.nq())
    return Error{"the hand is not of this robot: its home has " + std::to_string(hand.home.size()) +
                 " positions, the robot has " + std::to_string(tree.nq())};
  detail::HandJsonReader<Scalar> reader(tree, name);
  HandGrasps<Scalar> out;
  out.fingers = hand.geometry.fingers;
  if (!reader.read(text, hand, out)) return Error{reader.error()};
  out.warnings = std::move(reader.warnings);
  return out;
}

/// Reads grasps from a file; see `parse_grasps_json`. Allocates. Fails when: the file cannot be
/// read, or `parse_grasps_json` fails.
template <RealScalar Scalar>
Result<HandGrasps<Scalar>> read_grasps_json(const KinematicTree<Scalar>& tree,
                                            const HandDescription<Scalar>& hand,
                                            const std::string& path) {
  const Result<std::string> text = read_file(path, detail::kLargestJson);
  if (!text) return Error{text.error()};
  return parse_grasps_json<Scalar>(tree, hand, *text, path);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
