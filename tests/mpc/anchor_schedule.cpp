// The weight of the hand anchor grows where predictions over half a window cannot be trusted.

#include "clothctl/mpc/detail/anchor_schedule.hpp"

#include <array>
#include <cmath>

#include "../../examples/bring_your_own/cloth_plant.hpp"
#include "clothctl/cloth/settle.hpp"
#include "clothctl/mpc/loose_plant.hpp"
#include "clothctl/mpc/run_frame.hpp"
#include "mpc/instances.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"
#include "support/tier.hpp"

using namespace clothctl;

namespace {

// Two features that move by 2 cm a frame along x, predicted four frames ahead.
struct Scheduled {
  PlannerSettings<double> settings;
  detail::AnchorSchedule<double> schedule;
  PlanResult<double> result;
  Points<double> features = Points<double>::Zero(3, 2);
  MatrixX<double> predicted = MatrixX<double>::Constant(6, 8, 1e3);

  Scheduled() {
    settings.horizon = 8;
    settings.least_agreement = 0.9;
    settings.weights.anchor = 10;
    settings.most_anchor = 400;
    schedule.reserve(2, settings.horizon);
  }
  // Frames in which the features move as predicted, but for a share `wrong` of their motion.
  void run(int frames, double wrong) {
    for (int k = 0; k < frames; ++k) {
      schedule.measure(settings, features, result);
      for (Index i = 0; i < 2; ++i)
        predicted.block<3, 1>(3 * i, 3) = features.col(i) + V(0.08 * (1.0 + wrong), 0.0, 0.0);
      schedule.predict(predicted);
      features.row(0).array() += 0.02;
    }
  }
  using V = Vector3<double>;
};

// The game engine's cloth: explicit, single precision, hardly damped. 7×7 vertices are enough for
// the loop to pump energy into it.
struct Swaying {
  GridMesh<double> grid = make_grid<double>(7, 7, 0.5, 0.5).value();
  SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  game::Cloth cloth;
  Points<double> start;

  Swaying() {
    Points<double> x = grid.positions;
    for (Index i = 0; i < x.cols(); ++i) x(1, i) = -0.03 * std::cos(6.28 * x(0, i));
    x.row(0) *= 0.95;
    cloth = game::make_cloth(network, x);
    cloth.drag = 4;
    REQUIRE(settle(cloth, {grid.vertex(6, 0), grid.vertex(6, 6)}, 0.02, 6.0, 1e-2).advanced);
    cloth.drag = 0.2f;
    start = plant_traits<game::Cloth>::positions(cloth);
  }

  clothctl_test::FrozenPlanner planner(const PlannerSettings<double>& settings) const {
    PlannerSetup<double> setup;
    for (int col : {0, 6}) {
      setup.features.add_point(grid.vertex(0, col));
      setup.grips.push_back(make_pinch<double>({grid.vertex(6, col)}, 0.5, 20.0));
    }
    MassSpringSettings<double> same;
    same.drag = 0.2;
    const MassSpring<double> model = MassSpring<double>::create(network, same).value();
    return clothctl_test::FrozenPlanner::create(
               setup, settings, clothctl_test::FrozenPredictor(MassSpringResponse<float>(model)),
               start)
        .value();
  }

  Vector3<double> target(Index corner, double t) const {
    const double ramp = t > 0 ? 1 - std::exp(-t * t) : 0;
    return start.col(grid.vertex(0, corner == 0 ? 0 : 6)) +
           ramp * Vector3<double>(0.02 * std::sin(2 * t), 0.06 * std::sin(3 * t),
                                  0.04 * (1 - std::cos(2 * t)));
  }
};

// What came of a number of frames: errors over the last five seconds, when an error first passed
// 30 mm, and when the planner first said that it is losing.
struct Course {
  double mean_error = 0.0, max_error = 0.0, anchor_weight = 0.0;
  int lost = 1 << 20, said = 1 << 20;
};

Course follow(PlannerSettings<double> settings, int frames) {
  Swaying sheet;
  auto planner = sheet.planner(settings);
  PlanResult<double> plan = planner.make_result();
  Course course;
  const auto target = [&](Index i, double t) { return sheet.target(i, t); };
  for (int k = 0; k < frames; ++k) {
    const FrameReport<double> report = run_frame(planner, sheet.cloth, 0.02 * k, target, plan);
    REQUIRE(report.advanced());
    CHECK(report.plan == PlanStatus::Planned);
    CHECK(report.losing == plan.losing);
    if (report.losing) course.said = (std::min)(course.said, k);
    if (0.03 < report.max_error) course.lost = (std::min)(course.lost, k);
    if (k < frames - 250) continue;
    course.mean_error += report.mean_error / 250;
    course.max_error = (std::max)(course.max_error, report.max_error);
  }
  course.anchor_weight = plan.anchor_weight;
  return course;
}

}  // namespace

TEST_CASE("a right prediction leaves the anchor weight as it is", "[mpc]") {
  Scheduled s;
  s.run(300, 0.0);
  CHECK(s.result.window_agreement > 1.0 - 1e-12);
  CHECK(s.result.anchor_weight == 10.0);
  CHECK_FALSE(s.result.losing);
}

TEST_CASE("a prediction that is wrong half a window later raises the weight up to its bound",
          "[mpc]") {
  Scheduled s;
  s.run(200, 0.05);
  CHECK(s.result.window_agreement == Approx(0.95).epsilon(1e-3));
  CHECK(s.result.anchor_weight == 10.0);
  s.run(30, 0.4);
  const double soon = s.result.anchor_weight;
  CHECK(soon > 12.0);
  CHECK(soon <= 10.0 * std::exp2(4.0 * 0.02 * 30));
  s.run(300, 0.4);
  CHECK(s.result.anchor_weight == Approx(400.0));
  CHECK(s.result.losing);  // 0.6, and no room for more weight
  s.run(500, 0.0);
  CHECK(s.result.anchor_weight == Approx(400.0));  // it does not fall again
  CHECK_FALSE(s.result.losing);
  s.schedule.reset();
  s.run(5, 0.0);
  CHECK(s.result.anchor_weight == 10.0);
}

TEST_CASE("the weight stays where the settings do not let it grow", "[mpc]") {
  for (const int way : {0, 1, 2}) {
    Scheduled s;
    if (way == 0) s.settings.least_agreement = 0.0;
    if (way == 1) s.settings.most_anchor = 5.0;
    if (way == 2) s.settings.weights.anchor = 0.0;
    s.run(300, 0.6);
    CHECK(s.result.anchor_weight == s.settings.weights.anchor);
    CHECK(s.result.losing);
  }
}

TEST_CASE("predictions that the plant did not follow are not compared, and nothing allocates",
          "[mpc]") {
  Scheduled s;
  s.run(200, 0.0);
  s.features.row(2).array() += 0.5;  // the plant jumped
  s.schedule.forget();
  const long before = clothctl_test::allocations();
  s.run(50, 0.0);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(s.result.window_agreement > 1.0 - 1e-12);
}

TEST_CASE("a sheet that rests or trembles is measured against a millimetre a frame", "[mpc]") {
  Scheduled s;
  for (int k = 0; k < 200; ++k) {
    s.schedule.measure(s.settings, s.features, s.result);
    for (Index i = 0; i < 2; ++i)
      s.predicted.block<3, 1>(3 * i, 3) = s.features.col(i) + Vector3<double>(0.0, 2e-4, 0.0);
    s.schedule.predict(s.predicted);
  }
  CHECK(s.result.window_agreement == Approx(0.95).epsilon(1e-2));  // 0.2 mm of 4 mm
}

TEST_CASE("feedback does not pump energy into a lightly damped cloth of another engine", "[mpc]") {
  PlannerSettings<double> settings = loose_plant<double>().planner;
  settings.weights.anchor = 10.0;   // a weight at which the loop is unstable
  if (clothctl_test::kSanitized) {  // the outcome takes minutes there
    CHECK(follow(settings, 60).max_error < 0.05);
    return;
  }
  const Course bounded = follow(settings, 1000);
  CAPTURE(bounded.mean_error, bounded.max_error, bounded.anchor_weight);
  CHECK(bounded.mean_error < 0.005);
  CHECK(bounded.max_error < 0.015);
  CHECK(bounded.lost > 1000);
  CHECK(bounded.anchor_weight > 100.0);
  settings.least_agreement = 0.0;
  const Course pumped = follow(settings, 450);
  CAPTURE(pumped.mean_error, pumped.lost, pumped.said);
  CHECK(pumped.mean_error > 0.05);
  CHECK(pumped.said < pumped.lost);  // it says so before the features have lost their targets
}
