#include "clothctl/grasp/hand_geometry.hpp"

#include <cmath>

#include "support/catch.hpp"
#include "support/grasping.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {
using Vec = Vector3<double>;
}

TEST_CASE("samples of a round pad lie on its sphere, those of a flat one in its plane", "[grasp]") {
  FingerPad<double> finger{"index", 3, Vec(0.02, 0, -0.007), Vec(0, 0, -1), 0.007};
  FingertipSamples<double> shape{0.006, 2};
  const auto round = fingertip_samples(finger, shape).value();
  CHECK(round.size() == 13);
  CHECK(validate_pad_samples<double>(round) == "");
  for (const auto& s : round) {
    CHECK((s.position - finger.centre() - 0.007 * s.normal).norm() < 1e-15);
    CHECK(std::acos(std::min(1.0, s.normal.dot(finger.normal))) < 0.006 / 0.007 + 1e-9);
  }
  finger.radius = 0;
  shape.rings = 1;
  const auto flat = fingertip_samples(finger, shape).value();
  CHECK(flat.size() == 4);
  for (const auto& s : flat) {
    CHECK(s.normal == finger.normal);
    CHECK((s.position - finger.point).dot(finger.normal) == Approx(0).margin(1e-15));
    CHECK((s.position - finger.point).norm() == Approx(0.006));
  }
  // A pad that would reach around its finger ends at 1.5 radii.
  finger.radius = 0.002;
  const auto narrow = fingertip_samples(finger, shape).value();
  for (const auto& s : narrow) CHECK(s.normal.dot(finger.normal) > std::cos(1.5) - 1e-9);
}

TEST_CASE("hand34 has five pads on the surfaces of its last bones", "[grasp]") {
  const Hand34 tree = hand34<double>();
  const HandGeometry<double> geometry = hand34_geometry(tree);
  CHECK(geometry.capsules.size() == hand34_capsules<double>().size());
  REQUIRE(geometry.fingers.size() == 5);
  CHECK(geometry.find_finger("little") == 4);
  CHECK(geometry.find_finger("sixth") == -1);
  for (const auto& f : geometry.fingers) {
    bool on_axis = false;
    for (const auto& c : geometry.capsules) {
      if (c.frame != f.frame) continue;
      const Vec centre = f.centre();
      on_axis = on_axis || (std::abs(centre.y()) + std::abs(centre.z()) < 1e-12 &&
                            centre.x() < c.to.x() + 3e-3);
    }
    CHECK(on_axis);
  }
}

TEST_CASE("a pinching hand34 is where it is put", "[grasp]") {
  const Hand34 tree = hand34<double>();
  const auto geometry = hand34_geometry(tree);
  auto tracker = FingertipTracker<Hand34>::create(tree, geometry.fingers).value();
  const Vec place(0.3, -0.2, 0.5);
  const Vec axes[] = {Vec(0, 1, 0), Vec(1, 0, 0), Vec(0, 0, 1), Vec(0.6, 0, 0.8), Vec(-1, 0, 0)};
  for (const Vec& axis : axes) {
    for (const Vec& approach : {Vec(0, 0.1, -1), Vec(1, 0.2, 0.3)}) {
      const VectorX<double> q = hand34_pinch_at<double>(tree, place, axis, approach);
      Matrix3<double> R;
      Vec thumb, index;
      tracker.pose_at(q, 0, R, thumb);
      tracker.pose_at(q, 1, R, index);
      CHECK((0.5 * (thumb + index) - place).norm() < 1e-12);
      CHECK((index - thumb).normalized().dot(axis) > 1 - 1e-12);
      const double gap = (index - thumb).norm() - geometry.fingers[0].radius;
      CHECK(gap - geometry.fingers[1].radius == Approx(0.01).epsilon(0.05));
    }
  }
  // The palm faces the way it is told: its origin is on the other side.
  const VectorX<double> q = hand34_pinch_at<double>(tree, place, Vec(0, 1, 0), Vec(0, 0, -1));
  CHECK(q[2] - place.z() > 0.05);
  // Without directions the base stays where it was.
  const Vec bad(0, std::nan(""), 0);
  CHECK(hand34_pinch_at<double>(tree, place, bad, Vec(0, 0, 1)) == hand34_pinch(tree));
  const Vec axis = Vec(1, 2, 3).normalized();
  CHECK(hand34_pinch_at<double>(tree, place, axis, 0.1 * axis) == hand34_pinch(tree));
}

TEST_CASE("the parts of a hand in a world are where it says", "[grasp]") {
  PinchingHand hand(5);
  CHECK(hand.in.shapes.size() == hand.geometry.capsules.size());
  CHECK(hand.in.pads == std::vector<int>{0, 1, -1, -1, -1});
  for (int f = 0; f < 2; ++f) {
    const int segment = hand.in.segments[static_cast<std::size_t>(f)];
    CHECK(hand.world.pad_carrier(hand.in.pads[static_cast<std::size_t>(f)]) == segment);
    // The obstacle moves with the finger's frame.
    auto tracker = FingertipTracker<Hand34>::create(hand.tree, hand.geometry.fingers).value();
    Matrix3<double> R;
    Vec centre;
    tracker.pose_at(hand.world.hand(0).positions, f, R, centre);
    const auto& motion = hand.world.motion(segment);
    const Vec local = hand.geometry.fingers[static_cast<std::size_t>(f)].centre();
    CHECK((motion.position + motion.R_world_body * local - centre).norm() < 1e-12);
  }
}

TEST_CASE("bad geometry is refused in words", "[grasp]") {
  PinchingHand hand(5);
  const int obstacles = hand.world.obstacle_count(), pads = hand.world.pad_count();
  const auto refused = [&](auto change, const HandSurface<double>& surface = {}) {
    HandGeometry<double> bad = hand.geometry;
    change(bad);
    const auto added = add_hand_geometry<double>(hand.world, 0, bad, surface);
    return added ? std::string() : added.error();
  };
  CHECK(refused([](auto& g) { g.fingers.clear(); }) == "the hand has no finger pads");
  CHECK(refused([](auto& g) { g.capsules[2].radius = -1; }).find("capsule 2: ") == 0);
  CHECK(refused([](auto& g) { g.capsules[0].frame = 999; }).find("capsule 0: ") == 0);
  CHECK(refused([](auto& g) { g.fingers[0].frame = 0; }) ==
        "finger thumb has no capsule on its frame");
  HandSurface<double> surface;
  surface.with_pads = {1, 1};
  CHECK(refused([](auto&) {}, surface) == "finger index gets two pads");
  surface.with_pads.clear();
  CHECK(refused([](auto& g) { g.fingers[2].radius = std::nan(""); }, surface)
            .find("finger middle has the radius nan m") == 0);
  surface.with_pads = {9};
  CHECK(refused([](auto&) {}, surface) == "there is no finger 9");
  surface.with_pads.clear();
  surface.samples.radius = std::nan("");
  CHECK(refused([](auto&) {}, surface).find("the pad of finger thumb has the radius nan") == 0);
  CHECK(add_hand_geometry<double>(hand.world, 7, hand.geometry).error() ==
        "capsule 0: no hand 7 (there are 1)");
  surface = {};
  surface.pad.friction = -1;
  CHECK(refused([](auto&) {}, surface).find("finger thumb: the pad has ") == 0);
  surface = {};
  surface.links.friction = -1;
  CHECK(refused([](auto&) {}, surface).find("capsule 0: ") == 0);
  CHECK(refused([](auto& g) { g.capsules.back().frame = 999; }).find(" has no frame 999") !=
        std::string::npos);
  // What was refused is not there in part.
  CHECK(hand.world.obstacle_count() == obstacles);
  CHECK(hand.world.pad_count() == pads);
}
