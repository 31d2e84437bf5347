// A handkerchief is held by two fingers at each upper corner and moved so that its lower corners follow a drawn motion.
// Paper 000, figures 4 and 8.
//
//   handkerchief --task async --out out          then open out/player.html

#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>

#include "clothctl/cloth/sheet.hpp"
#include "clothctl/io/file.hpp"
#include "support/loop.hpp"

namespace {

using namespace program;

/// A preset's name, or a JSON file with the quantities of clothctl::Material.
clothctl::Material<double> read_material(const std::string& name) {
  if (name.find('.') == std::string::npos && name.find('/') == std::string::npos)
    return must(clothctl::material_preset<double>(name));
  const std::string text = must(clothctl::read_file(name));
  nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
  if (json.is_discarded() || !json.is_object()) refuse(name + ": not a JSON object");
  clothctl::Material<double> material;
  material.name = name;
  for (const auto& [key, value] : json.items()) {
    if (key == "name" && value.is_string()) {
      material.name = value.get<std::string>();
      continue;
    }
    double* quantity = key == "area_density"   ? &material.area_density
                       : key == "stretch"      ? &material.stretch
                       : key == "shear"        ? &material.shear
                       : key == "bending"      ? &material.bending
                       : key == "damping_time" ? &material.damping_time
                       : key == "drag"         ? &material.drag
                       : key == "friction"     ? &material.friction
                       : key == "air_normal"   ? &material.air_normal
                       : key == "air_tangent"  ? &material.air_tangent
                                               : nullptr;
    if (quantity == nullptr) refuse(name + ": unknown quantity \"" + key + "\"");
    if (!value.is_number()) refuse(name + ": " + key + " is " + value.dump() + ", expected a number");
    *quantity = value.get<double>();
  }
  if (std::string problem = material.check(); !problem.empty()) refuse(problem);
  return material;
}

std::vector<int> read_vertices(const std::string& list) {
  std::vector<int> out;
  std::stringstream stream(list);
  for (std::string cell; std::getline(stream, cell, ',');) {
    char* end = nullptr;
    const long value = std::strtol(cell.c_str(), &end, 10);
    if (cell.empty() || *end != '\0' || value < -1000000000 || value > 1000000000)
      refuse("--features: \"" + cell + "\" is not a vertex index");
    out.push_back(static_cast<int>(value));
  }
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  Options o;
  std::string features;
  CLI::App app{"A handkerchief, held at its upper corners, is moved so that its lower corners follow a drawn motion."};
  add_common(app, o, {"async", "circle", "wind"}, "Built-in motion, instead of --targets");
  app.add_option("--cloth", o.cloth, "Vertices along a side; 65 is the paper's sheet")
      ->check(between(3, 129))
      ->capture_default_str();
  app.add_option("--size", o.size, "Side of the sheet, m")->check(between(0.01, 100))->capture_default_str();
  app.add_option("--material", o.material, "Preset name or JSON file")->capture_default_str();
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
                 "Vertices that follow the targets, row·N + column, row 0 at the bottom (default: lower corners)");
  parse(app, o, argc, argv);

  const clothctl::Material<double> material = read_material(o.material);
  const double friction = o.friction_given ? o.friction : material.friction;
  const bool windy = o.targets.empty() && o.task == "wind";
  if (2 * o.patch_size > o.cloth)
    refuse("--patch-size: " + std::to_string(o.patch_size) + " is over half of --cloth " + std::to_string(o.cloth));
  const clothctl::GridMesh<double> grid = must(clothctl::make_grid<double>(o.cloth, o.cloth, o.size, o.size));

  Scene scene;
  scene.material = material.name;
  scene.body.network = must(clothctl::sheet_network(grid, material));
  scene.body.drag = material.drag;
  if (windy) scene.body.air = {1.2, material.air_normal, material.air_tangent};

  const int top = o.cloth - 1, last = o.cloth - 1, p = o.patch_size;
  std::vector<std::vector<int>> patches(2);
  for (int row = top - p + 1; row <= top; ++row) {
    for (int col = 0; col < p; ++col) {
      patches[0].push_back(grid.vertex(row, col));
      patches[1].push_back(grid.vertex(row, last - col));
    }
  }
  for (const std::vector<int>& patch : patches)
    scene.setup.grips.push_back(clothctl::make_pinch<double>(patch, friction, o.limit, o.generators));
  std::vector<int> corners{grid.vertex(0, 0), grid.vertex(0, last)};
  if (!features.empty()) corners = read_vertices(features);
  for (int v : corners) scene.setup.features.add_point(v);
  scene.setup.triangles = scene.body.network.triangles;
  scene.settings = planner_settings(o, 9.81 * scene.body.network.mass.sum());
  if (std::string problem = clothctl::check_features<double>(scene.setup.features, grid.positions.cols()); !problem.empty())
    refuse("--features: " + problem);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (std::count(corners.begin(), corners.begin() + static_cast<std::ptrdiff_t>(i), corners[i]) > 0)
      refuse("--features: vertex " + std::to_string(corners[i]) + " occurs twice");
  }
  if (std::string problem = clothctl::check_grips(scene.setup.grips, grid.positions.cols()); !problem.empty()) refuse(problem);
  if (std::string problem = scene.settings.check(); !problem.empty()) refuse(problem);

  // The sheet hangs in the vertical plane through the first targets, left to right along them, hands `spread` apart.
  Vec middle(0, 0, -o.size), along(1, 0, 0);
  if (!o.targets.empty()) {
    scene.task = read_task(o);
    if (scene.task.curves.size() != corners.size()) {
      refuse(o.targets + ": has " + std::to_string(scene.task.curves.size()) + " curves for " + std::to_string(corners.size()) +
             " features");
    }
    const Vec left = scene.task.curves.front().position(0), right = scene.task.curves.back().position(0);
    middle = (left + right) / 2;
    const Vec level(right[0] - left[0], right[1] - left[1], 0);
    if (level.norm() > 1e-6) along = level.normalized();
  }
  const Vec up(0, 0, 1), normal = up.cross(along), hands = middle + o.size * up;
  clothctl::ClothState<double> state{grid.positions, Points::Zero(3, grid.positions.cols())};
  for (Index i = 0; i < grid.positions.cols(); ++i) {
    const Vec flat = grid.positions.col(i);
    const double bow = 0.25 * std::sqrt(1 - o.spread) * o.size * std::cos(3.14159265358979323846 * flat[0] / o.size);
    state.positions.col(i) = hands + o.spread * flat[0] * along + flat[2] * up + bow * normal;
  }
  std::vector<int> held = patches[0];
  held.insert(held.end(), patches[1].begin(), patches[1].end());
  state = settle(o, scene.body, std::move(state), held, is_implicit(o.plant) ? 2.4 : 4.8);

  if (o.targets.empty()) {
    scene.task = make_handkerchief_task(o.task, o.seed, o.size, state.positions.col(corners.front()),
                                        state.positions.col(corners.back()));
    scene.title = "Handkerchief: " + o.task;
    if (corners.size() != 2) refuse("--features: the built-in tasks move 2 features, not " + std::to_string(corners.size()));
  } else {
    for (std::size_t i = 0; i < corners.size(); ++i) {
      scene.task.curves[i].translate(state.positions.col(corners[i]) - scene.task.curves[i].position(0));
    }
    scene.title = "Handkerchief: " + std::filesystem::path(o.targets).stem().string();
    for (std::size_t i = 0; i + 1 < corners.size(); ++i) {
      const double cloth = (grid.positions.col(corners[i]) - grid.positions.col(corners[i + 1])).norm();
      check_reach(o, scene.task, i, i + 1, cloth);
    }
  }
  AnyPlant plant = make_plant(o.plant, scene.body, scene.body.drag);
  plant.set_state(state);
  AnyPredictor predictor = make_predictor(o, scene.body, scene.settings);
  return run(scene, o, std::move(plant), std::move(predictor));
}
