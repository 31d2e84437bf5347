#pragma once

// The option --hand: a hand of the programs, or one from a URDF file with what JSON files tell of
// it. For programs alone, since it needs tinyxml2.
//
// A robot with six joints or more above both fingers stands with its arm beside the place; any
// other hand gets a floating base.

#include <tinyxml2.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/bridge/hand_json.hpp"
#include "clothctl/bridge/urdf.hpp"
#include "clothctl/io/file.hpp"
#include "support/command_line.hpp"
#include "support/hand_base.hpp"
#include "support/hand_pinch.hpp"

namespace program {

/// The options.
struct HandFiles {
  std::string hand = "hand34", shape, grasps;
};

/// Adds --hand, which is returned, --hand-shape and --grasps.
inline CLI::Option* add_hand(CLI::App& app, HandFiles& files) {
  auto* hand = app.add_option("--hand", files.hand, "hand34, gripper, or a URDF file");
  app.add_option("--hand-shape", files.shape,
                 "JSON file with the capsules and fingertips of a URDF file NAME.urdf (default: "
                 "capsules_NAME.json beside it)");
  app.add_option("--grasps", files.grasps,
                 "JSON file with its grasp \"pinch\" (default: grasps_NAME.json beside it, or else "
                 "the hand searches for one)");
  return hand->capture_default_str();
}

/// Puts a robot from URDF text, whose root is `root`, on a base; see base_urdf.
inline clothctl::UrdfModel<double> read_on_base(const std::string& path, const std::string& text,
                                                const std::string& root,
                                                const clothctl::Pose<double>& origin, bool moves) {
  const std::size_t end = text.rfind("</robot");
  if (end == std::string::npos) refuse(path + ": <robot> has no end tag");
  return must(clothctl::parse_urdf<double>(
      text.substr(0, end) + base_urdf(root, origin, moves) + text.substr(end), path));
}

/// Returns the link that no joint moves.
inline std::string root_link(const std::string& path, const std::string& text) {
  tinyxml2::XMLDocument file;
  if (file.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS || !file.RootElement())
    refuse(path + ": not XML");
  const tinyxml2::XMLElement& robot = *file.RootElement();
  std::set<std::string> moved;
  for (auto* j = robot.FirstChildElement("joint"); j; j = j->NextSiblingElement("joint")) {
    const auto* child = j->FirstChildElement("child");
    if (child && child->Attribute("link")) moved.insert(child->Attribute("link"));
  }
  for (auto* l = robot.FirstChildElement("link"); l; l = l->NextSiblingElement("link")) {
    if (l->Attribute("name") && !moved.count(l->Attribute("name"))) return l->Attribute("name");
  }
  refuse(path + ": has no root link");
}

/// A hand as its files describe it, not at a place yet.
struct HandFromFiles {
  std::string path, text, root;
  bool on_arm = false;
  clothctl::HandDescription<double> hand;
  Pinch pinch;

  /// The hand for a place.
  HandModel at(const GraspPlace& place) const {
    clothctl::Pose<double> origin;
    if (!on_arm) {  // at zero the base has the hand pinch along x, with the palm above
      origin.R = pinch.axes.transpose();
      return on(origin);
    }
    // It stands upright, such that it pinches at the place with few turns, and by at most
    // 0.3 m along each axis from there where it holds itself up with the least effort.
    const clothctl::Matrix3<double> turn = pinch.axes * pinch_axes(place).transpose();
    const double yaw = std::atan2(turn(0, 1) - turn(1, 0), turn(0, 0) + turn(1, 1));
    origin.R = clothctl::rotation_exp<double>({0, 0, yaw});
    const clothctl::Vector3<double> first = place.place - origin.R * pinch.centre;
    HandModel best;
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 125; ++i) {
      origin.p = first + 0.15 * clothctl::Vector3<double>(i % 5 - 2, i / 5 % 5 - 2, i / 25 - 2);
      HandModel model = on(origin);
      const double effort = pinch_effort(model, place);
      if (!(effort < least)) continue;
      least = effort;
      best = std::move(model);
    }
    if (best.pinch_at) return best;
    origin.p = first;
    return on(origin);
  }

 private:
  HandModel on(const clothctl::Pose<double>& origin) const {
    HandModel out;
    out.tree = read_on_base(path, text, root, origin, !on_arm).tree;
    out.geometry = hand.geometry;
    out.home = hand.home;
    out.control = clothctl::StablePdSettings<double>::uniform(out.tree.nv());
    Pinch there = make_pinch_of(out.tree, out.geometry, pinch.positions, pinch.positions);
    out.pinch_at = [there, fingers = hand.geometry.fingers](const HandModel::Tree& tree,
                                                            const GraspPlace& p) {
      return pinch_at(tree, fingers, there, p);
    };
    return out;
  }
};

/// Takes the grasp "pinch" of a file, and puts its two fingers first.
inline clothctl::VectorX<double> read_pinch(const clothctl::KinematicTree<double>& tree,
                                            const std::string& file,
                                            clothctl::HandDescription<double>& hand) {
  const auto grasps = must(clothctl::read_grasps_json<double>(tree, hand, file));
  for (const std::string& line : grasps.warnings) std::fprintf(stderr, "%s\n", line.c_str());
  const int k = grasps.find_grasp("pinch");
  if (k < 0) refuse(file + ": has no grasp \"pinch\"");
  const auto& grasp = grasps.grasps[static_cast<std::size_t>(k)];
  if (grasp.fingers.size() != 2)
    refuse(file + ": the grasp \"pinch\" has " + std::to_string(grasp.fingers.size()) +
           " fingers, must have 2");
  std::vector<clothctl::FingerPad<double>> first;
  for (const int f : grasp.fingers) first.push_back(grasps.fingers[static_cast<std::size_t>(f)]);
  for (std::size_t f = 0; f < grasps.fingers.size(); ++f) {
    if (static_cast<int>(f) != grasp.fingers[0] && static_cast<int>(f) != grasp.fingers[1])
      first.push_back(grasps.fingers[f]);
  }
  hand.geometry.fingers = std::move(first);
  return grasp.grip;
}

/// Reads a hand from its files.
inline HandFromFiles read_hand_files(const HandFiles& files) {
  HandFromFiles out;
  const std::filesystem::path path(files.hand);
  const auto beside = [&](const char* kind, const std::string& given) {
    const std::string name = kind + ("_" + path.stem().string()) + ".json";
    return given.empty() ? (path.parent_path() / name).string() : given;
  };
  out.path = files.hand;
  out.text = must(clothctl::read_file(out.path));
  const auto bare = must(clothctl::parse_urdf<double>(out.text, out.path));
  for (const std::string& line : bare.warnings) std::fprintf(stderr, "%s\n", line.c_str());
  out.root = root_link(out.path, out.text);
  const std::string shape = beside("capsules", files.shape),
                    grasps = beside("grasps", files.grasps);
  out.hand = must(clothctl::read_hand_json<double>(bare.tree, shape));
  if (out.hand.geometry.fingers.size() < 2) refuse(shape + ": has fewer than 2 tips");
  int above = 0;
  for (const bool carries : find_carriers(bare.tree, out.hand.geometry)) above += carries ? 1 : 0;
  out.on_arm = above >= 6;
  const auto tree = read_on_base(out.path, out.text, out.root, {}, !out.on_arm).tree;
  out.hand = must(clothctl::read_hand_json<double>(tree, shape));
  for (const std::string& line : out.hand.warnings) std::fprintf(stderr, "%s\n", line.c_str());
  if (!files.grasps.empty() || std::filesystem::exists(grasps)) {
    const auto grip = read_pinch(tree, grasps, out.hand);
    out.pinch = make_pinch_of(tree, out.hand.geometry, grip, out.hand.home);
  } else {
    out.pinch = find_pinch(tree, out.hand.geometry, out.hand.home);
  }
  return out;
}

/// Returns the maker of the hand that the options name. Bad files end the program.
inline HandMaker read_hand(const HandFiles& files) {
  const bool own = files.hand == "hand34" || files.hand == "gripper";
  if (own && !(files.shape + files.grasps).empty())
    refuse("--hand-shape and --grasps are for a URDF file, --hand is " + files.hand);
  if (files.hand == "hand34") return [](const GraspPlace&) { return make_hand34(); };
  if (files.hand == "gripper") return [](const GraspPlace&) { return make_gripper(); };
  if (files.hand.find('.') == std::string::npos)
    refuse("--hand: \"" + files.hand + "\" is neither hand34 nor gripper, nor a URDF file");
  return [read = read_hand_files(files)](const GraspPlace& place) { return read.at(place); };
}

}  // namespace program
