// One frame of control: its calls, refusals and measurements. Planner and plant are stand-ins that
// count their calls.

#include "clothctl/mpc/run_frame.hpp"

#include <limits>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using V = Vector3<double>;

// Moves vertex 1 by 0.1 m along x in each frame.
struct CountingPlanner {
  using Scalar = double;
  PlannerSettings<double> values;
  PlannerSetup<double> parts;
  Index vertices = 2;
  PlanStatus answer = PlanStatus::Planned;
  int plans = 0;
  double planned_at = -1;
  V air = V::Zero();

  CountingPlanner() {
    parts.features.add_point(1);
    parts.features.add_centroid({0, 1});
    values.gravity_load = {0, 0, 3};
  }
  const PlannerSettings<double>& settings() const { return values; }
  const PlannerSetup<double>& setup() const { return parts; }
  Index vertex_count() const { return vertices; }
  template <class Target, class Wind>
  PlanStatus plan(const PointsView<double>& x, const PointsView<double>&, double t, const Target&,
                  const Wind& wind, PlanResult<double>& result) {
    ++plans;
    planned_at = t;
    air = wind(t);
    result.input.driven_positions.col(0) = x.col(1) + V(0.1, 0, 0);
    return answer;
  }
  static PlanResult<double> make_result() {
    PlanResult<double> result;
    result.input.driven_vertices = {1};
    result.input.driven_positions.setZero(3, 1);
    result.input.forces.setZero(3, 0);
    return result;
  }
};

// Two vertices that stay where they are put.
struct PlainPlant {
  Points<double> x = Points<double>::Zero(3, 2), v = x;
  ClothInput<double> input = {};
  int applied = 0, advanced = 0;
  bool works = true;

  Index vertex_count() const { return 2; }
  const Points<double>& positions() const { return x; }
  const Points<double>& velocities() const { return v; }
  void apply(const ClothInput<double>& given) {
    input = given;
    ++applied;
  }
  StepReport<double> advance(double) {
    ++advanced;
    if (works) x.col(1) = input.driven_positions.col(0);
    return {works ? StepStatus::Converged : StepStatus::NumericalFailure, works, 0.0, 1};
  }
};
// The same with the optional hooks.
struct HookedPlant : PlainPlant {
  V load = {0, 0, 3};
  double step = 0.02;
  V gravity_load() const { return load; }
  double time_step() const { return step; }
};

// Returns positions by value, as a plant does that converts them.
struct ConvertingPlant : PlainPlant {
  Points<double> positions() const { return x; }
};

V target(Index feature, double t) { return {0.1 * t / 0.02, feature == 0 ? 0.003 : 0.001, 0}; }

}  // namespace

TEST_CASE("a frame plans, applies, advances and measures", "[mpc]") {
  CountingPlanner planner;
  PlainPlant plant;
  PlanResult<double> result = CountingPlanner::make_result();
  plant.input = result.input;  // allocates the memory
  const auto gust = [](double t) { return V(t, 1, 2); };
  const long before = clothctl_test::allocations();
  const FrameReport<double> report = run_frame(planner, plant, 0.0, target, gust, result);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(report.advanced());
  CHECK(report.plan == PlanStatus::Planned);
  CHECK(report.step.iterations == 1);
  CHECK((planner.plans == 1 && plant.applied == 1 && plant.advanced == 1));
  CHECK(plant.input.wind == V(0, 1, 2));
  CHECK(planner.air == V(0, 1, 2));
  // Vertex 1 is at x = 0.1 and the centroid at 0.05. The targets at the end of the frame are (0.1,
  // 0.003, 0) and (0.1, 0.001, 0).
  const double first = 0.003, second = std::hypot(0.05, 0.001);
  CHECK(report.mean_error == Approx((first + second) / 2));
  CHECK(report.max_error == Approx(second));

  CHECK(run_frame(planner, plant, 0.02, target, result).advanced());
  CHECK(planner.planned_at == 0.02);
  CHECK(plant.input.wind == V::Zero());
}

TEST_CASE("run_frame measures a plant that returns its positions by value", "[mpc]") {
  CountingPlanner planner;
  ConvertingPlant plant;
  PlanResult<double> result = CountingPlanner::make_result();
  const FrameReport<double> report = run_frame(planner, plant, 0.0, target, result);
  CHECK(report.advanced());
  CHECK(report.mean_error == Approx((0.003 + std::hypot(0.05, 0.001)) / 2));
}

TEST_CASE("a plan that must not be applied leaves the plant unchanged", "[mpc]") {
  for (const PlanStatus bad : {PlanStatus::InvalidInput, PlanStatus::Failed}) {
    CountingPlanner planner;
    planner.answer = bad;
    PlainPlant plant;
    PlanResult<double> result = CountingPlanner::make_result();
    const FrameReport<double> report = run_frame(planner, plant, 0.0, target, result);
    CHECK(report.status == FrameStatus::NotPlanned);
    CHECK(report.plan == bad);
    CHECK_FALSE(report.advanced());
    CHECK((plant.applied == 0 && plant.advanced == 0));
  }
  for (const PlanStatus good : {PlanStatus::Suboptimal, PlanStatus::Relaxed}) {
    CountingPlanner planner;
    planner.answer = good;
    PlainPlant plant;
    PlanResult<double> result = CountingPlanner::make_result();
    CHECK(run_frame(planner, plant, 0.0, target, result).advanced());
  }
}

TEST_CASE("run_frame reports the step of a plant that does not advance", "[mpc]") {
  CountingPlanner planner;
  PlainPlant plant;
  plant.works = false;
  PlanResult<double> result = CountingPlanner::make_result();
  const FrameReport<double> report = run_frame(planner, plant, 0.0, target, result);
  CHECK(report.status == FrameStatus::NotAdvanced);
  CHECK(report.plan == PlanStatus::Planned);
  CHECK(report.step.status == StepStatus::NumericalFailure);
  CHECK(report.max_error == Approx(0.1).epsilon(0.01));  // still measured
}

TEST_CASE("planner and plant that disagree are refused before anything changes", "[mpc]") {
  const auto refused = [](CountingPlanner planner, auto plant, const std::string& part) {
    INFO(part);
    PlanResult<double> result = CountingPlanner::make_result();
    const std::string problem = check_plant(planner, plant);
    INFO(problem);
    CHECK(problem.find(part) != std::string::npos);
    const FrameReport<double> report = run_frame(planner, plant, 0.0, target, result);
    CHECK(report.status == FrameStatus::PlantMismatch);
    CHECK((planner.plans == 0 && plant.applied == 0 && plant.advanced == 0));
    CHECK(result.input.driven_positions.isZero(0.0));
  };
  const CountingPlanner planner;
  const HookedPlant plant;
  REQUIRE(check_plant(planner, plant) == "");
  REQUIRE(check_plant(planner, static_cast<const PlainPlant&>(plant)) == "");
  {
    CountingPlanner other = planner;
    other.vertices = 3;
    refused(other, PlainPlant{}, "the plant has 2 vertices, the planner was made for 3");
  }
  {
    HookedPlant other = plant;
    other.step = 0.01;
    refused(planner, other, "the plant steps by 0.01 s, the planner's dt is 0.02 s");
  }
  {
    HookedPlant other = plant;
    other.load = {0, 0, 3.1};
    refused(planner, other, "the plant weighs 3.1 N, the planner's gravity_load is 3 N");
    other.load = {0, 0, 3.02};  // within 1 %
    CHECK(check_plant(planner, other) == "");
  }
}

TEST_CASE("a position that is not a number shows in the errors, and statuses have names", "[mpc]") {
  CountingPlanner planner;
  HookedPlant plant;
  PlanResult<double> result = CountingPlanner::make_result();
  plant.x(0, 0) = std::numeric_limits<double>::quiet_NaN();
  const auto target = [](Index, double) { return V(0, 0, 0); };
  const FrameReport<double> report = run_frame(planner, plant, 0.0, target, result);
  CHECK(report.advanced());
  CHECK_FALSE(is_finite(report.max_error));
  CHECK_FALSE(is_finite(report.mean_error));
  CHECK(to_string(FrameStatus::Advanced) == "advanced");
  CHECK(to_string(FrameStatus::PlantMismatch) == "plant_mismatch");
  CHECK(to_string(FrameStatus::NotPlanned) == "not_planned");
  CHECK(to_string(FrameStatus::NotAdvanced) == "not_advanced");
}

TEST_CASE("the gravity load is compared only if forces are planned and a load was given", "[mpc]") {
  HookedPlant heavy;
  heavy.load = {0, 0, 30};
  CountingPlanner poses;
  poses.values.input = GripInput::Pose;
  CHECK(check_plant(poses, heavy) == "");
  CountingPlanner none;
  none.values.gravity_load.setZero();
  CHECK(check_plant(none, heavy) == "");
}
