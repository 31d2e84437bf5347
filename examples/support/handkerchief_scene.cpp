#include "support/handkerchief_scene.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace program {

namespace {

/// Returns the vertices that the left (0) or right (1) hand holds.
std::vector<int> corner_patch(const Grid& grid, int side, int size) {
  std::vector<int> patch;
  for (int row = grid.rows - size; row < grid.rows; ++row) {
    for (int col = 0; col < size; ++col)
      patch.push_back(grid.vertex(row, side == 0 ? col : grid.cols - 1 - col));
  }
  return patch;
}

/// Returns where the sheet starts.
clothctl::ClothState<double> place(const Options& o, const Grid& grid, const Task& task) {
  Vec middle(0, 0, -o.size), along(1, 0, 0);
  if (!task.curves.empty()) {
    const Vec left = task.curves.front().position(0), right = task.curves.back().position(0);
    middle = (left + right) / 2;
    const Vec level(right[0] - left[0], right[1] - left[1], 0);
    if (level.norm() > 1e-6) along = level.normalized();
  }
  const Vec up(0, 0, 1), normal = up.cross(along), hands = middle + o.size * up;
  // The sheet bows between the patches, which are flat.
  const double patch = o.size * (o.patch_size - 1) / (o.cloth - 1), half = o.size / 2 - patch;
  const double share = std::max(o.spread - (1 - o.spread) * patch / half, 0.5 * o.spread);
  clothctl::ClothState<double> state{grid.positions, Points::Zero(3, grid.positions.cols())};
  for (Index i = 0; i < grid.positions.cols(); ++i) {
    const Vec flat = grid.positions.col(i);
    const double between = std::clamp(flat[0], -half, half), beyond = flat[0] - between;
    const double turn = std::numbers::pi * between / (2 * half);
    const double bow = 0.25 * std::sqrt(1 - o.spread) * o.size * std::cos(turn);
    state.positions.col(i) =
        hands + (share * between + beyond) * along + flat[2] * up + bow * normal;
  }
  return state;
}

}  // namespace

std::vector<int> lower_corners(const Grid& grid) {
  return {grid.vertex(0, 0), grid.vertex(0, grid.cols - 1)};
}

Scene handkerchief_scene(const Options& o, const Grid& grid, const std::vector<int>& features,
                         const clothctl::Material<double>& material) {
  const double friction = o.friction_given ? o.friction : material.friction;
  Scene scene;
  scene.material = material.name;
  scene.body = sheet_body(o, grid, material);
  if (o.windy()) scene.body.air = {1.2, material.air_normal, material.air_tangent};
  for (int side : {0, 1})
    scene.setup.grips.push_back(clothctl::make_pinch<double>(corner_patch(grid, side, o.patch_size),
                                                             friction, o.limit, o.generators));
  for (int v : features) scene.setup.features.add_point(v);
  scene.setup.triangles = scene.body.network.triangles;
  scene.settings = planner_settings(o, 9.81 * scene.body.network.mass.sum());
  check_scene(scene);
  return scene;
}

std::function<Vec(double)> gusts(double speed) {
  return [speed](double t) {
    const double rise = std::clamp(t / 2, 0.0, 1.0);
    const double gust = 1 + 0.5 * std::sin(2.1 * t) + 0.3 * std::sin(5.3 * t + 1);
    return Vec(rise * rise * (3 - 2 * rise) * gust * speed * Vec(0.2, 1, 0));
  };
}

clothctl::ClothState<double> hang_handkerchief(const Options& o, const Grid& grid, const Task& task,
                                               const Scene& scene, const Body& body) {
  std::vector<int> held = scene.setup.grips[0].vertices();
  for (int v : scene.setup.grips[1].vertices()) held.push_back(v);
  return settle(o, body, place(o, grid, task), held, is_implicit(o.plant) ? 2.4 : 4.8);
}

Task follow_hands(const Grid& grid, const Scene& scene, const clothctl::ClothState<double>& rest,
                  const Task& hands) {
  AnyPlant plant = plant_in_state("newton", scene.body, rest);
  const std::vector<int> corners = lower_corners(grid);
  const clothctl::VectorX<double> times = frame_times(hands.duration);
  Points paths[2] = {Points(3, times.size()), Points(3, times.size())};
  clothctl::ClothInput<double> input;
  for (const clothctl::Grip<double>& grip : scene.setup.grips)
    input.driven_vertices.push_back(grip.vertices().front());
  input.driven_positions.resize(3, 2);
  for (Index i = 0; i < times.size(); ++i) {
    for (Index side = 0; side < 2; ++side)
      input.driven_positions.col(side) =
          hands.curves[static_cast<std::size_t>(side)].position(times[i]);
    plant.apply(input);
    if (i > 0 && !plant.advance(0.02).advanced)
      refuse("the sheet cannot follow the hands in frame " + std::to_string(i));
    for (std::size_t side = 0; side < 2; ++side)
      paths[side].col(i) = plant.positions().col(corners[side]);
  }
  return curves_task(times, paths[0], paths[1]);
}

void fit_targets(const Options& o, const Grid& grid, const std::vector<int>& features,
                 const Points& x, Task& task) {
  for (std::size_t i = 0; i < features.size(); ++i)
    task.curves[i].translate(x.col(features[i]) - task.curves[i].position(0));
  for (std::size_t i = 0; i + 1 < features.size(); ++i) {
    const Vec side = grid.positions.col(features[i]) - grid.positions.col(features[i + 1]);
    check_reach(o, task, i, i + 1, side.norm());
  }
}

}  // namespace program
