// Two fingers hold a handkerchief at each upper corner and move it so that its lower corners follow
// a drawn motion. [Bai 2016], figures 4 and 8.
//
//   handkerchief --task async --out out          then open out/player.html

#include <cmath>
#include <filesystem>
#include <numbers>

#include "clothctl/mesh/grid.hpp"
#include "support/command_line.hpp"
#include "support/hand_files.hpp"
#include "support/hand_loop.hpp"
#include "support/inputs.hpp"
#include "support/loop.hpp"

namespace {

using namespace program;
using Grid = clothctl::GridMesh<double>;

/// Returns the options, and in `features` the text of --features, in `hand` what --hand names.
Options read_options(int argc, char** argv, std::string& features, HandMaker& hand) {
  Options o;
  CLI::App app{
      "A handkerchief is moved by its upper corners so that its lower ones follow a drawn motion."};
  add_common(app, o, {"async", "circle", "wind"}, "Built-in motion, instead of --targets");
  add_sheet(app, o.cloth, o.size, o.material, "Vertices along a side; 65 is the paper's sheet");
  app.add_option("--patch", o.patch, "Patch motion: soft or hard")
      ->check(CLI::IsMember({"soft", "hard"}))
      ->capture_default_str();
  app.add_option("--patch-size", o.patch_size,
                 "Vertices along a side of the patch that each hand holds, at most half of --cloth")
      ->check(between(1, 64))
      ->capture_default_str();
  app.add_option("--spread", o.spread, "Distance of the hands at the start, share of the size")
      ->check(between(0.1, 1))
      ->capture_default_str();
  app.add_option("--features", features,
                 "Vertices that follow the targets, row·N + column, row 0 at the bottom (default: "
                 "lower corners)");
  HandFiles files;
  CLI::Option* hands = app.add_flag("--hands", o.hands, "Simulated hands move the sheet");
  add_hand(app, files)->needs(hands);
  add_model(app, o.model)->excludes(hands);
  parse(app, o, argc, argv);
  hand = read_hand(files);
  if (2 * o.patch_size > o.cloth)
    refuse("--patch-size: " + std::to_string(o.patch_size) + " is over half of --cloth " +
           std::to_string(o.cloth));
  return o;
}

/// Returns the vertices that the left (0) or right (1) hand holds.
std::vector<int> corner_patch(const Grid& grid, int side, int size) {
  std::vector<int> patch;
  for (int row = grid.rows - size; row < grid.rows; ++row) {
    for (int col = 0; col < size; ++col)
      patch.push_back(grid.vertex(row, side == 0 ? col : grid.cols - 1 - col));
  }
  return patch;
}

/// Makes body, grips, features and settings; the features are the vertices `corners`.
Scene make_scene(const Options& o, const Grid& grid, const std::vector<int>& corners) {
  const clothctl::Material<double> material = read_material(o.material);
  const double friction = o.friction_given ? o.friction : material.friction;
  const bool windy = o.targets.empty() && o.task == "wind";
  Scene scene;
  scene.material = material.name;
  scene.body = sheet_body(o, grid, material);
  if (windy) scene.body.air = {1.2, material.air_normal, material.air_tangent};
  for (int side : {0, 1})
    scene.setup.grips.push_back(clothctl::make_pinch<double>(corner_patch(grid, side, o.patch_size),
                                                             friction, o.limit, o.generators));
  for (int v : corners) scene.setup.features.add_point(v);
  scene.setup.triangles = scene.body.network.triangles;
  scene.settings = planner_settings(o, 9.81 * scene.body.network.mass.sum());
  check_scene(scene);
  return scene;
}

/// Places the sheet in the vertical plane through the first targets, left to right, slightly bent,
/// with the hands `spread` apart.
clothctl::ClothState<double> place(const Options& o, const Grid& grid, const Task& task) {
  Vec middle(0, 0, -o.size), along(1, 0, 0);
  if (!task.curves.empty()) {
    const Vec left = task.curves.front().position(0), right = task.curves.back().position(0);
    middle = (left + right) / 2;
    const Vec level(right[0] - left[0], right[1] - left[1], 0);
    if (level.norm() > 1e-6) along = level.normalized();
  }
  const Vec up(0, 0, 1), normal = up.cross(along), hands = middle + o.size * up;
  clothctl::ClothState<double> state{grid.positions, Points::Zero(3, grid.positions.cols())};
  for (Index i = 0; i < grid.positions.cols(); ++i) {
    const Vec flat = grid.positions.col(i);
    const double turn = std::numbers::pi * flat[0] / o.size;
    const double bow = 0.25 * std::sqrt(1 - o.spread) * o.size * std::cos(turn);
    state.positions.col(i) = hands + o.spread * flat[0] * along + flat[2] * up + bow * normal;
  }
  return state;
}

/// Makes the task start at the settled positions of the features `corners`. x: positions, 3×n, m.
void fit_task(const Options& o, const Grid& grid, const std::vector<int>& corners, const Points& x,
              Scene& scene) {
  if (o.targets.empty()) {
    scene.task = make_handkerchief_task(o.task, o.seed, o.size, x.col(corners.front()),
                                        x.col(corners.back()));
    scene.title = "Handkerchief: " + o.task;
    if (const auto count = std::to_string(corners.size()); count != "2")
      refuse("--features: the built-in tasks move 2 features, not " + count);
    return;
  }
  for (std::size_t i = 0; i < corners.size(); ++i)
    scene.task.curves[i].translate(x.col(corners[i]) - scene.task.curves[i].position(0));
  scene.title = "Handkerchief: " + std::filesystem::path(o.targets).stem().string();
  for (std::size_t i = 0; i + 1 < corners.size(); ++i) {
    const Vec side = grid.positions.col(corners[i]) - grid.positions.col(corners[i + 1]);
    check_reach(o, scene.task, i, i + 1, side.norm());
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::string features;
  HandMaker hand;
  const Options o = read_options(argc, argv, features, hand);
  const Grid grid = must(clothctl::make_grid<double>(o.cloth, o.cloth, o.size, o.size));
  std::vector<int> corners{grid.vertex(0, 0), grid.vertex(0, grid.cols - 1)};
  if (!features.empty()) corners = read_vertices(features, "--features");
  Scene scene = make_scene(o, grid, corners);
  if (!o.targets.empty()) {
    scene.task = read_task(o);
    if (scene.task.curves.size() != corners.size())
      refuse(o.targets + ": has " + std::to_string(scene.task.curves.size()) + " curves for " +
             std::to_string(corners.size()) + " features");
  }
  std::vector<int> held = scene.setup.grips[0].vertices();
  for (int v : scene.setup.grips[1].vertices()) held.push_back(v);
  const clothctl::ClothState<double> state =
      settle(o, scene.body, place(o, grid, scene.task), held, is_implicit(o.plant) ? 2.4 : 4.8);
  const auto fit = [&](const Points& x, Scene& s) { fit_task(o, grid, corners, x, s); };
  if (o.hands) return run_hands(std::move(scene), o, grid, state, fit, hand);
  fit(state.positions, scene);
  AnyPlant plant = make_plant(o.plant, scene.body, scene.body.drag);
  plant.set_state(state);
  return run(scene, o, std::move(plant), make_predictor(o, scene.body, scene.settings));
}
