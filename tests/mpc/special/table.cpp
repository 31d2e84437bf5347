// A sheet on a table: planners that know what carries it, and planners that do not.

#include <algorithm>
#include <limits>

#include "clothctl/sim/contact_summary.hpp"
#include "mpc/planner_loops.hpp"
#include "support/catch.hpp"
#include "support/sheet_on_obstacles.hpp"

using namespace clothctl;
using clothctl_test::FrozenPlanner;
using clothctl_test::FrozenPredictor;
using clothctl_test::kFrame;

namespace {

using Vec = Vector3<double>;
constexpr int kSide = 9;

/// Mean distance of the two free corners from their targets, m, when two hands drag the sheet over
/// the table by 5 cm within a second.
double drag(bool supported) {
  const SpringNetwork<double> network = clothctl_test::level_sheet<double>(kSide);
  MassSpring<double> model = MassSpring<double>::create(network).value();
  ClothState<double> state = model.rest_state();
  state.positions.row(2).setConstant(1e-3);
  const std::vector<int> hands{0, kSide - 1}, corners{kSide * (kSide - 1), kSide * kSide - 1};
  PlannerSetup<double> setup;
  setup.triangles = network.triangles;
  for (const int v : hands) setup.grips.push_back(make_pinch<double>({v}, 0.5, 20.0));
  for (const int v : corners) setup.features.add_point(v);
  PlannerSettings<double> settings;
  settings.input = GripInput::Pose;
  FrozenPlanner planner =
      FrozenPlanner::create(setup, settings, FrozenPredictor(MassSpringResponse<float>(model)),
                            state.positions)
          .value();
  World<double> world;
  (void)world.add_sheet(std::move(model), state).value();
  (void)world.add_obstacle(PlaneCollider<double>::create(Vec::Zero(), Vec::UnitZ()).value())
      .value();
  world.input(0).driven_vertices = hands;
  world.input(0).driven_positions = state.positions(Eigen::all, hands);
  for (int k = 0; k < 20; ++k) REQUIRE(world.step(kFrame).advanced);
  const Points<double> start = world.state(0).positions(Eigen::all, corners);
  const Vec along = (state.positions.col(hands[0]) - start.col(0)).normalized();
  const auto target = [&](Index i, double t) -> Vec {
    const double s = std::clamp(t, 0.0, 1.0);
    return Vec(start.col(i)) + 0.05 * s * s * (3 - 2 * s) * along;
  };
  auto result = planner.make_result();
  std::vector<VertexSupport<double>> supports;
  double error = 0;
  for (int k = 0; k < 60; ++k) {
    if (supported) {
      contact_supports<double>(world, 0, kFrame, {}, 1e-3, supports);
      REQUIRE(planner.set_supports(supports).empty());
    }
    const ClothState<double>& now = world.state(0);
    REQUIRE(can_apply(planner.plan(now.positions, now.velocities, k * kFrame, target, result)));
    world.input(0) = result.input;
    REQUIRE(world.step(kFrame).advanced);
    for (const Index i : {0, 1}) {
      const Vec way = world.state(0).positions.col(corners[static_cast<std::size_t>(i)]) -
                      target(i, (k + 1) * kFrame);
      error += way.norm() / 120;
    }
  }
  return error;
}

}  // namespace

TEST_CASE("a sheet is dragged over a table by planners that know what carries it", "[mpc]") {
  const double known = drag(true), unknown = drag(false);
  INFO("known " << known << ", unknown " << unknown);
  CHECK(known < 0.5e-3);
  CHECK(unknown > 5 * known);
}

TEST_CASE("bad supports are refused", "[mpc]") {
  const clothctl_test::HangingSheet sheet = clothctl_test::hanging_sheet(5);
  FrozenPlanner planner =
      clothctl_test::frozen_planner(sheet, clothctl_test::corner_setup(sheet),
                                    clothctl_test::corner_settings(sheet, GripInput::Pose, 4));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refusal = [&](const VertexSupport<double>& support) {
    const VertexSupport<double> good{3, Vec::UnitZ(), Vec(0, 0, 0.1), 1e-3};
    return planner.set_supports(std::vector<VertexSupport<double>>{support, good});
  };
  const Vec up = Vec::UnitZ();
  CHECK(refusal({25, up, up, 1e-3}) == "the support of vertex 25 is off the mesh");
  CHECK(refusal({-1, up, up, 1e-3}) == "the support of vertex -1 is off the mesh");
  CHECK(refusal({3, up, up, 1e-3}) == "the support of vertex 3 occurs twice");
  CHECK(refusal({4, 2 * up, up, 1e-3}) ==
        "the support of vertex 4 has a normal that is not a unit vector");
  CHECK(refusal({4, Vec(0, 0, nan), up, 1e-3}) ==
        "the support of vertex 4 has a normal that is not a unit vector");
  CHECK(refusal({4, up, Vec(0, nan, 0), 1e-3}) ==
        "the support of vertex 4 has a force that is not finite");
  CHECK(refusal({4, up, up, 0}) == "the support of vertex 4 has the release 0 m, must be positive");
  CHECK(refusal({4, up, up, 1e-3}).empty());
}
