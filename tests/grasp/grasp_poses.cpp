#include "clothctl/grasp/grasp_poses.hpp"

#include <cmath>
#include <random>

#include "clothctl/math/rotation.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Vec = Vector3<double>;
using Tree = KinematicTree<double>;
using Traits = articulated_traits<Tree>;

/// Thumb and index of the hand.
std::vector<FingerPad<double>> pinching_pads(const Tree& tree) {
  std::vector<FingerPad<double>> out;
  for (const FingerTip<double>& tip : hand34_tips<double>()) {
    if (tip.finger == "thumb" || tip.finger == "index")
      out.push_back(
          {tip.finger, tree.find_link(tip.contact_link), tip.contact_point, Vec(0, 0, -1)});
  }
  return out;
}

/// A pinch of a sheet at `place` from both sides of its `normal`.
std::vector<GraspContact<double>> pinch_at(const Vec& place, const Vec& normal) {
  return {{place, normal, Vec::Zero()}, {place, -normal, Vec::Zero()}};
}

Vec pad_place(const Tree& tree, const VectorX<double>& q, const FingerPad<double>& pad) {
  auto work = Traits::make_workspace(tree);
  Traits::forward_kinematics(tree, q, work);
  Matrix3<double> R;
  Vec p;
  Traits::frame_pose(tree, work, pad.frame, R, p);
  return p + R * pad.point;
}

}  // namespace

TEST_CASE("a hand finds where to wait and where to touch", "[grasp]") {
  const Tree tree = hand34<double>();
  const auto pads = pinching_pads(tree);
  REQUIRE(pads.size() == 2);
  const VectorX<double> home = hand34_home(tree);
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  int found = 0;
  for (int k = 0; k < 30; ++k) {
    const Vec place = 0.3 * Vec(normal(random), normal(random), normal(random));
    const Vec across = Vec(normal(random), normal(random), normal(random)).normalized();
    const auto contacts = pinch_at(place, across);
    const auto poses = find_grasp_poses<Tree, double>(tree, pads, contacts, home, home);
    if (poses.status != GraspPoseStatus::Found) {
      CHECK_FALSE(poses.message.empty());
      continue;
    }
    ++found;
    CHECK(poses.message.empty());
    for (std::size_t i = 0; i < 2; ++i) {
      const Vec wait = contacts[i].place - 0.025 * contacts[i].press;
      CHECK((pad_place(tree, poses.touch, pads[i]) - place).norm() < 1e-3);
      CHECK((pad_place(tree, poses.wait, pads[i]) - wait).norm() < 1e-3);
    }
    for (const VectorX<double>* q : {&poses.wait, &poses.touch}) {
      CHECK((*q - tree.lower()).minCoeff() >= 0);
      CHECK((tree.upper() - *q).minCoeff() >= 0);
    }
  }
  CHECK(found == 30);
}

TEST_CASE("fingers press as they are told, as far as the hand can", "[grasp]") {
  const Tree tree = hand34<double>();
  const std::vector<FingerPad<double>> index{pinching_pads(tree)[1]};
  const VectorX<double> home = hand34_home(tree);
  const std::vector<GraspContact<double>> down{{Vec(0.2, 0, 0), Vec(0, 0, -1), Vec::Zero()}};
  auto work = Traits::make_workspace(tree);
  Matrix3<double> R;
  Vec p;
  const auto poses = find_grasp_poses<Tree, double>(tree, index, down, home, home);
  // Directions that are unit vectors but for a part in two hundred count as any.
  auto nearly = down;
  nearly[0].press *= 1.005;
  const auto same = find_grasp_poses<Tree, double>(tree, index, nearly, home, home);
  for (const auto* found : {&poses, &same}) {
    REQUIRE(found->status == GraspPoseStatus::Found);
    Traits::forward_kinematics(tree, found->touch, work);
    Traits::frame_pose(tree, work, index[0].frame, R, p);
    CHECK((R * index[0].normal).dot(Vec(0, 0, -1)) > 0.95);
  }
  // Above the place by default; elsewhere if told so.
  CHECK((pad_place(tree, poses.wait, index[0]) - Vec(0.2, 0, 0.025)).norm() < 1e-3);
  std::vector<GraspContact<double>> beside = down;
  beside[0].away = Vec(0, 1, 0);
  const auto other = find_grasp_poses<Tree, double>(tree, index, beside, home, home);
  REQUIRE(other.status == GraspPoseStatus::Found);
  CHECK((pad_place(tree, other.wait, index[0]) - Vec(0.2, 0.025, 0)).norm() < 1e-3);
}

TEST_CASE("round fingertips touch with what faces the sheet, and flat ones cannot", "[grasp]") {
  // hand34 cannot bring the middles of thumb and index to face each other.
  const Tree tree = hand34<double>();
  auto pads = pinching_pads(tree);
  for (auto& pad : pads) pad.radius = -pad.point.z();
  const VectorX<double> pinch = hand34_pinch(tree);
  const Vec place(0.1, 0.05, -0.1), axis(1, 0, 0);
  const auto poses =
      find_grasp_poses<Tree, double>(tree, pads, pinch_at(place, axis), pinch, pinch);
  REQUIRE(poses.status == GraspPoseStatus::Found);
  auto work = Traits::make_workspace(tree);
  double off = 0;
  for (const VectorX<double>* q : {&poses.touch, &poses.wait}) {
    Traits::forward_kinematics(tree, *q, work);
    for (std::size_t i = 0; i < 2; ++i) {
      const Vec press = i == 0 ? axis : Vec(-axis);
      Matrix3<double> R;
      Vec p;
      Traits::frame_pose(tree, work, pads[i].frame, R, p);
      const Vec touched = p + R * pads[i].centre() + pads[i].radius * press;
      const Vec shall = q == &poses.touch ? place : Vec(place - 0.025 * press);
      CHECK((touched - shall).norm() < 1e-3);
      if (q == &poses.touch) off += std::acos(std::min(1.0, (R * pads[i].normal).dot(press)));
    }
  }
  CHECK(off > 0.2);  // rad, both together: what a flat pad would be off by
  CHECK(off < 1.0);
  pads[0].radius = -1;
  const auto bad = find_grasp_poses<Tree, double>(tree, pads, pinch_at(place, axis), pinch, pinch);
  CHECK(bad.message == "finger 0 (thumb) has the radius -1 m, must be finite and not negative");
}

TEST_CASE("places out of reach are named with the finger and the distance", "[grasp]") {
  const Tree tree = hand34<double>();
  const auto pads = pinching_pads(tree);
  const VectorX<double> home = hand34_home(tree);
  // Thumb and index cannot be 1 m apart.
  std::vector<GraspContact<double>> apart = pinch_at(Vec::Zero(), Vec(0, 1, 0));
  apart[1].place = Vec(0, 1, 0);
  const auto poses = find_grasp_poses<Tree, double>(tree, pads, apart, home, home);
  CHECK(poses.status == GraspPoseStatus::Unreachable);
  CHECK(poses.message.find("finger ") == 0);
  CHECK(poses.message.find(" m from its place at (0, ") != std::string::npos);
  CHECK(poses.touch.size() == tree.nq());
  CHECK(poses.touch_errors.maxCoeff() > 0.2);
  // They reach the sheet, but cannot wait 1 m apart.
  GraspPoseSettings<double> far;
  far.distance = 0.5;
  const auto wait = find_grasp_poses<Tree, double>(tree, pads, pinch_at(Vec::Zero(), Vec(0, 1, 0)),
                                                   home, home, far);
  CHECK(wait.status == GraspPoseStatus::WaitUnreachable);
  CHECK(wait.message.find("where it waits") != std::string::npos);
}

TEST_CASE("the poses of a grasp are the same bits every time", "[grasp]") {
  const Tree tree = hand34<double>();
  const auto pads = pinching_pads(tree);
  const VectorX<double> home = hand34_home(tree);
  const auto contacts = pinch_at(Vec(0.1, 0.2, 0.3), Vec(0, 1, 0));
  const auto first = find_grasp_poses<Tree, double>(tree, pads, contacts, home, home);
  const auto second = find_grasp_poses<Tree, double>(tree, pads, contacts, home, home);
  CHECK(first.touch == second.touch);
  CHECK(first.wait == second.wait);
}

TEST_CASE("a grasp that is not valid is refused by name", "[grasp]") {
  const Tree tree = hand34<double>();
  const auto good = pinching_pads(tree);
  const VectorX<double> home = hand34_home(tree);
  const auto contacts = pinch_at(Vec::Zero(), Vec(0, 1, 0));
  const double nan = std::nan("");
  const auto refused = [&](const std::vector<FingerPad<double>>& pads,
                           const std::vector<GraspContact<double>>& places,
                           const VectorX<double>& shape, const VectorX<double>& grip,
                           const GraspPoseSettings<double>& settings = {}) {
    const auto poses = find_grasp_poses<Tree, double>(tree, pads, places, shape, grip, settings);
    CHECK(poses.status == GraspPoseStatus::InvalidInput);
    CHECK(poses.touch.size() == 0);
    return poses.message;
  };
  CHECK(refused({}, {}, home, home) == "the hand has no finger pads");
  CHECK(refused(good, {contacts[0]}, home, home) == "1 places for 2 fingers");
  auto pads = good;
  pads[1].frame = 999;
  CHECK(refused(pads, contacts, home, home) ==
        "finger 1 (index) is on frame 999, which does not exist");
  pads = good;
  pads[0].normal = Vec::Zero();
  CHECK(refused(pads, contacts, home, home) ==
        "finger 0 (thumb) has a normal that is not a unit vector");
  auto places = contacts;
  places[1].place[2] = nan;
  CHECK(refused(good, places, home, home) == "finger 1 (index) has a place that is not finite");
  places = contacts;
  places[0].press *= 2;
  CHECK_FALSE(refused(good, places, home, home).empty());
  places = contacts;
  places[0].away = Vec(nan, 0, 0);
  CHECK_FALSE(refused(good, places, home, home).empty());
  CHECK(refused(good, contacts, VectorX<double>::Zero(3), home) ==
        "the pre-shape has 3 positions, the hand 34");
  VectorX<double> broken = home;
  broken[7] = nan;
  CHECK(refused(good, contacts, home, broken) == "the grip is nan at position 7");
  GraspPoseSettings<double> settings;
  settings.distance = 0;
  CHECK(refused(good, contacts, home, home, settings) ==
        "distance is 0 m, must be finite and positive");
  settings = {};
  settings.restarts = -1;
  CHECK_FALSE(refused(good, contacts, home, home, settings).empty());
}
