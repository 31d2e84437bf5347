// The archetype satisfies its concept, has nothing else, obeys the laws, and works in a World.

#include "archetypes/colliding_cloth.hpp"

#include <type_traits>
#include <utility>

#include "archetypes/cloth.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/sim/world.hpp"
#include "laws/colliding_cloth_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::CollidingClothArchetype;

namespace {

template <class S>
CollidingClothArchetype<S> level_sheet() {
  const GridMesh<double> grid = make_grid<double>(4, 4, 0.3, 0.3).value();
  Points<S> x = Points<S>::Zero(3, 16);
  x.row(0) = grid.positions.row(0).cast<S>();
  x.row(1) = grid.positions.row(2).cast<S>();
  return {std::move(x), grid.triangles};
}

}  // namespace

static_assert(CollidingCloth<CollidingClothArchetype<float>, ObstacleContacts<float>, float> &&
              CollidingCloth<CollidingClothArchetype<double>, ObstacleContacts<double>, double>);
static_assert(!CollidingCloth<CollidingClothArchetype<float>, ObstacleContacts<float>, double> &&
              !CollidingCloth<CollidingClothArchetype<double>, int, double>);
static_assert(!CollidingCloth<clothctl_test::ModelArchetype<double>, ObstacleContacts<double>> &&
              !CollidingCloth<int, ObstacleContacts<double>>);
static_assert(!std::is_copy_constructible_v<CollidingClothArchetype<double>> &&
              !std::is_default_constructible_v<CollidingClothArchetype<double>>);

TEST_CASE("the archetype of a colliding sheet obeys the laws", "[archetypes]") {
  clothctl_test::CollidingClothLaws<double> laws;
  laws.momentum = 1e-11;
  laws.depth = 1e-12;
  laws.tolerance = 0;
  clothctl_test::check_colliding_cloth_laws<CollidingClothArchetype<double>, double>(
      level_sheet<double>(), laws, {0, 0, -9.81});
}

TEST_CASE("a world needs no more from a sheet than the concept names", "[archetypes]") {
  World<double> world;
  const auto floor = PlaneCollider<double>::create({0, 0, -0.05}, {0, 0, 1}).value();
  REQUIRE(world.add_obstacle(floor).has_value());
  auto model = level_sheet<double>();
  ClothState<double> state = model.rest_state();
  WorldSheetSetup<double> setup;
  setup.meets_sheets = true;
  const int sheet = world.add_sheet(std::move(model), std::move(state), setup).value();
  for (int i = 0; i < 60; ++i) REQUIRE(world.step(0.01).advanced);
  const auto heights = world.state(sheet).positions.row(2);
  CHECK(heights.minCoeff() == Approx(-0.05 + 1e-3).margin(1e-9));
  CHECK(heights.maxCoeff() == Approx(-0.05 + 1e-3).margin(1e-9));
}
