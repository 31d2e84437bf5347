// The sheets of a world that meet.

#include "clothctl/sim/detail/world_layers.hpp"

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "support/sheet_on_obstacles.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Model = PositionBased<double>;
using Sheets = detail::WorldLayers<double>::Sheets;

void add(Sheets& sheets, std::vector<WorldSheetSetup<double>>& setups, bool meets, double z) {
  Model model = Model::create(level_sheet<double>(4)).value();
  const SpringNetwork<double>& network = model.network();
  auto finder =
      SheetContactFinder<double>::create(network.rest_positions, network.triangles).value();
  auto mesh = detail::SheetMesh<double>::of(model);
  ClothState<double> state = model.rest_state();
  state.positions.row(2).array() += z;
  state.positions.row(0).array() += 0.3 * z;  // no vertex over a vertex
  sheets.push_back(std::make_unique<detail::WorldSheetOf<Model, double>>(
      std::move(model), std::move(mesh), std::move(state), std::move(finder),
      ObstacleContacts<double>::create(50).value(), 50));
  setups.emplace_back().meets_sheets = meets;
}

}  // namespace

TEST_CASE("sheets that meet are kept apart, others are left alone", "[sim]") {
  Sheets sheets;
  std::vector<WorldSheetSetup<double>> setups;
  add(sheets, setups, true, 0);
  add(sheets, setups, false, 0.01);
  add(sheets, setups, true, 0.02);
  setups[2].thickness = 0.003;
  detail::WorldLayers<double> layers;
  REQUIRE(layers.prepare(sheets, setups, 0.3).empty());
  CHECK(sheets[0]->first == 0);
  CHECK(sheets[1]->first == -1);
  CHECK(sheets[2]->first == 16);
  layers.begin(sheets);
  // The upper sheet passes both others within a step.
  sheets[2]->state.positions.row(2).array() -= 0.03;
  sheets[2]->state.velocities.row(2).setConstant(-3);
  const ClothState<double> between = sheets[1]->state;
  const SheetImpactReport report = layers.keep_apart(sheets, 0.01);
  CHECK(report.crossings_left == 0);
  CHECK(report.impacts > 0);
  CHECK(sheets[1]->state == between);
  // It would be 10 mm below; its border overhangs.
  const double gap =
      sheets[2]->state.positions.row(2).mean() - sheets[0]->state.positions.row(2).mean();
  CHECK(gap > -1e-3);
  // What the upper sheet lost of its momentum, the lower has.
  const VectorX<double>& mass = sheets[0]->mesh.mass;
  const double lower = sheets[0]->state.velocities.row(2).dot(mass.transpose()),
               upper = sheets[2]->state.velocities.row(2).dot(mass.transpose());
  CHECK(lower < -0.1 * mass.sum());
  CHECK(std::abs(lower + upper + 3 * mass.sum()) < 1e-12);
}

TEST_CASE("layers without sheets do nothing, and bad seams are told", "[sim]") {
  Sheets sheets;
  std::vector<WorldSheetSetup<double>> setups;
  detail::WorldLayers<double> layers;
  CHECK(layers.prepare(sheets, setups, 0.3).empty());
  layers.begin(sheets);
  CHECK(layers.keep_apart(sheets, 0.01).contacts == 0);
  add(sheets, setups, true, 0);
  setups[0].joined = {{3, 99}};
  CHECK(layers.prepare(sheets, setups, 0.3) ==
        "joined pair 0 holds vertex 99 off the sheet of 16 vertices");
}
