#include "clothctl/grasp/grasp_sequence.hpp"

#include <cmath>
#include <limits>
#include <vector>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/grasp/held_grips.hpp"
#include "clothctl/grasp/rectify.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/grasping.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Vec = Vector3<double>;
using Sequence = GraspSequence<Hand34>;

/// One step of sequence and world; the sequence gets what all fingers feel.
GraspReport<double> step(PinchingHand& hand, Sequence& sequence) {
  std::vector<PadTouch<double>> felt(hand.geometry.fingers.size());
  const auto two = hand.touches();
  felt[0] = two[0];
  felt[1] = two[1];
  const auto report = sequence.update(hand.dt, hand.world.hand(0), felt, hand.world.drive(0));
  REQUIRE(hand.world.step(hand.dt).advanced);
  return report;
}

ContactPhase<double> phase_of(const Grasp<double>& grasp, double seconds, bool release = true) {
  return {grasp, seconds, release};
}

}  // namespace

TEST_CASE("a hand goes through contact phases: grasp, hold, let go, grasp again", "[grasp]") {
  PinchingHand hand(9);
  REQUIRE(hand.poses.status == GraspPoseStatus::Found);
  auto controller = hand.controller();
  Grasp<double> again = hand.grasp;  // other force; along the same way back and forth
  again.force = 2;
  again.keyframes = {hand.poses.wait, hand.poses.touch};
  Grasp<double> harder = hand.grasp;
  harder.force = 4;
  harder.keyframes.clear();  // goes on with what is held
  auto sequence = Sequence::create(controller, {phase_of(hand.grasp, 0.4),
                                                phase_of(again, 0.3, false), phase_of(harder, 0.5)})
                      .value();
  CHECK(sequence.phase() == -1);
  CHECK(!sequence.done());
  std::vector<GraspPhase> seen;
  std::vector<int> begun;
  std::vector<double> forces;
  for (int i = 0; i < 800 && !sequence.done(); ++i) {
    const GraspReport<double> report = step(hand, sequence);
    REQUIRE(report.phase != GraspPhase::Failed);
    if (sequence.began()) begun.push_back(sequence.phase());
    if (seen.empty() || seen.back() != report.phase) seen.push_back(report.phase);
    if (report.phase == GraspPhase::Hold) forces.push_back(report.mean_force);
  }
  CHECK(sequence.done());
  CHECK(sequence.fault().empty());
  CHECK(begun == std::vector<int>{0, 1, 2});
  using P = GraspPhase;
  CHECK(seen == std::vector<P>{P::Approach, P::Close, P::Hold, P::Open, P::Free, P::Approach,
                               P::Close, P::Hold, P::Close, P::Hold, P::Open, P::Free});
  REQUIRE(forces.size() > 20);
  CHECK(forces[15] == Approx(3).epsilon(0.1));
  CHECK(forces.back() == Approx(4).epsilon(0.1));
  // The hand is open, and further updates leave it there.
  for (int i = 0; i < 20; ++i) CHECK(step(hand, sequence).phase == P::Free);
  CHECK(hand.world.pad_contacts(hand.in.pads[0]).empty());
}

TEST_CASE("a planner goes on from one contact phase to the next", "[grasp]") {
  PinchingHand hand(9);
  auto controller = hand.controller();
  Grasp<double> again = hand.grasp;
  again.keyframes = {hand.poses.wait, hand.poses.touch};
  auto sequence =
      Sequence::create(controller, {phase_of(hand.grasp, 0.5), phase_of(again, 0.5)}).value();
  auto contacts =
      StaticContacts<double>::create(hand.world, 0, {hand.in.segments[0], hand.in.segments[1]})
          .value();
  const MassSpring<double> model = hanging_sheet(9);
  const MassSpringResponse<float> response(model);
  PlannerSetup<double> setup;
  setup.triangles = model.network().triangles;
  setup.features.add_point(4);
  PlannerSettings<double> settings;
  settings.command = PlantCommand::Position;
  using Predictor = LinearisedPredictor<MassSpringResponse<float>>;
  std::vector<Planner<Predictor>> planner;  // one, made in the first phase
  PlanResult<double> plan;
  const ClothState<double>& cloth = hand.world.state(0);
  const Vec press = hand.grasp.fingers[0].press;
  std::vector<HoldingFinger<double>> holding{{0, press}, {1, -press}};
  int taken = -1, planned[2] = {0, 0};
  Vec rest = Vec::Zero();
  double from = 0;  // s
  for (int i = 0; i < 800 && !sequence.done(); ++i) {
    const auto report = step(hand, sequence);
    REQUIRE(report.phase != GraspPhase::Failed);
    contacts.update(hand.world);
    if (report.phase != GraspPhase::Hold || sequence.held() < 0.1) continue;
    if (taken != sequence.phase()) {
      setup.grips = {
          make_held_grip<double>(contacts, holding, cloth.positions, setup.triangles).value()};
      if (planner.empty()) {
        planner.push_back(
            Planner<Predictor>::create(setup, settings, Predictor{response}, cloth.positions)
                .value());
      } else {
        REQUIRE(planner[0].set_grips(setup.grips, cloth.positions).empty());
      }
      plan = planner[0].make_result();
      taken = sequence.phase();
      rest = cloth.positions.col(4);
      from = hand.dt * i;
    }
    const auto target = [&](Index, double t) { return Vec(rest + Vec(0, 0.01 * (t - from), 0)); };
    REQUIRE(
        can_apply(planner[0].plan(cloth.positions, cloth.velocities, hand.dt * i, target, plan)));
    ++planned[sequence.phase()];
    // The sheet stays on its pins, so the hand stays, too.
    const Points<double> now = cloth.positions(Eigen::all, plan.input.driven_vertices);
    const auto moved = rectify<double>(now, plan.input.driven_positions, VectorX<double>(),
                                       Matrix3<double>::Identity());
    REQUIRE(moved.found());
    CHECK(plan.input.driven_vertices == setup.grips[0].vertices());
  }
  CHECK(sequence.done());
  CHECK(planned[0] >= 15);
  CHECK(planned[1] >= 15);
}

TEST_CASE("the caller may end a contact phase, and choose the next", "[grasp]") {
  PinchingHand hand(9);
  auto controller = hand.controller();
  auto sequence = Sequence::create(controller, {ContactPhase<double>{hand.grasp}}).value();
  CHECK(!sequence.end_phase());
  int i = 0;
  for (; i < 300 && controller.phase() != GraspPhase::Hold; ++i) (void)step(hand, sequence);
  REQUIRE(controller.phase() == GraspPhase::Hold);
  long before = 0;
  for (int k = 0; k < 80; ++k) {
    if (k == 30) before = allocations();
    std::array<PadTouch<double>, 5> felt{};
    const auto two = hand.touches();
    felt[0] = two[0];
    felt[1] = two[1];
    (void)sequence.update(hand.dt, hand.world.hand(0), felt, hand.world.drive(0));
    (void)hand.world.step(hand.dt);
  }
  const long after = allocations();
  if (allocation_counting_works()) CHECK(after == before);
  CHECK(sequence.held() > 1.5);
  CHECK(sequence.begin_phase(1) == "there is no contact phase 1");
  CHECK(sequence.fault() == "there is no contact phase 1");
  CHECK(controller.phase() == GraspPhase::Hold);  // nothing has changed
  CHECK(sequence.end_phase());
  CHECK(!sequence.end_phase());
  for (i = 0; i < 100 && !sequence.done(); ++i) (void)step(hand, sequence);
  CHECK(sequence.done());
  CHECK(sequence.begin_phase(0).empty());
  CHECK(step(hand, sequence).phase == GraspPhase::Approach);
  CHECK(!sequence.done());
}

TEST_CASE("a phase that the caller begins is told by the next update", "[grasp]") {
  PinchingHand hand(9);
  auto controller = hand.controller();
  Grasp<double> harder = hand.grasp;
  harder.force = 4;
  harder.keyframes.clear();
  const double infinity = std::numeric_limits<double>::infinity();
  auto sequence =
      Sequence::create(controller, {phase_of(hand.grasp, infinity, false), phase_of(harder, 0.2)})
          .value();
  std::vector<int> begun;
  for (int i = 0; i < 300 && sequence.phase() < 1; ++i) {
    (void)step(hand, sequence);
    if (sequence.began()) begun.push_back(sequence.phase());
    if (controller.phase() == GraspPhase::Hold) CHECK(sequence.end_phase());
  }
  for (int i = 0; i < 3; ++i) {
    (void)step(hand, sequence);
    if (sequence.began()) begun.push_back(sequence.phase());
  }
  CHECK(begun == std::vector<int>{0, 1});
}

TEST_CASE("a contact phase without fingers takes the hand away", "[grasp]") {
  PinchingHand hand(9);
  auto controller = hand.controller();
  Grasp<double> away;
  away.keyframes = {hand.poses.wait};
  Grasp<double> again = hand.grasp;
  auto sequence = Sequence::create(controller, {phase_of(hand.grasp, 0.1), phase_of(away, 0),
                                                phase_of(again, 0.1)})
                      .value();
  std::vector<int> begun;
  for (int i = 0; i < 800 && !sequence.done() && sequence.fault().empty(); ++i) {
    const auto report = step(hand, sequence);
    REQUIRE(report.phase != GraspPhase::Failed);
    if (sequence.began()) begun.push_back(sequence.phase());
  }
  CHECK(begun == std::vector<int>{0, 1, 2});
  CHECK(sequence.done());
  CHECK(controller.phase() == GraspPhase::Free);
}

TEST_CASE("contact phases that cannot be are refused with words", "[grasp]") {
  PinchingHand hand(9);
  auto controller = hand.controller();
  const auto refused = [&](std::vector<ContactPhase<double>> phases) {
    auto made = Sequence::create(controller, std::move(phases));
    return made ? std::string("made") : made.error();
  };
  Grasp<double> none = hand.grasp, foreign = hand.grasp;
  none.keyframes.clear();
  foreign.fingers[1].finger = 7;
  CHECK(refused({}) == "there are no contact phases");
  CHECK(refused({phase_of(hand.grasp, -1)}) == "contact phase 0: lasts -1 s, must not be negative");
  CHECK(refused({phase_of(hand.grasp, 1), phase_of(hand.grasp, std::nan(""))})
            .rfind("contact phase 1: lasts ", 0) == 0);
  CHECK(refused({phase_of(hand.grasp, 1), phase_of(foreign, 1)}) ==
        "contact phase 1: finger 1 of the grasp is finger 7 of a hand of 5");
  const std::string nothing = "has no keyframes, and the hand holds nothing to go on with";
  CHECK(refused({phase_of(none, 1)}) == "contact phase 0: " + nothing);
  CHECK(refused({phase_of(hand.grasp, 1), phase_of(none, 1)}) == "contact phase 1: " + nothing);
  CHECK(refused({phase_of(hand.grasp, 1, false), phase_of(none, 1)}) == "made");
  // What a grasp lacks beyond that is told when its phase begins; the hand stays at rest.
  Grasp<double> wrong = hand.grasp;
  wrong.force = std::nan("");
  auto sequence = Sequence::create(controller, {phase_of(wrong, 1)}).value();
  CHECK(step(hand, sequence).phase == GraspPhase::Free);
  CHECK(sequence.fault().rfind("contact phase 0: the force is ", 0) == 0);
}

TEST_CASE("a first contact phase that cannot begin leaves the hand that holds as it is",
          "[grasp]") {
  PinchingHand hand(9);
  auto controller = hand.controller();
  auto first = Sequence::create(controller, {phase_of(hand.grasp, 10)}).value();
  for (int i = 0; i < 300 && controller.phase() != GraspPhase::Hold; ++i) (void)step(hand, first);
  REQUIRE(controller.phase() == GraspPhase::Hold);
  Grasp<double> harder = hand.grasp;
  harder.keyframes.clear();
  harder.force = 11;  // above most_force
  auto sequence = Sequence::create(controller, {phase_of(harder, 0)}).value();
  for (int i = 0; i < 3; ++i) CHECK(step(hand, sequence).phase == GraspPhase::Hold);
  CHECK(sequence.phase() == -1);
  CHECK_FALSE(sequence.done());
  CHECK(sequence.fault().rfind("contact phase 0: the force is 11", 0) == 0);
}
