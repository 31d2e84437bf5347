// Two fingers hold a handkerchief at each upper corner and move it so that its lower corners follow
// a drawn motion. [Bai 2016], figures 4 and 8.
//
//   handkerchief --task async --out out          then open out/player.html

#include <filesystem>

#include "clothctl/mesh/grid.hpp"
#include "support/command_line.hpp"
#include "support/hand_files.hpp"
#include "support/hand_loop.hpp"
#include "support/handkerchief_scene.hpp"
#include "support/identified_plant.hpp"
#include "support/inputs.hpp"
#include "support/loop.hpp"

namespace {

using namespace program;

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
  app.add_option("--gusts", o.gusts, "Known gusts across the sheet, mean speed, m/s")
      ->check(between(0, 10));
  app.add_option("--features", features,
                 "Vertices that follow the targets, row·N + column, row 0 at the bottom (default: "
                 "lower corners)");
  HandFiles files;
  CLI::Option* hands = app.add_flag("--hands", o.hands, "Simulated hands move the sheet");
  add_hand(app, files)->needs(hands);
  add_model(app, o.model)->excludes(hands);
  app.add_option("--unknown", o.unknown,
                 "A gust from 1 s on that the planner is not told of, share of the weight")
      ->check(between(0, 2))
      ->excludes(hands);
  add_measurement(app, o);
  parse(app, o, argc, argv);
  hand = read_hand(files);
  if (o.hands && o.predictor == "identified")
    refuse("--hands: cannot be combined with --predictor identified");
  if (o.hands && o.measured) refuse("--hands: cannot be combined with an estimated state");
  if (0 < o.unknown && o.measured) refuse("--unknown: cannot be combined with an estimated state");
  if (2 * o.patch_size > o.cloth)
    refuse("--patch-size: " + std::to_string(o.patch_size) + " is over half of --cloth " +
           std::to_string(o.cloth));
  return o;
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
  scene.title = "Handkerchief: " + std::filesystem::path(o.targets).stem().string();
  fit_targets(o, grid, corners, x, scene.task);
}

}  // namespace

int main(int argc, char** argv) {
  std::string features;
  HandMaker hand;
  const Options o = read_options(argc, argv, features, hand);
  const Grid grid = must(clothctl::make_grid<double>(o.cloth, o.cloth, o.size, o.size));
  std::vector<int> corners{grid.vertex(0, 0), grid.vertex(0, grid.cols - 1)};
  if (!features.empty()) corners = read_vertices(features, "--features");
  Scene scene = handkerchief_scene(o, grid, corners, read_material(o.material));
  if (!o.targets.empty()) {
    scene.task = read_task(o);
    if (scene.task.curves.size() != corners.size())
      refuse(o.targets + ": has " + std::to_string(scene.task.curves.size()) + " curves for " +
             std::to_string(corners.size()) + " features");
  }
  const clothctl::ClothState<double> state =
      hang_handkerchief(o, grid, scene.task, scene, scene.body);
  const auto fit = [&](const Points& x, Scene& s) {
    fit_task(o, grid, corners, x, s);
    if (0 < o.gusts) s.task.wind = gusts(o.gusts);
  };
  if (o.hands) return run_hands(std::move(scene), o, grid, state, fit, hand);
  fit(state.positions, scene);
  const auto identified = identify_plant(scene, o, scene.body, state);
  return run(scene, o, plant_in_state(o.plant, scene.body, state),
             make_predictor(o, scene.body, scene.settings, identified));
}
