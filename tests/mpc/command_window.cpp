// The inputs of a plan after the first, for frames whose plan is late.

#include "clothctl/mpc/command_window.hpp"

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using V = Vector3<double>;

// A plan of three frames for two held vertices.
PlanResult<double> plan(bool poses) {
  PlanResult<double> result;
  result.plan.resize(6, 3);
  for (Index k = 0; k < 3; ++k) {
    for (Index i = 0; i < 6; ++i) result.plan(i, k) = static_cast<double>(10 * k + i);
  }
  (poses ? result.input.driven_vertices : result.input.force_vertices) = {4, 7};
  result.input.driven_positions.setConstant(3, poses ? 2 : 0, 0.5);
  result.input.forces.setZero(3, poses ? 0 : 2);
  if (!poses) result.input.forces << 0, 3, 1, 4, 2, 5;
  return result;
}

}  // namespace

TEST_CASE("command window: poses go on as planned, then stand still", "[mpc]") {
  PlannerSettings<double> settings;
  settings.input = GripInput::Pose;
  settings.dt = 0.1;
  const PlanResult<double> result = plan(true);
  CommandWindow<double> commands(settings, result);
  commands.keep(result);
  CHECK(commands.next().driven_positions.col(1) == V(0.5, 0.5, 0.5));
  CHECK(commands.given() == 1);
  CHECK((commands.next().driven_positions.col(1) - V(1.8, 1.9, 2.0)).norm() < 1e-14);
  CHECK_FALSE(commands.exhausted());
  CHECK((commands.next().driven_positions.col(0) - V(3.5, 3.7, 3.9)).norm() < 1e-14);
  CHECK(commands.exhausted());
  CHECK((commands.next().driven_positions.col(0) - V(3.5, 3.7, 3.9)).norm() < 1e-14);
  const long before = clothctl_test::allocations();
  commands.keep(result);
  const Index given = commands.given();
  const V first = commands.next().driven_positions.col(0);
  (void)commands.next();
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(given == 0);
  CHECK(first == V(0.5, 0.5, 0.5));
  CHECK(commands.next().driven_vertices == std::vector<int>{4, 7});
}

TEST_CASE("command window: forces are those planned, then the last", "[mpc]") {
  PlannerSettings<double> settings;
  CommandWindow<double> commands(settings, plan(false));
  CHECK(commands.next().forces.col(1) == V(3, 4, 5));
  CHECK(commands.next().forces.col(1) == V(13, 14, 15));
  CHECK(commands.next().forces.col(0) == V(20, 21, 22));
  CHECK(commands.next().forces.col(0) == V(20, 21, 22));
}

TEST_CASE("command window: positions of planned forces stand still", "[mpc]") {
  PlannerSettings<double> settings;
  settings.command = PlantCommand::Position;
  CommandWindow<double> commands(settings, plan(true));
  CHECK(commands.next().driven_positions.col(0) == V(0.5, 0.5, 0.5));
  CHECK(commands.next().driven_positions.col(0) == V(0.5, 0.5, 0.5));
}
