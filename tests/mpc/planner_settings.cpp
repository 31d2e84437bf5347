// Default settings and profiles are valid, and every bad value is refused.

#include "clothctl/mpc/planner_settings.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("default settings and profiles are valid", "[mpc]", float, double) {
  using Settings = PlannerSettings<TestType>;
  for (const Settings& s : {Settings(), Settings::paper(), Settings::rollout()})
    CHECK(s.validate() == "");
  const Settings paper = Settings::paper();
  CHECK(paper.weights.feature == TestType(40));
  CHECK(paper.weights.force == TestType(0.01));
  CHECK(paper.weights.smooth == Approx(10 * 0.02 * 0.02));
  CHECK(paper.weights.shape == TestType(10));
  CHECK(paper.weights.anchor == TestType(0));
}

TEST_CASE("every bad setting is refused", "[mpc]") {
  using Settings = PlannerSettings<double>;
  const auto refused = [](auto&& breaking) {
    Settings s;
    breaking(s);
    return !s.validate().empty();
  };
  CHECK(refused([](Settings& s) { s.horizon = 0; }));
  CHECK(refused([](Settings& s) { s.horizon = -3; }));
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               inf = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, inf, -1.0}) {
    CHECK(refused([&](Settings& s) { s.dt = bad; }));
    CHECK(refused([&](Settings& s) { s.gravity = bad; }));
    CHECK(refused([&](Settings& s) { s.max_step = bad; }));
    CHECK(refused([&](Settings& s) { s.max_change = bad; }));
    CHECK(refused([&](Settings& s) { s.most_anchor = bad; }));
    CHECK(refused([&](Settings& s) { s.offset_time = bad; }));
    CHECK(refused([&](Settings& s) { s.least_agreement = bad; }));
    for (double PlannerWeights<double>::*weight :
         {&PlannerWeights<double>::feature, &PlannerWeights<double>::force,
          &PlannerWeights<double>::cone, &PlannerWeights<double>::velocity,
          &PlannerWeights<double>::smooth, &PlannerWeights<double>::shape,
          &PlannerWeights<double>::anchor, &PlannerWeights<double>::patch,
          &PlannerWeights<double>::limit, &PlannerWeights<double>::jerk,
          &PlannerWeights<double>::step}) {
      CHECK(refused([&](Settings& s) { s.weights.*weight = bad; }));
    }
  }
  for (const double bad : {nan, inf}) CHECK(refused([&](Settings& s) { s.gravity_load[1] = bad; }));
  CHECK(refused([](Settings& s) { s.dt = 0.0; }));
  CHECK(refused([](Settings& s) { s.least_agreement = 1.0; }));
  CHECK(refused([](Settings& s) { s.gravity = 0.0; }));
  CHECK(refused([](Settings& s) { s.max_step = 0.0; }));
  CHECK(refused([](Settings& s) {
    s.input = GripInput::Pose;
    s.command = PlantCommand::Position;
  }));
  Settings named;
  named.weights.shape = -2.5;
  CHECK(named.validate().find("shape is -2.5") != std::string::npos);
  CHECK(Settings().validate().empty());
}
