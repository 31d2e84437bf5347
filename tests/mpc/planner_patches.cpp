// Patches of held vertices in closed loops: soft and hard patches under planned forces, rigid
// motion of planned poses, and planned forces that are sent as positions.

#include "clothctl/mpc/detail/held_patches.hpp"
#include "mpc/planner_loops.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::AsyncTarget;
using clothctl_test::HangingSheet;
using V = Vector3<double>;

namespace {

constexpr double kDt = clothctl_test::kFrame;

double largest_residual(const HangingSheet& sheet, int patch,
                        const PlannerSettings<double>& settings, int frames, int& rows) {
  auto planner =
      clothctl_test::frozen_planner(sheet, clothctl_test::corner_setup(sheet, patch), settings);
  auto plant = clothctl_test::sheet_plant(sheet, Integration::LinearlyImplicit);
  double residual = 0.0;
  rows = 0;
  const auto stats = clothctl_test::run_loop(planner, plant, frames, clothctl_test::corners(sheet),
                                             AsyncTarget(sheet), clothctl_test::NoWind(),
                                             [&](int, const PlanResult<double>& result) {
                                               residual = std::max(residual, result.patch_residual);
                                               rows += result.used_rows ? 1 : 0;
                                             });
  CHECK(stats.failures == 0);
  return residual;
}

}  // namespace

TEST_CASE("hard patches move affinely, and soft ones nearly so at a high cost", "[mpc]") {
  for (const int patch : {2, 3}) {
    const HangingSheet sheet = clothctl_test::hanging_sheet(9, patch, 60);
    PlannerSettings<double> settings = clothctl_test::corner_settings(sheet, GripInput::Force, 5);
    int rows = 0;
    double last = 1.0;
    for (const double weight : {1.0, 1e3, 1e6}) {
      settings.weights.patch = weight;
      const double residual = largest_residual(sheet, patch, settings, patch == 2 ? 12 : 5, rows);
      CAPTURE(patch, weight, residual);
      CHECK(residual < last);
      CHECK(rows == 0);
      last = residual;
    }
    settings.patch = PatchMode::Hard;
    const double hard = largest_residual(sheet, patch, settings, patch == 2 ? 12 : 3, rows);
    CAPTURE(patch, hard);
    CHECK(hard < 1e-8);
    CHECK(rows == (patch == 2 ? 12 : 3));
  }
}

TEST_CASE("hard rows that contradict a grip limit are relaxed, and the status says so", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 3, 60);
  PlannerSettings<double> settings = clothctl_test::corner_settings(sheet, GripInput::Force, 4);
  settings.patch = PatchMode::Hard;
  auto planner = clothctl_test::frozen_planner(
      sheet, clothctl_test::corner_setup(sheet, 3, 0.5, 0.05), settings);
  auto result = planner.make_result();
  // The vertices of a patch fly apart, and fingers of 0.05 N cannot hold them together.
  const Points<double> v = clothctl_test::shaken(sheet.state, 3, 0.0, 3.0).velocities;
  const PlanStatus status = planner.plan(sheet.state.positions, v, 0.0, AsyncTarget(sheet), result);
  CAPTURE(to_string(status));
  CHECK(status == PlanStatus::Relaxed);
  CHECK(result.patch_residual > 1e-6);
  for (const FingerForce<double>& f : result.finger_forces)
    CHECK(cone_violation<double>(f.force, f.normal, 0.5, 0.05) <= 1e-9);
}

TEST_CASE("a commanded pose moves its patch as a rigid body within the largest step", "[mpc]") {
  for (const int patch : {1, 2, 3}) {
    const HangingSheet sheet = clothctl_test::hanging_sheet(9, patch, 60);
    PlannerSettings<double> settings = clothctl_test::corner_settings(sheet, GripInput::Pose, 10);
    for (const double max_step : {0.05, 0.002}) {
      settings.max_step = max_step;
      auto planner =
          clothctl_test::frozen_planner(sheet, clothctl_test::corner_setup(sheet, patch), settings);
      auto plant = clothctl_test::sheet_plant(sheet, Integration::LinearlyImplicit);
      Points<double> before = plant.positions();
      double worst_distance = 0.0, worst_step = 0.0;
      const auto stats = clothctl_test::run_loop(
          planner, plant, 30, clothctl_test::corners(sheet), AsyncTarget(sheet, 2.0),
          clothctl_test::NoWind(), [&](int, const PlanResult<double>& result) {
            const auto& held = result.input.driven_vertices;
            for (std::size_t g = 0; g < 2; ++g) {
              const std::size_t size = held.size() / 2;
              V move = V::Zero();
              for (std::size_t i = g * size; i < (g + 1) * size; ++i) {
                const V to_i = result.input.driven_positions.col(static_cast<Index>(i)),
                        from_i = before.col(held[i]);
                move += (to_i - from_i) / static_cast<double>(size);
                for (std::size_t j = g * size; j < i; ++j) {
                  const V to_j = result.input.driven_positions.col(static_cast<Index>(j)),
                          from_j = before.col(held[j]);
                  worst_distance = std::max(
                      worst_distance, std::abs((to_i - to_j).norm() - (from_i - from_j).norm()));
                }
              }
              worst_step = std::max(worst_step, move.cwiseAbs().maxCoeff());
              for (std::size_t i = g * size; i < (g + 1) * size; ++i) {
                const V turned = result.input.driven_positions.col(static_cast<Index>(i)) -
                                 before.col(held[i]) - move;
                CHECK(turned.cwiseAbs().maxCoeff() < 1.1 * max_step);
              }
            }
            before = plant.positions();
          });
      CAPTURE(patch, max_step);
      CHECK(stats.failures == 0);
      CHECK(worst_distance < 1e-12);
      CHECK(worst_step < max_step * (1.0 + 1e-9));
      if (max_step < 0.01) CHECK(worst_step > 0.99 * max_step);  // the bound was active
    }
  }
}

TEST_CASE("with a limited change of plan, poses stay rigid and within the limit", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(9, 2, 60);
  PlannerSettings<double> settings = clothctl_test::corner_settings(sheet, GripInput::Pose, 10);
  settings.max_change = 0.01;
  auto planner =
      clothctl_test::frozen_planner(sheet, clothctl_test::corner_setup(sheet, 2), settings);
  auto plant = clothctl_test::sheet_plant(sheet, Integration::LinearlyImplicit);
  MatrixX<double> last = MatrixX<double>::Zero(24, 10);
  Points<double> before = plant.positions();
  double largest = 0.0, rigid = 0.0, remainder = 0.0;
  std::array<double, 2> turned{};  // how far each hand has turned since the first plan
  clothctl_test::run_loop(
      planner, plant, 25, clothctl_test::corners(sheet), AsyncTarget(sheet, 2.0),
      clothctl_test::NoWind(), [&](int k, const PlanResult<double>& result) {
        // The first plan has no earlier plan to stay close to.
        if (k > 0) largest = std::max(largest, (result.plan - last).cwiseAbs().maxCoeff());
        last.leftCols(9) = result.plan.rightCols(9);
        last.col(9) = result.plan.col(9);
        const auto& held = result.input.driven_vertices;
        const auto planned = [&](std::size_t i) {
          return V(kDt * result.plan.block<3, 1>(3 * static_cast<Index>(i), 0));
        };
        for (std::size_t i = 0; i < held.size(); ++i) {
          const Index c = static_cast<Index>(i);
          const V to = result.input.driven_positions.col(c), from = before.col(held[i]);
          // Angle and size of the patch's turn, from the vertices of the same hand.
          double angle = 0.0, size = 0.0;
          for (std::size_t j = i / 4 * 4; j < i / 4 * 4 + 4; ++j) {
            if (j == i) continue;
            const double distance = (from - V(before.col(held[j]))).norm();
            angle = std::max(angle, (planned(i) - planned(j)).norm() / distance);
            size = std::max(size, distance);
          }
          if (i % 4 == 0) turned[i / 4] += angle;
          remainder = std::max(
              remainder, (to - from - planned(i)).norm() / (angle * turned[i / 4] * size + 1e-9));
          if (i % 4 == 0) continue;
          const V neighbour = before.col(held[i - 1]);
          rigid =
              std::max(rigid, std::abs((to - V(result.input.driven_positions.col(c - 1))).norm() -
                                       (from - neighbour).norm()));
        }
        before = plant.positions();
      });
  CHECK(largest < 0.01 * (1.0 + 1e-9));
  CHECK(rigid < 1e-12);
  // The command is the plan's first frame, up to second order in turns. A plan that may change only
  // a little still holds velocities from before the hand turned.
  CHECK(remainder < 1.0);
}

TEST_CASE("planned forces can be sent as the positions that they lead to", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(9);
  PlannerSettings<double> settings = clothctl_test::corner_settings(sheet, GripInput::Force, 20);
  settings.command = PlantCommand::Position;
  settings.max_step = 1.0;  // so that the jump is allowed
  // One frame: under the planned forces, the plant moves to the commanded positions.
  using Exact = LinearisedPredictor<MassSpringResponse<double>, double>;
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit);
  auto made =
      Planner<Exact>::create(clothctl_test::corner_setup(sheet), settings,
                             Exact(MassSpringResponse<double>(model)), sheet.state.positions);
  REQUIRE(made.has_value());
  auto exact = std::move(made).value();
  auto result = exact.make_result();
  ClothState<double> state = sheet.state;
  state.velocities = clothctl_test::shaken(state, 2, 0.0, 0.1).velocities;
  REQUIRE(exact.plan(state.positions, state.velocities, 0.5, AsyncTarget(sheet), result) ==
          PlanStatus::Planned);
  ClothInput<double> forces;
  forces.force_vertices = exact.held();
  forces.forces = Eigen::Map<const Points<double>>(result.plan.data(), 3, 2);
  auto workspace = model.make_workspace();
  REQUIRE(model.step(state, forces, kDt, workspace).advanced);
  CHECK(result.input.force_vertices.empty());
  REQUIRE(result.input.driven_vertices == exact.held());
  for (Index j = 0; j < 2; ++j) {
    CHECK((result.input.driven_positions.col(j) -
           state.positions.col(exact.held()[static_cast<std::size_t>(j)]))
              .norm() < 1e-11);
  }
  // A closed loop with such commands tracks on either plant.
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    auto planner =
        clothctl_test::frozen_planner(sheet, clothctl_test::corner_setup(sheet), settings);
    auto plant = clothctl_test::sheet_plant(sheet, integration);
    const auto stats = clothctl_test::run_loop(planner, plant, 80, clothctl_test::corners(sheet),
                                               AsyncTarget(sheet), clothctl_test::NoWind(),
                                               clothctl_test::NoWatch());
    CHECK(stats.failures == 0);
    CHECK(stats.mean_error < 0.01);
  }
}
