// Frames that are no steps of the engine: what is done in a frame, and what is left over.

#include "clothctl/mpc/stepped_plant.hpp"

#include <cmath>
#include <limits>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Inner = ModelPlant<MassSpring<double>>;
using V = Vector3<double>;

static_assert(ClothPlant<SteppedPlant<Inner>>);

Inner hanging() {
  const auto grid = make_grid<double>(4, 4, 0.3, 0.3).value();
  return Inner(MassSpring<double>::create(sheet_network(grid, Material<double>{}).value()).value());
}

ClothInput<double> moved(const Inner& plant, double way) {
  ClothInput<double> input;
  input.driven_vertices = {12, 15};
  input.driven_positions = plant.positions()(Eigen::all, input.driven_vertices);
  input.driven_positions.row(1).array() += way;
  return input;
}

}  // namespace

TEST_CASE("stepped plant: a frame of four steps is these steps", "[mpc]") {
  Inner plain = hanging();
  SteppedPlant<Inner> stepped(hanging(), 0.005);
  for (int frame = 0; frame < 5; ++frame) {
    const ClothInput<double> goal = moved(plain, 0.004);
    const Points<double> start = plain.positions()(Eigen::all, goal.driven_vertices);
    for (int i = 1; i <= 4; ++i) {
      ClothInput<double> part = goal;
      part.driven_positions = start + 0.25 * i * (goal.driven_positions - start);
      plain.apply(part);
      REQUIRE(plain.advance(0.005).advanced);
    }
    stepped.apply(goal);
    REQUIRE(stepped.advance(0.02).advanced);
    CHECK((stepped.positions() - plain.positions()).norm() < 1e-12);
    CHECK((stepped.velocities() - plain.velocities()).norm() < 1e-10);
    CHECK(std::abs(stepped.behind()) < 1e-12);
  }
}

TEST_CASE("stepped plant: what is left over is made up for", "[mpc]") {
  for (const double step : {0.003, 0.008, 0.013, 0.05}) {
    SteppedPlant<Inner> stepped(hanging(), step);
    double behind = 0, done = 0;
    for (int frame = 1; frame <= 20; ++frame) {
      stepped.apply(moved(stepped.plant(), 0));
      REQUIRE(stepped.advance(0.02).advanced);
      behind = stepped.behind();
      done = 0.02 * frame - behind;
      CHECK(std::abs(behind) <= 0.5 * step + 1e-12);
      CHECK(std::abs(done / step - std::round(done / step)) < 1e-9);
    }
  }
}

TEST_CASE("stepped plant: refusals leave the plant where it is", "[mpc]") {
  SteppedPlant<Inner> stepped(hanging(), 0.005);
  const Points<double> x = stepped.positions();
  stepped.apply(moved(stepped.plant(), 0.1));
  for (const double dt : {0.0, -0.02, std::numeric_limits<double>::quiet_NaN()})
    CHECK(stepped.advance(dt).status == StepStatus::InvalidInput);
  ClothInput<double> bad = moved(stepped.plant(), 0.1);
  bad.driven_vertices[1] = 16;
  stepped.apply(bad);
  CHECK_FALSE(stepped.advance(0.02).advanced);
  bad = moved(stepped.plant(), 0.1);
  bad.driven_vertices.pop_back();
  stepped.apply(bad);
  CHECK_FALSE(stepped.advance(0.02).advanced);
  bad = moved(stepped.plant(), 0.1);
  bad.wind[0] = std::numeric_limits<double>::quiet_NaN();
  stepped.apply(bad);
  CHECK_FALSE(stepped.advance(0.02).advanced);
  CHECK(stepped.positions() == x);
  SteppedPlant<Inner> still(hanging(), 0.0);
  still.apply(moved(still.plant(), 0));
  CHECK_FALSE(still.advance(0.02).advanced);
}
