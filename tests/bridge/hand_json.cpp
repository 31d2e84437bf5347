// Hands from JSON: what a text gives, the hands of the shared folder against their robots and
// against the code of hand34, and texts that are refused or damaged.

#include "clothctl/bridge/hand_json.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "clothctl/bridge/urdf.hpp"
#include "clothctl/robot/forward_kinematics.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/kinematic_tree_builder.hpp"
#include "io/spoilt_text.hpp"
#include "static/explicit_scalar.hpp"
#include "support/catch.hpp"
#include "support/reading.hpp"
#include "support/shared_data.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Vec = Vector3<double>;
using Tree = KinematicTree<double>;
using Hand = HandDescription<double>;

/// A palm, and a finger of two bones with a tip that is fixed 30 mm along its last bone. `bend_2`
/// follows `bend_1` where `coupled`.
template <class S>
KinematicTree<S> small_robot(bool coupled = false) {
  KinematicTreeBuilder<S> builder;
  for (const char* name : {"palm", "bone", "end", "tip"}) builder.add_link(name);
  Joint<S> joint;
  joint.name = "bend_1", joint.parent = "palm", joint.child = "bone";
  joint.axis = Vector3<S>(S(0), S(1), S(0));
  joint.limits.lower = S(0.1), joint.limits.upper = S(1.5);
  builder.add_joint(joint);
  joint.name = "bend_2", joint.parent = "bone", joint.child = "end";
  joint.origin.p = Vector3<S>(S(0.04), S(0), S(0));
  joint.limits.lower = S(-0.2);
  if (coupled) joint.leader = "bend_1";
  builder.add_joint(joint);
  joint = {};
  joint.name = "weld", joint.parent = "end", joint.child = "tip", joint.type = JointType::Fixed;
  joint.origin.p = Vector3<S>(S(0.03), S(0), S(0));
  // x of the tip is z of the last bone.
  joint.origin.R << S(0), S(-1), S(0), S(0), S(0), S(-1), S(1), S(0), S(0);
  builder.add_joint(joint);
  return builder.build().value();
}

const std::string kSmall = R"({
  "model": "small",
  "capsules": [
    {"link": "palm", "p0": [0, 0, 0], "p1": [-0.05, 0, 0], "radius": 0.02},
    {"link": "bone", "p0": [0, 0, 0], "p1": [0.04, 0, 0], "radius": 0.01},
    {"link": "end", "p0": [0, 0, 0], "p1": [0.01, 0, 0], "radius": 0.01},
    {"link": "tip", "p0": [0, 0, 0], "p1": [0, 0, 0], "radius": 0.005}
  ],
  "tips": [
    {"finger": "index", "link": "tip", "contact_link": "end", "contact_point": [0.005, 0, -0.01]},
    {"finger": "far", "contact_link": "end", "contact_point": [0.036, 0, 0]}
  ],
  "home": {"bend_2": 0.5},
  "boxes": [],
  "ignore_pairs": [["bone", "palm"], ["bone", "end"]]
})";

const std::string kGrasps = R"({
  "model": "small",
  "pad_points": {"index": {"link": "bone", "point": [0.02, 0.011, 0]}},
  "grasps": [
    {"name": "poke", "fingers": ["far"], "pre_shape": {}, "grip": {"bend_1": 1}},
    {"name": "press", "fingers": ["far", "index"], "pre_shape": {"bend_1": 0.2, "bend_2": 0.1},
     "grip": {"bend_1": 1.50005, "bend_2": -0.2}}
  ]
})";

std::string hand_error(const std::string& text) {
  return refusal_of(parse_hand_json(small_robot<double>(), text, "h.json"));
}

std::string grasp_error(const std::string& text) {
  const Tree tree = small_robot<double>();
  const Hand hand = value_of(parse_hand_json(tree, kSmall, "h.json"));
  return refusal_of(parse_grasps_json(tree, hand, text, "g.json"));
}

/// Distance of the middle of a pad from the surfaces of the capsules on its frame.
double off_surface(const Hand& hand, const FingerPad<double>& pad) {
  double least = std::numeric_limits<double>::infinity();
  for (const LinkCapsule<double>& c : hand.geometry.capsules) {
    if (c.frame != pad.frame) continue;
    const Vec along = c.to - c.from;
    const double square = along.squaredNorm();
    const double share =
        square > 0 ? std::clamp((pad.point - c.from).dot(along) / square, 0.0, 1.0) : 0.0;
    least = std::min(least, std::abs((pad.point - c.from - share * along).norm() - c.radius));
  }
  return least;
}

/// Place of a point of a link in the world.
Vec place_of(const Tree& tree, const VectorX<double>& q, int link, const Vec& point) {
  BodyPoses<double> poses(tree);
  forward_kinematics<double>(tree, q, poses);
  return link_pose<double>(tree, poses, link) * point;
}

/// Checks that a message is one printable line of bounded length about the file.
void check_message(const std::string& message, const std::string& file) {
  INFO(message);
  CHECK(message.rfind(file + ":", 0) == 0);
  CHECK(message.size() > file.size() + 2);
  CHECK(message.size() < 400);
  CHECK(std::none_of(message.begin(), message.end(),
                     [](unsigned char c) { return c < 0x20 || c == 0x7f; }));
}

}  // namespace

template clothctl::Result<HandDescription<ExplicitDouble>> clothctl::parse_hand_json(
    const KinematicTree<ExplicitDouble>&, std::string_view, const std::string&);
template clothctl::Result<HandGrasps<ExplicitDouble>> clothctl::parse_grasps_json(
    const KinematicTree<ExplicitDouble>&, const HandDescription<ExplicitDouble>&, std::string_view,
    const std::string&);

TEMPLATE_TEST_CASE("hand JSON: capsules, tips, home and pairs are those of the text", "[bridge]",
                   float, double) {
  using S = TestType;
  const auto near_to = [](const Vector3<S>& a, double x, double y, double z) {
    return (a.template cast<double>() - Vec(x, y, z)).norm() <= 1e-8;
  };
  const KinematicTree<S> tree = small_robot<S>();
  const HandDescription<S> hand = value_of(parse_hand_json<S>(tree, kSmall, "h.json"));
  CHECK(hand.name == "small");
  REQUIRE(hand.geometry.capsules.size() == 4);
  CHECK(hand.geometry.capsules[1].frame == tree.find_link("bone"));
  CHECK(near_to(hand.geometry.capsules[0].to, -0.05, 0, 0));
  CHECK(hand.geometry.capsules[3].radius == S(0.005));
  REQUIRE(hand.geometry.fingers.size() == 2);
  const FingerPad<S>& index = hand.geometry.fingers[0];
  CHECK(index.name == "index");
  CHECK(index.frame == tree.find_link("end"));
  CHECK(near_to(index.point, 0.005, 0, -0.01));
  CHECK(near_to(index.normal, 0, 0, -1));
  CHECK(index.radius <= S(0.01));
  CHECK(S(0) < index.radius);
  // The ball of the tip is nearer than the bone that carries it: the pad belongs to the ball.
  const FingerPad<S>& beyond = hand.geometry.fingers[1];
  CHECK(beyond.frame == tree.find_link("tip"));
  CHECK(near_to(beyond.point, 0, -0.006, 0));
  CHECK(near_to(beyond.normal, 0, -1, 0));
  REQUIRE(hand.home.size() == 2);
  CHECK(hand.home[0] == S(0.1));  // neutral is the limit next to zero
  CHECK(hand.home[1] == S(0.5));
  const std::vector<std::pair<int, int>> pairs{{0, 1}, {1, 2}};
  CHECK(hand.ignore_pairs == pairs);
}

TEST_CASE("hand JSON: grasps have their own pads, and keep the home where they say nothing",
          "[bridge]") {
  const Tree tree = small_robot<double>();
  const Hand hand = value_of(parse_hand_json(tree, kSmall, "h.json"));
  const HandGrasps<double> read = value_of(parse_grasps_json(tree, hand, kGrasps, "g.json"));
  REQUIRE(read.fingers.size() == 2);
  CHECK(read.fingers[0].name == "index");
  CHECK(read.fingers[0].frame == tree.find_link("bone"));
  CHECK(read.fingers[0].point == Vec(0.02, 0.011, 0));
  CHECK((read.fingers[0].normal - Vec(0, 1, 0)).norm() <= 1e-15);
  CHECK(read.fingers[1].point == hand.geometry.fingers[1].point);
  REQUIRE(read.grasps.size() == 2);
  CHECK(read.find_grasp("press") == 1);
  CHECK(read.find_grasp("none") == -1);
  CHECK(read.grasps[0].fingers == std::vector<int>{1});
  CHECK(read.grasps[0].pre_shape == hand.home);
  CHECK(read.grasps[0].grip == Eigen::Vector2d(1, 0.5));
  CHECK(read.grasps[1].fingers == std::vector<int>{1, 0});
  CHECK(read.grasps[1].pre_shape == Eigen::Vector2d(0.2, 0.1));
  CHECK(read.grasps[1].grip == Eigen::Vector2d(1.5, -0.2));  // clamped
}

TEST_CASE("hand JSON: only capsules must be there, and joints that follow are skipped",
          "[bridge]") {
  const Tree tree = small_robot<double>(true);
  const Hand hand = value_of(parse_hand_json(tree, kSmall, "h.json"));
  REQUIRE(hand.home.size() == 1);
  CHECK(hand.home[0] == 0.1);
  const Hand least = value_of(parse_hand_json(tree, "{\"capsules\": []}", "h.json"));
  CHECK(least.name.empty());
  CHECK(least.geometry.capsules.empty());
  CHECK(least.geometry.fingers.empty());
  CHECK(least.home == tree.neutral());
}

TEST_CASE("hand JSON: the hands of the shared folder fit their robots", "[bridge]") {
  struct Row {
    std::string name;
    std::size_t capsules, fingers, pairs;
    double off;  // largest distance of a contact point from the surface, m
  };
  const std::vector<Row> table{{"shadow_hand_right", 31, 5, 33, 0.002},
                               {"allegro_hand_right", 23, 4, 20, 0.004},
                               {"leap_hand_right", 26, 4, 19, 0.03},
                               {"hand34", 23, 5, 20, 0.002},
                               {"sia10d_shadow", 38, 5, 40, 0.002}};
  for (const Row& row : table) {
    INFO(row.name);
    const std::string urdf = shared_path("data/models/" + row.name + ".urdf");
    const std::string json = shared_path("data/models/capsules_" + row.name + ".json");
    if (urdf.empty() || json.empty()) {
      WARN("no shared model " << row.name << ": not checked");
      continue;
    }
    const Tree tree = value_of(read_urdf(urdf)).tree;
    const Hand hand = value_of(read_hand_json(tree, json));
    CHECK(hand.name == row.name);
    CHECK(hand.geometry.capsules.size() == row.capsules);
    CHECK(hand.geometry.fingers.size() == row.fingers);
    CHECK(hand.ignore_pairs.size() == row.pairs);
    CHECK(hand.home.size() == tree.nq());
    CHECK((hand.home.array() >= tree.lower().array()).all());
    CHECK((hand.home.array() <= tree.upper().array()).all());
    CHECK(hand.home != tree.neutral());
    for (const FingerPad<double>& pad : hand.geometry.fingers) {
      INFO(pad.name << ": " << off_surface(hand, pad));
      CHECK(off_surface(hand, pad) <= row.off);
      CHECK(std::abs(pad.normal.norm() - 1) <= 1e-14);
    }
    // The frames at the fingertips of this hand are beyond all of its shapes.
    CHECK(hand.warnings.size() == (row.name == "leap_hand_right" ? 4 : 0));
    // At home nothing touches but pairs that are left out.
    auto clearance = RobotClearance<Tree>::create(tree, hand.geometry.capsules, 1e-4).value();
    (void)clearance.closest(hand.home);
    double least = 1;
    for (std::size_t i = 0; i < hand.geometry.capsules.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        const auto& a = hand.geometry.capsules[i];
        const auto& b = hand.geometry.capsules[j];
        const std::pair<int, int> links = std::minmax(a.frame, b.frame);
        if (a.frame == b.frame ||
            std::count(hand.ignore_pairs.begin(), hand.ignore_pairs.end(), links) > 0)
          continue;
        const auto [p, q] = clearance.ends(static_cast<int>(i));
        const auto [r, s] = clearance.ends(static_cast<int>(j));
        for (int u = 0; u <= 20; ++u) {
          const Vec x = p + u / 20.0 * (q - p), along = s - r;
          const double square = along.squaredNorm();
          const double t = square > 0 ? std::clamp((x - r).dot(along) / square, 0.0, 1.0) : 0;
          least = std::min(least, (x - r - t * along).norm() - a.radius - b.radius);
        }
      }
    }
    CHECK(least >= -1e-4);
  }
}

TEST_CASE("hand JSON: hand34 of the shared folder is that of the code", "[bridge]") {
  const std::string json = shared_path("data/models/capsules_hand34.json");
  if (json.empty()) {
    WARN("no shared capsules_hand34.json: not checked");
    return;
  }
  const Tree tree = hand34<double>();
  const Hand hand = value_of(read_hand_json(tree, json));
  const HandGeometry<double> own = hand34_geometry(tree);
  REQUIRE(hand.geometry.capsules.size() == own.capsules.size());
  for (std::size_t i = 0; i < own.capsules.size(); ++i) {
    CHECK(hand.geometry.capsules[i].frame == own.capsules[i].frame);
    CHECK((hand.geometry.capsules[i].from - own.capsules[i].from).norm() <= 1e-12);
    CHECK((hand.geometry.capsules[i].to - own.capsules[i].to).norm() <= 1e-12);
    CHECK(hand.geometry.capsules[i].radius == Approx(own.capsules[i].radius).epsilon(1e-12));
  }
  REQUIRE(hand.geometry.fingers.size() == own.fingers.size());
  for (std::size_t i = 0; i < own.fingers.size(); ++i) {
    CHECK(hand.geometry.fingers[i].name == own.fingers[i].name);
    CHECK(hand.geometry.fingers[i].frame == own.fingers[i].frame);
    CHECK((hand.geometry.fingers[i].point - own.fingers[i].point).norm() <= 1e-12);
    CHECK(hand.geometry.fingers[i].radius == Approx(own.fingers[i].radius).epsilon(0.1));
    // The pads lie 1 to 2 mm beyond the end of the axis, where the surface is round.
    CHECK(hand.geometry.fingers[i].normal.dot(own.fingers[i].normal) >= 0.95);
  }
  CHECK((hand.home - hand34_home(tree)).norm() <= 1e-12);
}

TEST_CASE("hand JSON: in the grips of the shared folder the pads meet", "[bridge]") {
  for (const std::string name : {"hand34", "shadow_hand_right"}) {
    INFO(name);
    const std::string urdf = shared_path("data/models/" + name + ".urdf");
    const std::string json = shared_path("data/models/capsules_" + name + ".json");
    const std::string grasps = shared_path("data/models/grasps_" + name + ".json");
    if (urdf.empty() || json.empty() || grasps.empty()) {
      WARN("no shared grasps of " << name << ": not checked");
      continue;
    }
    const Tree tree = value_of(read_urdf(urdf)).tree;
    const Hand hand = value_of(read_hand_json(tree, json));
    const HandGrasps<double> read = value_of(read_grasps_json(tree, hand, grasps));
    REQUIRE(read.grasps.size() == 3);
    CHECK(read.grasps[static_cast<std::size_t>(read.find_grasp("five"))].fingers.size() == 5);
    for (const NamedGrasp<double>& grasp : read.grasps) {
      INFO(grasp.name);
      // The gap between the thumb's pad and the mean of the others, as the folder states it.
      const auto gap = [&](const VectorX<double>& q) {
        Vec mean = Vec::Zero();
        for (std::size_t k = 0; k < grasp.fingers.size(); ++k) {
          const auto& pad = read.fingers[static_cast<std::size_t>(grasp.fingers[k])];
          const Vec x = place_of(tree, q, pad.frame, pad.point);
          if (k == 0) {
            CHECK(pad.name == "thumb");
            mean -= x;
          } else {
            mean += x / static_cast<double>(grasp.fingers.size() - 1);
          }
        }
        return mean.norm();
      };
      CHECK(gap(grasp.grip) >= 0.0035);
      CHECK(gap(grasp.grip) <= 0.0125);
      CHECK(gap(grasp.pre_shape) >= 0.0485);
      CHECK(gap(grasp.pre_shape) <= 0.0575);
    }
  }
}

TEST_CASE("hand JSON: a hand on an arm is read by the names of the hand alone", "[bridge]") {
  const std::string urdf = shared_path("data/models/sia10d_shadow.urdf");
  const std::string whole = shared_path("data/models/capsules_sia10d_shadow.json");
  const std::string grasps = shared_path("data/models/grasps_shadow_hand_right.json");
  if (urdf.empty() || whole.empty() || grasps.empty()) {
    WARN("no shared sia10d_shadow: not checked");
    return;
  }
  const Tree tree = value_of(read_urdf(urdf)).tree;
  const Hand hand = value_of(read_hand_json(tree, whole));
  const auto read = value_of(read_grasps_json(tree, hand, grasps));
  REQUIRE(read.grasps.size() == 3);
  CHECK(read.grasps[0].grip.head(7) == hand.home.head(7));  // the arm stays
  CHECK(read.grasps[0].grip != hand.home);
}

TEST_CASE("hand JSON: mistakes are named by file, path and value", "[bridge]") {
  const auto with = [](const std::string& from, const std::string& to) {
    return hand_error(replaced(kSmall, from, to));
  };
  CHECK(hand_error(kSmall) == "accepted");
  CHECK(with("\"radius\": 0.02", "\"radius\": -1") ==
        "h.json: capsules[0].radius: is -1, must be positive");
  CHECK(with("\"radius\": 0.01", "\"radius\": 0") ==
        "h.json: capsules[1].radius: is 0, must be positive");
  CHECK(with("\"radius\": 0.02", "\"radius\": 1e300") ==
        "h.json: capsules[0].radius: is 1e+300, must be from -1e6 to 1e6");
  CHECK(with("\"radius\": 0.02", "\"radius\": \"two\"") ==
        "h.json: capsules[0].radius: is \"two\", must be a number");
  CHECK(with("\"radius\": 0.02", "\"radios\": 0.02") ==
        "h.json: capsules[0]: there is no \"radius\"");
  CHECK(with("[-0.05, 0, 0]", "[-0.05, 0]") ==
        "h.json: capsules[0].p1: is a list of 2, must be a list of 3 numbers");
  CHECK(with("[-0.05, 0, 0]", "[-0.05, null, 0]") ==
        "h.json: capsules[0].p1[1]: is null, must be a number");
  CHECK(with("[-0.05, 0, 0]", "7") == "h.json: capsules[0].p1: is 7, must be a list of 3 numbers");
  CHECK(with("\"link\": \"bone\"", "\"link\": \"bo\\nne\"") ==
        "h.json: capsules[1].link: the robot has no link \"bo\\nne\"");
  CHECK(with("\"link\": \"bone\"", "\"link\": 3") ==
        "h.json: capsules[1].link: is 3, must be the name of a link");
  CHECK(with("\"contact_link\": \"end\"", "\"contact_link\": \"toe\"") ==
        "h.json: tips[0].contact_link: the robot has no link \"toe\"");
  CHECK(with("\"far\"", "\"index\"") == "h.json: tips[1].finger: \"index\" is there twice");
  CHECK(with("\"far\"", "[]") == "h.json: tips[1].finger: is a list of 0, must be a name");
  CHECK(with("[0.005, 0, -0.01]", "[0.005, 0, 0]") ==
        "h.json: tips[0].contact_point: lies on the axis of capsules[2], from which there is no "
        "direction to it");
  CHECK(with("\"bend_2\"", "\"weld\"") ==
        "h.json: home: the robot has no joint \"weld\" that moves");
  CHECK(with("0.5}", "1.6}") == "h.json: home.bend_2: is 1.6, the joint goes from -0.2 to 1.5");
  CHECK(with("0.5}", "true}") == "h.json: home.bend_2: is true, must be a number");
  CHECK(with("{\"bend_2\": 0.5}", "[]") == "h.json: home: is a list of 0, must be an object");
  CHECK(with("[\"bone\", \"palm\"]", "[\"bone\"]") ==
        "h.json: ignore_pairs[0]: is a list of 1, must be a list of 2 links");
  CHECK(with("[\"bone\", \"end\"]", "[\"bone\", {}]") ==
        "h.json: ignore_pairs[1][1]: is an object, must be the name of a link");
  CHECK(with("\"model\": \"small\"", "\"model\": 2") == "h.json: model: is 2, must be a name");
  CHECK(with("\"boxes\"", "\"home\"") == "h.json: the key \"home\" occurs twice in one object");
  CHECK(hand_error("{}") == "h.json: there is no \"capsules\"");
  CHECK(hand_error("{\"capsules\": {}}") == "h.json: capsules: is an object, must be a list");
  CHECK(hand_error("[]") == "h.json: a list of 0 found, must be an object");
  const std::string tip_alone =
      R"({"capsules": [{"link": "palm", "p0": [0, 0, 0], "p1": [0, 0, 0], "radius": 1}], "tips": [
          {"finger": "x", "contact_link": "tip", "contact_point": [0, 0, 0]}]})";
  CHECK(hand_error(tip_alone) ==
        "h.json: tips[0].contact_point: no capsule is rigidly connected to link \"tip\"");
}

TEST_CASE("hand JSON: a contact point off its capsule gives a warning", "[bridge]") {
  const Tree tree = small_robot<double>();
  const Hand hand = value_of(parse_hand_json(tree, kSmall, "h.json"));
  CHECK(hand.warnings.empty());
  const std::string text = replaced(kSmall, "[0.005, 0, -0.01]", "[0.005, 0, -0.03125]");
  const Hand off = value_of(parse_hand_json(tree, text, "h.json"));
  REQUIRE(off.warnings.size() == 1);
  CHECK(off.warnings[0].rfind("h.json: tips[0].contact_point: is 0.0212", 0) == 0);
  CHECK(off.warnings[0].find(" m off the surface of capsules[2]") != std::string::npos);
  const auto grasps =
      value_of(parse_grasps_json(tree, hand, replaced(kGrasps, "0.011", "0.03"), "g"));
  REQUIRE(grasps.warnings.size() == 1);
  CHECK(grasps.warnings[0].rfind("g: pad_points.index.point: is 0.0", 0) == 0);
}

TEST_CASE("hand JSON: mistakes in grasps are named, too", "[bridge]") {
  const auto with = [](const std::string& from, const std::string& to) {
    return grasp_error(replaced(kGrasps, from, to));
  };
  CHECK(grasp_error(kGrasps) == "accepted");
  CHECK(with("{\"index\"", "{\"toe\"") == "g.json: pad_points: the hand has no finger \"toe\"");
  CHECK(with("\"link\": \"bone\"", "\"link\": \"x\"") ==
        "g.json: pad_points.index.link: the robot has no link \"x\"");
  CHECK(with("[0.02, 0.011, 0]", "[0.02, 0, 0]") ==
        "g.json: pad_points.index.point: lies on the axis of capsules[1], from which there is no "
        "direction to it");
  CHECK(with("[\"far\"]", "[\"toe\"]") ==
        "g.json: grasps[0].fingers[0]: the hand has no finger \"toe\"");
  CHECK(with("[\"far\", \"index\"]", "[\"far\", \"far\"]") ==
        "g.json: grasps[1].fingers[1]: \"far\" is there twice");
  CHECK(with("[\"far\"]", "\"far\"") == "g.json: grasps[0].fingers: is \"far\", must be a list");
  CHECK(with("\"press\"", "\"poke\"") == "g.json: grasps[1].name: \"poke\" is there twice");
  CHECK(with("\"pre_shape\": {}", "\"shape\": {}") ==
        "g.json: grasps[0]: there is no \"pre_shape\"");
  CHECK(with("\"bend_1\": 1}", "\"bend_1\": 1.6}") ==
        "g.json: grasps[0].grip.bend_1: is 1.6, the joint goes from 0.1 to 1.5");
  CHECK(grasp_error("{\"pad_points\": []}") ==
        "g.json: pad_points: is a list of 0, must be an object");
  CHECK(grasp_error("{}") == "g.json: there is no \"grasps\"");
  // The hand of another robot.
  const Tree tree = small_robot<double>(), other = small_robot<double>(true);
  Hand hand = value_of(parse_hand_json(tree, kSmall, "h.json"));
  CHECK(parse_grasps_json(other, hand, kGrasps, "g.json").error() ==
        "the hand is not of this robot: its home has 2 positions, the robot has 1");
  hand.geometry.capsules[0].frame = 9;
  CHECK(parse_grasps_json(tree, hand, kGrasps, "g.json").error() ==
        "the hand is not of this robot: capsule 0 is on frame 9, which does not exist");
}

TEST_CASE("hand JSON: what is no JSON, too deep or too much is refused", "[bridge]") {
  CHECK(hand_error("").rfind("h.json", 0) == 0);
  const std::string line = hand_error("{\"capsules\": [\n{\"link\" \"palm\"}]}");
  INFO(line);
  CHECK(line.rfind("h.json:2: the file is not JSON: syntax error", 0) == 0);
  for (const char* number : {"NaN", "nan", "Infinity", "-inf", "1e999", "0x10", "1,0"}) {
    const std::string told = hand_error(replaced(kSmall, "0.02}", std::string(number) + "}"));
    INFO(told);
    CHECK(told.rfind("h.json:4: the file is not JSON: ", 0) == 0);
  }
  CHECK(hand_error("{\"capsules\": [], \"x\": " + std::string(40, '[') + std::string(40, ']') +
                   "}") == "h.json: lists and objects are nested too deep");
  CHECK(hand_error("{\"x\":" + std::string(1000000, '[')) ==
        "h.json: lists and objects are nested too deep");
  CHECK(hand_error(std::string((std::size_t(1) << 22) + 1, ' ')) ==
        "h.json: the file is larger than 4 MiB");
  std::string many = "{\"capsules\": [0";
  for (int i = 0; i < 5000; ++i) many += ",0";
  CHECK(hand_error(many + "]}") == "h.json: capsules: is a list of 5001, must have at most 4096");
  CHECK(read_hand_json(small_robot<double>(), "no/such/file.json")
            .error()
            .rfind("no/such/file.json: cannot be opened", 0) == 0);
}

TEST_CASE("hand JSON: damaged texts are read or refused with one line", "[bridge]") {
  const Tree tree = small_robot<double>();
  const Hand hand = value_of(parse_hand_json(tree, kSmall, "h.json"));
  int read = 0, refused = 0;
  const auto judge = [&](const std::string& text) {
    const auto a = parse_hand_json(tree, text, "h.json");
    const auto b = parse_grasps_json(tree, hand, text, "h.json");
    if (a) {
      ++read;
      bool sound = all_finite(a->home);
      for (const auto& c : a->geometry.capsules)
        sound = sound && all_finite(c.from) && all_finite(c.to) && 0 < c.radius;
      for (const auto& f : a->geometry.fingers)
        sound = sound && all_finite(f.point) && std::abs(f.normal.norm() - 1) < 1e-12;
      CHECK(sound);
    } else {
      ++refused;
      check_message(a.error(), "h.json");
    }
    if (!b) check_message(b.error(), "h.json");
  };
  const std::string bytes = "{}[]\",:.-0123456789eEnul\\ \n";
  const int trials = clothctl_test::trials(2000, 40000, 300);
  for (const std::string& text : {kSmall, kGrasps}) {
    for_each_prefix(text, judge);
    for_each_spoilt(text, bytes, 7, trials, judge);
  }
  CHECK(read > trials / 40);
  CHECK(refused > trials);
}
