#include "support/hand_scene.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/box_triangles.hpp"
#include "support/options.hpp"

namespace program {

using Vec = clothctl::Vector3<double>;
using Points = clothctl::Points<double>;

namespace {

constexpr double kOver = 0.07;  // m of the sheet beyond the edge of the table
const Vec kHalf(0.4, 0.4, 0.01);

/// The sheet hangs in y = 0; the place is near its upper left corner.
void hang(HandScene& scene, double size, int side) {
  const auto& grid = scene.grid;
  const int pins[] = {grid.vertex(grid.rows - 1, 0), grid.vertex(grid.rows - 1, grid.cols - 1)};
  scene.world.input(0).driven_vertices = {pins[0], pins[1]};
  scene.world.input(0).driven_positions = grid.positions(Eigen::all, pins);
  const double inside = std::max(0.02, 1.01 * size / (side - 1));
  scene.place.place = Vec(scene.world.input(0).driven_positions.col(0)) + Vec(inside, 0, -inside);
  scene.place.press = Vec(0, 1, 0);
  scene.place.approach = Vec(0, 0, -1);
}

/// The sheet lies on a table whose top is z = 0; the place is at the middle of the edge in front.
void lay(HandScene& scene, double size, double dt) {
  auto state = scene.world.state(0);
  for (clothctl::Index i = 0; i < state.positions.cols(); ++i) {
    const Vec flat = scene.grid.positions.col(i);
    state.positions.col(i) = Vec(flat[0], flat[2] + size - kOver, 1.5e-3);
  }
  (void)scene.world.set_state(0, state);
  scene.table = std::make_unique<clothctl::BoxCollider<double>>(
      must(clothctl::BoxCollider<double>::create(Vec(0, kHalf[1], -kHalf[2]), kHalf)));
  clothctl::ColliderSurface<double> surface;
  surface.friction = 0.5;
  must(scene.world.add_obstacle(*scene.table, {}, surface));
  for (double t = 0; t < 2; t += dt) {
    if (!scene.world.step(dt).advanced) refuse("the sheet does not come to rest");
  }
  const Points& x = scene.world.state(0).positions;
  const int in = std::max(1, static_cast<int>(std::lround(0.015 / size * (scene.grid.rows - 1))));
  const int col = scene.grid.cols / 2;
  const auto at = [&](int row, int c) { return Vec(x.col(scene.grid.vertex(row, c))); };
  scene.place.place = at(in, col);
  const Vec inward = (at(in + 1, col) - at(in - 1, col)).normalized();
  const Vec up = (at(in, col + 1) - at(in, col - 1)).cross(inward).normalized();
  scene.place.press = -up;  // the thumb is above
  scene.place.approach = inward;
}

}  // namespace

Points HandScene::solids() const {
  return table ? box_triangles(Vec(0, kHalf[1], -kHalf[2]), kHalf) : Points(3, 0);
}

std::unique_ptr<HandScene> make_hand_scene(int side, double size,
                                           const clothctl::Material<double>& material, bool flat,
                                           double dt) {
  auto scene = std::make_unique<HandScene>();
  scene->grid = must(clothctl::make_grid<double>(side, side, size, size));
  auto model = must(
      clothctl::MassSpring<double>::create(must(clothctl::sheet_network(scene->grid, material)),
                                           clothctl::MassSpringSettings<double>::of(material)));
  auto state = model.rest_state();
  clothctl::WorldSheetSetup<double> setup;
  if (flat) setup.substeps = 4;  // bones of the hand rub on it at 1 m/s
  must(scene->world.add_sheet(std::move(model), std::move(state), setup));
  if (flat) {
    lay(*scene, size, dt);
  } else {
    hang(*scene, size, side);
  }
  return scene;
}

}  // namespace program
