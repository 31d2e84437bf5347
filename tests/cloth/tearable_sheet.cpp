// A sheet that tears while it moves: against plain models, and what must stay the same.

#include "clothctl/cloth/tearable_sheet.hpp"

#include <limits>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "laws/plant_laws.hpp"
#include "network/network_checks.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::euler;
using clothctl_test::orphan;

namespace {

using Sheet = TearableSheet<MassSpring<double>>;
static_assert(ClothPlant<Sheet>);
static_assert(ClothPlant<TearableSheet<MassSpring<float>>, float>);
static_assert(ClothPlant<TearableSheet<PositionBased<double>>>);

SpringNetwork<double> grid_network(int n) {
  return sheet_network(make_grid<double>(n, n, 0.5, 0.5).value(), Material<double>()).value();
}

/// A sheet of n×n vertices, pinned along its top edge.
Sheet pinned_sheet(int n, const TearSettings<double>& settings = {}) {
  MassSpringSettings<double> model;
  model.drag = 0.5;
  for (int i = 0; i < n; ++i) model.pinned.push_back(n * (n - 1) + i);
  return Sheet::create(MassSpring<double>::create(grid_network(n), model).value(), settings)
      .value();
}

/// Pulls the lower edge down.
ClothInput<double> pull(int n, double force) {
  ClothInput<double> input;
  input.forces.resize(3, n);
  for (int i = 0; i < n; ++i) {
    input.force_vertices.push_back(i);
    input.forces.col(i) << 0, 0, -force;
  }
  return input;
}

}  // namespace

TEST_CASE("a sheet that never tears is a plant like any other", "[cloth]") {
  clothctl_test::check_plant_laws<double>([] { return pinned_sheet(5); }, 0.02);
  const Sheet sheet = pinned_sheet(5);
  CHECK((sheet.gravity_load() - sheet.model().gravity_load()).norm() == 0);
  CHECK(sheet.vertex_count() == 25);
}

TEST_CASE("a sheet that is pulled too hard tears, keeps its mass and goes on", "[cloth]") {
  TearSettings<double> settings;
  settings.structural = 0.1;
  const int n = 9;
  Sheet sheet = pinned_sheet(n, settings);
  ClothInput<double> input = pull(n, 1);
  sheet.apply(input);
  const double mass = sheet.network().mass.sum();
  int tears = 0;
  for (int frame = 0; frame < 80; ++frame) {
    input = pull(n, 0.4 * frame);
    sheet.apply(input);
    const long before = clothctl_test::allocations();
    const StepReport<double> report = sheet.advance(0.01);
    const long made = clothctl_test::allocations() - before;
    REQUIRE(report.advanced);
    if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
    if (sheet.torn_count() == 0) continue;
    const Points<double> x = sheet.positions();
    const Vector3<double> momentum = sheet.velocities() * sheet.network().mass;
    const auto remap = sheet.apply_topology_changes().value();
    CHECK(sheet.torn_count() == 0);
    CHECK(sheet.positions() == remap.interpolate(x));
    if (!remap.is_identity()) ++tears;
    CHECK((sheet.velocities() * sheet.network().mass - momentum).norm() < 1e-12);
    CHECK(sheet.network().mass.sum() == Approx(mass).epsilon(1e-12));
    CHECK(orphan(sheet.network()) == "");
    CHECK(sheet.vertex_count() == sheet.positions().cols());
  }
  CHECK(tears > 0);
  CHECK(sheet.vertex_count() > n * n);
  // The pins hold all copies: pinned vertices are where they were.
  for (const int v : sheet.model().settings().pinned) CHECK(sheet.positions()(2, v) == 0);
  CHECK(all_finite(sheet.positions()));
}

TEST_CASE("a cut sheet moves as a sheet that was made cut", "[cloth]") {
  Sheet sheet = pinned_sheet(6);
  Points<double> line(3, 2);
  line.col(0) << -0.4, 0, -0.22;
  line.col(1) << 0.05, 0, -0.26;
  const auto remap = sheet.cut(line).value();
  CHECK_FALSE(remap.is_identity());
  auto settings = sheet.model().settings();
  const auto made = MassSpring<double>::create(sheet.network(), settings).value();
  ClothState<double> state = made.rest_state();
  CHECK(state.positions == sheet.positions());
  auto workspace = made.make_workspace();
  for (int frame = 0; frame < 10; ++frame) {
    REQUIRE(sheet.advance(0.02).advanced);
    REQUIRE(made.step(state, {}, 0.02, workspace).advanced);
    CHECK(sheet.state() == state);
  }
}

TEST_CASE("pins, driven vertices and forces follow a tear; a seam closes it", "[cloth]") {
  Sheet sheet = pinned_sheet(5);
  ClothInput<double> input = pull(5, 0.01);
  input.driven_vertices = {10};
  input.driven_positions = sheet.positions().col(10);
  sheet.apply(input);
  Points<double> line(3, 2);  // from top to bottom, through vertices
  line.col(0) << 0, 0, 0.3;
  line.col(1) << 0, 0, -0.8;
  const auto torn = sheet.cut(line).value();
  CHECK(torn.vertex_count() == 30);
  CHECK(euler(sheet.network().triangles) == 2);
  CHECK(sheet.model().settings().pinned.size() == 6);
  REQUIRE(sheet.advance(0.02).advanced);
  CHECK(sheet.positions().col(10) == input.driven_positions.col(0));
  std::vector<std::array<int, 2>> pairs;
  for (int row = 0; row < 5; ++row) {
    const auto copies = torn.copies(5 * row + 2);
    REQUIRE(copies.size() == 2);
    pairs.push_back({copies[0], copies[1]});
  }
  const auto sewn = sheet.stitch(pairs).value();
  CHECK(sewn.vertex_count() == 25);
  CHECK(sheet.vertex_count() == 25);
  CHECK(sheet.model().settings().pinned.size() == 5);
  REQUIRE(sheet.advance(0.02).advanced);
}

TEST_CASE("creep lengthens a sheet that hangs under load, and no other", "[cloth]") {
  Sheet sheet = pinned_sheet(5);
  CreepSettings<double> settings;
  settings.yield_strain = 0.02;
  settings.rate = 5;
  CHECK(sheet.creep(settings, 0.1).value() == 0);
  sheet.apply(pull(5, 20));
  for (int frame = 0; frame < 40; ++frame) {
    REQUIRE(sheet.advance(0.02).advanced);
    CHECK(sheet.creep(settings, 0.02).has_value());
  }
  double longest = 0;
  for (const auto& s : sheet.network().springs)
    longest = std::max(longest, s.rest_length / (sheet.network().rest_positions.col(s.a) -
                                                 sheet.network().rest_positions.col(s.b))
                                                    .norm());
  CHECK(longest > 1.05);
  CHECK(longest < 1.5 + 1e-9);
  CHECK(sheet.creep(settings, -1).error().find("creep needs") == 0);
  settings.rate = -1;
  CHECK(sheet.creep(settings, 0.1).error().find("creep rate") == 0);
}

TEST_CASE("what cannot be done leaves the sheet as it was", "[cloth]") {
  TearSettings<double> settings;
  settings.shear = -1;
  CHECK(Sheet::create(pinned_sheet(4).model(), settings).error().find("tear limit shear") == 0);
  Sheet sheet = pinned_sheet(4);
  const ClothState<double> before = sheet.state();
  Points<double> line(3, 2);
  line.setConstant(std::numeric_limits<double>::quiet_NaN());
  CHECK(sheet.cut(line).error() == "point 0 of the cut is not finite");
  CHECK(sheet.stitch({{0, 99}}).error() == "pair 0: vertex 99 is off the mesh of 16 vertices");
  ClothInput<double> input;
  input.force_vertices = {77};
  input.forces.setZero(3, 1);
  sheet.apply(input);
  CHECK(sheet.apply_topology_changes().error() ==
        "force 0: vertex 77 is off the mesh of 16 vertices");
  CHECK(sheet.state() == before);
  CHECK(sheet.vertex_count() == 16);
  sheet.apply({});
  CHECK(sheet.apply_topology_changes().value().is_identity());
  CHECK(sheet.advance(0.02).advanced);
}

TEST_CASE("a position-based sheet tears too", "[cloth]") {
  PositionBasedSettings<double> model;
  model.pinned = {30, 31, 32, 33, 34, 35};
  TearSettings<double> settings;
  settings.structural = 0.1;
  auto sheet = TearableSheet<PositionBased<double>>::create(
                   PositionBased<double>::create(grid_network(6), model).value(), settings)
                   .value();
  for (int frame = 0; frame < 60; ++frame) {
    sheet.apply(pull(36, 0));
    ClothInput<double> input = pull(6, 0.8 * frame);
    sheet.apply(input);
    REQUIRE(sheet.advance(0.01).advanced);
    if (sheet.torn_count() > 0) REQUIRE(sheet.apply_topology_changes().has_value());
  }
  CHECK(sheet.vertex_count() > 36);
  CHECK(orphan(sheet.network()) == "");
  CHECK(all_finite(sheet.positions()));
}
