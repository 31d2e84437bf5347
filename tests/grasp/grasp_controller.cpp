#include "clothctl/grasp/grasp_controller.hpp"

#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include "archetypes/articulated.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/grasping.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Vec = Vector3<double>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// Steps until the phase changes from `phase`, at most `steps` times.
GraspReport<double> run_through(PinchingHand& hand, GraspController<Hand34>& controller,
                                GraspPhase phase, int steps = 300) {
  GraspReport<double> report;
  for (int i = 0; i < steps; ++i) {
    report = hand.step(controller);
    if (report.phase != phase) break;
  }
  return report;
}

/// Grasps, and takes the sheet off its pins.
GraspReport<double> take(PinchingHand& hand, GraspController<Hand34>& controller) {
  REQUIRE(hand.poses.status == GraspPoseStatus::Found);
  REQUIRE(controller.begin(hand.grasp) == "");
  auto report = run_through(hand, controller, GraspPhase::Approach);
  REQUIRE(report.phase == GraspPhase::Close);
  report = run_through(hand, controller, GraspPhase::Close);
  REQUIRE(report.phase == GraspPhase::Hold);
  hand.world.input(0).clear();
  return report;
}

}  // namespace

TEST_CASE("a hand closes until it presses as wanted, holds, moves and opens", "[grasp]") {
  PinchingHand hand(17);
  GraspController<Hand34> controller = hand.controller();
  GraspReport<double> report = take(hand, controller);
  CHECK(std::abs(report.mean_force - 3) < 0.25 * 3);
  for (int i = 0; i < 50; ++i) report = hand.step(controller);
  REQUIRE(report.phase == GraspPhase::Hold);
  CHECK(report.mean_force == Approx(report.wanted_force).epsilon(0.05));
  CHECK(report.ik_error < 1e-4);

  // What hangs from the fingers weighs what the sheet weighs.
  Vec load = Vec::Zero();
  for (const int pad : {hand.in.pads[0], hand.in.pads[1]}) {
    for (const auto& c : hand.world.pad_contacts(pad)) load += c.impulse / hand.dt;
  }
  const double weight = 9.81 * hanging_sheet(17).network().mass.sum();
  CHECK(load.z() == Approx(weight).epsilon(0.1));

  // Moved 0.1 m within a second and turned by 0.3 rad: the sheet comes along.
  const auto middle = [&] {
    Vec sum = Vec::Zero();
    double count = 0;
    for (const auto& c : hand.world.pad_contacts(hand.in.pads[0])) {
      sum += c.place;
      ++count;
    }
    return Vec(sum / count);
  };
  const Vec before = middle();
  for (int i = 1; i <= 100; ++i) {
    const double share = std::min(1.0, 0.02 * i);
    const Matrix3<double> R = rotation_exp<double>(Vec(0, 0.3 * share, 0));
    REQUIRE(controller.move_to(R, Vec(0.1 * share, 0, 0) + before - R * before));
    report = hand.step(controller);
    REQUIRE(report.phase == GraspPhase::Hold);
  }
  CHECK((middle() - before - Vec(0.1, 0, 0)).norm() < 3e-3);

  controller.release();
  report = run_through(hand, controller, GraspPhase::Open);
  CHECK(report.phase == GraspPhase::Free);
  for (int i = 0; i < 20; ++i) (void)hand.step(controller);
  CHECK(hand.touches()[0].contacts == 0);
  CHECK(hand.touches()[1].contacts == 0);
  CHECK(hand.world.drive(0).target_velocity.norm() == 0);
  CHECK(hand.advanced);
}

TEST_CASE("steps of a grasp never allocate and give the same bits", "[grasp]") {
  std::vector<double> first;
  for (int run = 0; run < 2; ++run) {
    PinchingHand hand(9);
    GraspController<Hand34> controller = hand.controller();
    REQUIRE(controller.begin(hand.grasp) == "");
    std::vector<double> now;
    long allocated = 0;
    std::set<GraspPhase> phases;
    for (int i = 0; i < 200; ++i) {
      if (controller.phase() == GraspPhase::Hold && i < 120)
        REQUIRE(controller.move_by(Matrix3<double>::Identity(), Vec(1e-3, 0, 0)));
      if (i == 120) controller.release();
      phases.insert(controller.phase());
      const auto felt = hand.touches();
      const HandState<double> state = hand.world.hand(0);
      const long before = allocations();
      (void)controller.update(0.02, state, felt, hand.world.drive(0));
      allocated += allocations() - before;
      REQUIRE(hand.world.step(0.02).advanced);
      now.push_back(hand.world.drive(0).target.sum());
      now.push_back(hand.world.drive(0).torque.sum());
    }
    if (allocation_counting_works()) CHECK(allocated == 0);
    CHECK(phases == std::set<GraspPhase>{GraspPhase::Free, GraspPhase::Approach, GraspPhase::Close,
                                         GraspPhase::Hold, GraspPhase::Open});
    if (run == 1) CHECK(first == now);
    first = now;
  }
}

TEST_CASE("a grasp of nothing says that it touched nothing", "[grasp]") {
  PinchingHand hand(9);
  hand.world.input(0).clear();  // the sheet falls away before the hand is there
  GraspController<Hand34> controller = hand.controller();
  REQUIRE(controller.begin(hand.grasp) == "");
  (void)run_through(hand, controller, GraspPhase::Approach);
  const auto report = run_through(hand, controller, GraspPhase::Close);
  CHECK(report.phase == GraspPhase::Failed);
  CHECK(report.fault == GraspFault::NoTouch);
  CHECK(controller.describe(report).find("touched nothing") != std::string::npos);
  for (int i = 0; i < 100; ++i) (void)hand.step(controller);  // the hand comes to rest
  CHECK(hand.world.hand(0).velocities.norm() < 1e-3);
}

TEST_CASE("a load that slides raises the force, and a force at its limit is too weak", "[grasp]") {
  for (const double most : {10.0, 0.3}) {
    if (clothctl_test::kSanitized && most < 1) continue;
    PinchingHand hand(17);
    GraspSettings<double> settings;
    settings.most_force = most;
    hand.grasp.force = 0.3;  // 0.36 N of friction for 0.18 N of sheet, and the shake below
    settings.firm_contacts = 1;
    GraspController<Hand34> controller = hand.controller(settings);
    GraspReport<double> report = take(hand, controller);
    bool slid = false, weak = false;
    double highest = 0;
    for (int i = 0; i < 200 && report.phase == GraspPhase::Hold; ++i) {
      const double t = 0.02 * i;
      REQUIRE(controller.move_to(Matrix3<double>::Identity(),
                                 Vec(0.08 * (1 - std::cos(12.566 * t)), 0, 0)));
      report = hand.step(controller);
      slid = slid || report.slides;
      weak = weak || report.too_weak;
      highest = std::max(highest, report.wanted_force);
    }
    if (most > 1) {
      CHECK(report.phase == GraspPhase::Hold);
      CHECK(slid);
      CHECK(highest > 0.5);
      CHECK_FALSE(weak);
    } else {
      CHECK(slid);
      CHECK(weak);
      CHECK(report.slips > 0);
    }
  }
}

TEST_CASE("a hand opens whatever came before, and only once", "[grasp]") {
  int steps_once = 0;
  for (const int before : {0, 1, 2, 3}) {
    PinchingHand hand(9);
    GraspController<Hand34> controller = hand.controller();
    (void)take(hand, controller);
    if (before == 1) controller.stop();  // it rests, closed
    if (before == 2) {                   // a sensor fails
      auto felt = hand.touches();
      felt[0].normal_force = kNan;
      const auto bad = controller.update(0.02, hand.world.hand(0), felt, hand.world.drive(0));
      CHECK(bad.fault == GraspFault::BadInput);
      CHECK(controller.describe(bad) == "a force that a finger feels is not finite");
    }
    for (int i = 0; i < 3; ++i) (void)hand.step(controller);
    CHECK(hand.touches()[0].contacts > 0);
    controller.release();
    CHECK(controller.phase() == GraspPhase::Open);
    (void)hand.step(controller);
    CHECK_FALSE(controller.set_load(0, Vec(0, 0, 1)));
    int steps = 1;
    GraspReport<double> report;
    do {
      report = hand.step(controller);
      ++steps;
      if (before == 3 && steps < 10) controller.release();  // told again and again
    } while (report.phase == GraspPhase::Open && steps < 300);
    if (before == 0) steps_once = steps;
    CHECK(steps == steps_once);
    CHECK(report.phase == GraspPhase::Free);
    CHECK(report.fault == GraspFault::Nothing);
    CHECK(hand.world.drive(0).target_velocity.norm() == 0);
    for (int i = 0; i < 10; ++i) (void)hand.step(controller);
    CHECK(hand.touches()[0].contacts + hand.touches()[1].contacts == 0);
  }
}

TEST_CASE("fingers that miss the sheet for single steps in turn have not lost it", "[grasp]") {
  PinchingHand hand(9);
  GraspController<Hand34> controller = hand.controller();
  (void)take(hand, controller);
  for (std::size_t i = 0; i < 12; ++i) {
    auto felt = hand.touches();
    felt[i % 2] = PadTouch<double>();
    const auto report = controller.update(0.02, hand.world.hand(0), felt, hand.world.drive(0));
    CHECK(report.phase == GraspPhase::Hold);
  }
  // Rotations within the tolerance are taken, and renewed.
  const Matrix3<double> nearly = (1 + 2e-4) * Matrix3<double>::Identity();
  CHECK(controller.move_to(nearly, Vec::Zero()));
  for (int i = 0; i < 3; ++i) CHECK(hand.step(controller).phase == GraspPhase::Hold);
  CHECK(controller.move_finger_by(0, Matrix3<double>::Identity(), Vec::Zero()));
}

TEST_CASE("a finger that loses the sheet fails, and nothing jumps when it opens", "[grasp]") {
  PinchingHand hand(9);
  GraspController<Hand34> controller = hand.controller();
  (void)take(hand, controller);
  REQUIRE(controller.move_to(Matrix3<double>::Identity(), Vec(1, 0, 0)));
  const std::array<PadTouch<double>, 2> nothing{};
  GraspReport<double> report;
  for (int i = 0; i < 5; ++i) {
    report = controller.update(0.02, hand.world.hand(0), nothing, hand.world.drive(0));
    REQUIRE(hand.world.step(0.02).advanced);
  }
  CHECK(report.phase == GraspPhase::Failed);
  CHECK(report.fault == GraspFault::Lost);
  CHECK(controller.describe(report) == "finger 1 (index) lost the sheet");
  report = controller.update(0.02, hand.world.hand(0), nothing, hand.world.drive(0));
  CHECK(report.fault == GraspFault::Lost);  // it still says so
  const VectorX<double> rested = hand.world.drive(0).target;
  controller.release();
  (void)controller.update(0.02, hand.world.hand(0), nothing, hand.world.drive(0));
  CHECK((hand.world.drive(0).target - rested).head<3>().norm() < 2e-3);
}

TEST_CASE("a hand that follows exactly arrives, however fast its last step is", "[grasp]") {
  PinchingHand hand(9);
  for (const double dt : {0.005, 0.01, 0.02, 0.04}) {
    for (int k = 0; k < 20; ++k) {
      GraspController<Hand34> controller = hand.controller();
      Grasp<double> grasp = hand.grasp;
      grasp.keyframes[0][k % 3] += 0.02 + 0.015 * k;
      REQUIRE(controller.begin(grasp) == "");
      HandState<double> state = hand.world.hand(0);
      GraspReport<double> report;
      const std::array<PadTouch<double>, 2> nothing{};
      for (int i = 0; i < 500 && report.phase != GraspPhase::Close; ++i) {
        state.positions = controller.tracker().positions();
        report = controller.update(dt, state, nothing, hand.world.drive(0));
      }
      for (int i = 0; i < 2; ++i) {
        state.positions = controller.tracker().positions();
        report = controller.update(dt, state, nothing, hand.world.drive(0));
      }
      CHECK(report.phase == GraspPhase::Close);
    }
  }
}

TEST_CASE("a finger moves by itself, in a grasp that has turned", "[grasp]") {
  PinchingHand hand(9);
  GraspController<Hand34> controller = hand.controller();
  REQUIRE(controller.begin(hand.grasp) == "");
  const Matrix3<double> I = Matrix3<double>::Identity();
  CHECK_FALSE(controller.move_finger_by(0, I, Vec(1e-3, 0, 0)));  // it does not hold yet
  for (int i = 0; i < 200 && controller.phase() != GraspPhase::Hold; ++i)
    (void)hand.step(controller);
  REQUIRE(controller.phase() == GraspPhase::Hold);
  REQUIRE(controller.move_to(rotation_exp<double>(Vec(0, 0.3, 0)), Vec(0.02, 0, 0)));
  for (int i = 0; i < 60; ++i) (void)hand.step(controller);
  CHECK_FALSE(controller.move_finger_by(2, I, Vec(1e-3, 0, 0)));
  CHECK_FALSE(controller.move_finger_by(-1, I, Vec(1e-3, 0, 0)));
  CHECK_FALSE(controller.move_finger_by(0, Matrix3<double>(2 * I), Vec(1e-3, 0, 0)));
  CHECK_FALSE(controller.move_finger_by(0, I, Vec(kNan, 0, 0)));
  const auto at = [&](int finger) {
    Matrix3<double> R;
    Vec p;
    controller.tracker().pose(finger, R, p);
    return p;
  };
  const Vec thumb = at(0), index = at(1), way(1.5e-3, 0, -1e-3);
  REQUIRE(controller.move_finger_by(0, I, way));
  (void)hand.step(controller);
  // Across the direction to press; along it, the force says where a finger is.
  const Vec moved = at(0) - thumb - way, stayed = at(1) - index;
  CHECK(Vec(moved[0], 0, moved[2]).norm() < 5e-5);
  CHECK(Vec(stayed[0], 0, stayed[2]).norm() < 5e-5);
}

TEST_CASE("a grasp without keyframes goes on with what is held", "[grasp]") {
  PinchingHand hand(9);
  GraspController<Hand34> controller = hand.controller();
  REQUIRE(controller.begin(hand.grasp) == "");
  for (int i = 0; i < 200 && controller.phase() != GraspPhase::Hold; ++i)
    (void)hand.step(controller);
  Matrix3<double> R;
  Vec before, after;
  controller.tracker().pose(0, R, before);
  Grasp<double> harder = hand.grasp;
  harder.keyframes.clear();
  harder.force = 5;
  REQUIRE(controller.begin(harder) == "");
  CHECK(controller.phase() == GraspPhase::Close);
  for (int i = 0; i < 200 && controller.phase() != GraspPhase::Hold; ++i) {
    (void)hand.step(controller);
    for (const auto& felt : hand.touches()) CHECK(felt.contacts > 0);
  }
  REQUIRE(controller.phase() == GraspPhase::Hold);
  controller.tracker().pose(0, R, after);
  CHECK((after - before).norm() < 3e-3);
  CHECK(hand.touches()[0].normal_force == Approx(5).epsilon(0.3));
}

TEST_CASE("a grasp that goes on holds what the load needs, and says what is lost", "[grasp]") {
  PinchingHand hand(9);
  GraspController<Hand34> controller = hand.controller();
  (void)take(hand, controller);
  // What a sheet of 3 N on each finger would let them feel.
  std::array<PadTouch<double>, 2> heavy{};
  for (auto& t : heavy) {
    t.normal_force = 7.5;
    t.tangential_force = 3;
    t.contacts = 6;
  }
  const auto feel = [&](const std::array<PadTouch<double>, 2>& felt) {
    HandState<double> state = hand.world.hand(0);
    state.positions = controller.tracker().positions();
    return controller.update(0.02, state, felt, hand.world.drive(0));
  };
  REQUIRE(controller.set_load(0, Vec(0, 0, 3)));
  GraspReport<double> report = feel(heavy);
  CHECK(report.wanted_force == Approx(7.5));  // 1.5 · 3 N / 0.6
  report = feel(heavy);
  const VectorX<double> torque = hand.world.drive(0).torque;
  Grasp<double> same = hand.grasp;
  same.keyframes.clear();
  REQUIRE(controller.begin(same) == "");
  report = feel(heavy);
  CHECK(report.phase == GraspPhase::Close);
  CHECK(report.wanted_force == Approx(7.5));
  CHECK((hand.world.drive(0).torque - torque).norm() < 0.05 * torque.norm());
  // Fingers that have had the sheet and no longer do.
  for (int i = 0; i < 300 && report.phase == GraspPhase::Close; ++i) report = feel({});
  CHECK(report.fault == GraspFault::Lost);
}

TEST_CASE("a finger that is not firm does not slide because another one does", "[grasp]") {
  PinchingHand hand(9);
  GraspController<Hand34> controller = hand.controller();
  Grasp<double> grasp = hand.grasp;
  grasp.together = false;
  REQUIRE(controller.begin(grasp) == "");
  std::array<PadTouch<double>, 2> felt{};
  for (auto& t : felt) {
    t.normal_force = 1;
    t.contacts = 6;
  }
  felt[1].normal_force = 3;
  felt[1].sliding = 6;
  HandState<double> state = hand.world.hand(0);
  GraspReport<double> report;
  for (int i = 0; i < 300 && report.phase != GraspPhase::Failed; ++i) {
    state.positions = controller.tracker().positions();
    report = controller.update(0.02, state, felt, hand.world.drive(0));
  }
  CHECK(controller.describe(report) ==
        "finger 0 (thumb) did not hold firmly in time: 1 N of 3 N, 6 contacts stick");
}

TEST_CASE("a grasp that is not there, or not firm, says why", "[grasp]") {
  PinchingHand hand(9);
  GraspController<Hand34> controller = hand.controller();
  REQUIRE(controller.begin(hand.grasp) == "");
  // The base is measured 5 mm beside where it was sent.
  HandState<double> state = hand.world.hand(0);
  GraspReport<double> report;
  for (int i = 0; i < 100 && report.phase != GraspPhase::Failed; ++i) {
    state.positions = controller.tracker().positions();
    state.positions[0] += 5e-3;
    report = controller.update(0.02, state, hand.touches(), hand.world.drive(0));
  }
  CHECK(report.fault == GraspFault::NotThere);
  CHECK(hand.world.drive(0).target_velocity.norm() == 0);

  // Fingers that feel 1 N and no more.
  REQUIRE(controller.begin(hand.grasp) == "");
  std::array<PadTouch<double>, 2> weak{};
  for (auto& t : weak) {
    t.normal_force = 1;
    t.contacts = 6;
  }
  report = {};
  for (int i = 0; i < 300 && report.phase != GraspPhase::Failed; ++i) {
    state.positions = controller.tracker().positions();
    report = controller.update(0.02, state, weak, hand.world.drive(0));
    CHECK(report.depth <= 0.015);
  }
  CHECK(report.fault == GraspFault::NotFirm);
  for (int i = 0; i < 2; ++i) {
    CHECK(controller.describe(report) ==
          "finger 0 (thumb) did not hold firmly in time: 1 N of 3 N, 6 contacts stick");
    report = controller.update(0.02, state, weak, hand.world.drive(0));
  }
  CHECK(report.depth == Approx(0.015));
}

TEST_CASE("fingers that close each by themselves meet their own forces", "[grasp]") {
  PinchingHand hand(9);
  hand.grasp.together = false;
  GraspController<Hand34> controller = hand.controller();
  REQUIRE(controller.begin(hand.grasp) == "");
  // Two springs of 2000 N/m, one of them 4 mm behind the other.
  HandState<double> state = hand.world.hand(0);
  std::array<PadTouch<double>, 2> felt{};
  GraspReport<double> report;
  std::array<Vec, 2> from{};
  for (int i = 0; i < 400 && report.phase != GraspPhase::Hold; ++i) {
    state.positions = controller.tracker().positions();
    report = controller.update(0.02, state, felt, hand.world.drive(0));
    for (int f = 0; f < 2; ++f) {
      Matrix3<double> R;
      Vec at;
      controller.tracker().pose(f, R, at);
      const auto k = static_cast<std::size_t>(f);
      if (report.phase == GraspPhase::Approach) from[k] = at;
      const double depth = (at - from[k]).dot(hand.grasp.fingers[k].press) - (f == 0 ? 0 : 4e-3);
      felt[k].normal_force = std::max(0.0, 2000 * depth);
      felt[k].contacts = depth > 0 ? 5 : 0;
    }
  }
  REQUIRE(report.phase == GraspPhase::Hold);
  CHECK(felt[0].normal_force == Approx(3).epsilon(0.25));
  CHECK(felt[1].normal_force == Approx(3).epsilon(0.25));
}

TEST_CASE("a hand that has opened retreats, and the sheet is free", "[grasp]") {
  PinchingHand hand(9);
  GraspController<Hand34> controller = hand.controller();
  (void)take(hand, controller);
  controller.release();
  (void)run_through(hand, controller, GraspPhase::Open);
  REQUIRE(controller.phase() == GraspPhase::Free);
  Grasp<double> away;
  away.keyframes = {hand.poses.wait};
  REQUIRE(controller.begin(away) == "");
  CHECK(controller.phase() == GraspPhase::Approach);
  const auto fingerless = [&] {
    const auto report = controller.update(hand.dt, hand.world.hand(0), {}, hand.world.drive(0));
    REQUIRE(hand.world.step(hand.dt).advanced);
    return report;
  };
  for (int i = 0; i < 300 && controller.phase() == GraspPhase::Approach; ++i) (void)fingerless();
  CHECK(controller.phase() == GraspPhase::Free);
  for (int i = 0; i < 50; ++i) (void)fingerless();
  CHECK((hand.world.hand(0).positions - hand.poses.wait).norm() < 0.02);
  CHECK(hand.world.hand(0).velocities.norm() < 0.02);
  // Nothing holds what fell from between the fingertips.
  CHECK(hand.world.state(0).positions.row(2).maxCoeff() < hand.at.z() - 0.5);
  CHECK_FALSE(controller.move_to(Matrix3<double>::Identity(), Vec::Zero()));
}

TEST_CASE("bad grasps and measurements are refused in words, and nothing changes", "[grasp]") {
  PinchingHand hand(9);
  GraspController<Hand34> controller = hand.controller();
  const auto refused = [&](auto change) {
    Grasp<double> bad = hand.grasp;
    change(bad);
    const std::string message = controller.begin(bad);
    CHECK(controller.phase() == GraspPhase::Free);
    return message;
  };
  CHECK(refused([](auto& g) {
          g.fingers.clear();
          g.keyframes.clear();
        }) == "the grasp has neither fingers nor keyframes");
  CHECK(refused([](auto& g) { g.fingers[1].finger = 7; }) ==
        "finger 1 of the grasp is finger 7 of a hand of 5");
  CHECK(refused([](auto& g) { g.fingers[1].finger = 0; }) ==
        "finger 1 of the grasp is finger 0 of the hand, as finger 0 is");
  CHECK(refused([](auto& g) { g.fingers[0].press = Vec(0, kNan, 0); }) ==
        "finger 0 of the grasp has a direction to press that is not a unit vector");
  CHECK(refused([](auto& g) { g.force = -1; }).find("the force is -1 N") == 0);
  CHECK(refused([](auto& g) { g.force = 11; }).find("the force is 11 N") == 0);
  CHECK(refused([](auto& g) { g.keyframes.clear(); }) ==
        "the grasp has no keyframes, and the hand holds nothing to go on with");
  CHECK(refused([](auto& g) { g.keyframes[0].resize(3); }).find("keyframe 0 has 3 entries") == 0);
  CHECK(refused([](auto& g) { g.keyframes[0][2] = kNan; }).find("keyframe 0") == 0);
  CHECK(refused([](auto& g) { g.keyframes[0][4] = 5; }) ==
        "keyframe 0 is 5 at position 4, beyond its limits -1.45 and 1.45");
  CHECK_FALSE(controller.move_to(Matrix3<double>::Identity(), Vec::Zero()));  // it does not hold
  CHECK_FALSE(controller.set_force(kNan));

  GraspSettings<double> settings;
  settings.friction = 0;
  const auto slippery =
      GraspController<Hand34>::create(hand.tree, hand.geometry.fingers, hand.poses.wait, settings);
  REQUIRE_FALSE(slippery);
  CHECK(slippery.error() == "friction is 0, must be finite and positive: fingers hold by friction");
  CHECK(GraspController<Hand34>::create(hand.tree, {}, hand.poses.wait).error() ==
        "the hand has no finger pads");
  CHECK(GraspController<Hand34>::create(hand.tree, hand.geometry.fingers, VectorX<double>(3))
            .error()
            .find("q has 3 entries") == 0);

  REQUIRE(controller.begin(hand.grasp) == "");
  (void)hand.step(controller);
  auto felt = hand.touches();
  felt[1].normal_force = kNan;
  const auto report = controller.update(0.02, hand.world.hand(0), felt, hand.world.drive(0));
  CHECK(report.fault == GraspFault::BadInput);
  CHECK(hand.world.drive(0).target.allFinite());
  CHECK(hand.world.drive(0).target_velocity.norm() == 0);
}

TEST_CASE("a grasp moves at most at its largest speeds", "[grasp]") {
  PinchingHand hand(9);
  GraspSettings<double> settings;
  settings.hold_speed = 0.5;
  settings.turn_speed = 0.5;
  GraspController<Hand34> controller = hand.controller(settings);
  (void)take(hand, controller);
  Matrix3<double> R0, R1;
  Vec a, b;
  controller.tracker().pose(0, R0, a);
  const Matrix3<double> R_first = R0;
  REQUIRE(controller.move_by(rotation_exp<double>(Vec(0, 0, 1)), Vec(1, 0, 0)));
  double way_left = 0;
  for (int i = 0; i < 5; ++i) {
    const GraspReport<double> report = hand.step(controller);
    if (i > 0) CHECK(way_left - report.way_left == Approx(0.5 * 0.02));
    way_left = report.way_left;
    CHECK(report.turn_left == Approx(1 - 0.5 * 0.02 * (i + 1)));
    controller.tracker().pose(0, R1, b);
    CHECK((b - a).norm() < 0.02 * (0.5 + 0.5 * 0.02) + 2e-3);
    CHECK(rotation_log<double>(R1 * R0.transpose()).norm() < 0.5 * 0.02 + 0.01);
    a = b;
    R0 = R1;
  }
  for (int i = 0; i < 149; ++i) (void)hand.step(controller);
  const GraspReport<double> report = hand.step(controller);
  CHECK(report.way_left == 0);
  CHECK(report.turn_left == 0);
  controller.tracker().pose(0, R1, b);
  CHECK(rotation_log<double>(R1 * R_first.transpose()).norm() == Approx(1).epsilon(0.02));
  // One finger alone is behind, too.
  REQUIRE(controller.move_finger_by(0, Matrix3<double>::Identity(), Vec(0.02, 0, 0)));
  CHECK(hand.step(controller).way_left == Approx(0.02 - 0.5 * 0.02));
}

// What is refused needs no hand of ours.
TEST_CASE("any robot of the concept can be given a grasp controller", "[grasp]") {
  using Gantry = GantryArchetype<double>;
  const Gantry gantry;
  const auto controller = GraspController<Gantry, double>::create(
      gantry, {{"hook", 1, Vec::Zero(), Vec(0, 0, -1)}}, Vec(0, 0, 0.5));
  REQUIRE(controller);
  CHECK(controller->phase() == GraspPhase::Free);
}
