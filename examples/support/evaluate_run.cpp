#include "support/evaluate_run.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "support/identified_plant.hpp"
#include "support/inputs.hpp"
#include "support/loop.hpp"

namespace program {

namespace {

/// Scales a quantity of a material.
clothctl::Material<double> changed(clothctl::Material<double> m, const Mismatch& mismatch) {
  const double f = mismatch.factor;
  if (mismatch.quantity == "density") m.area_density *= f;
  if (mismatch.quantity == "drag") m.drag *= f;
  if (mismatch.quantity == "stiffness") {
    m.stretch_warp *= f;
    m.stretch_weft *= f;
    m.shear *= f;
  }
  if (mismatch.quantity == "bending") {
    m.bending_warp *= f;
    m.bending_weft *= f;
  }
  return m;
}

/// Measures the curves: mean over both of length and speed, m and m/s.
void measure(const Task& task, Row& row) {
  const long frames = std::lround(task.duration / 0.02);
  for (const auto& curve : task.curves) {
    for (long i = 0; i < frames; ++i) {
      const double t = 0.02 * static_cast<double>(i);
      const double way = (curve.position(t + 0.02) - curve.position(t)).norm();
      row.curve_length_m += way / static_cast<double>(task.curves.size());
      row.curve_speed_max = std::max(row.curve_speed_max, way / 0.02);
    }
  }
  row.curve_speed_mean = row.curve_length_m / task.duration;
}

void take(const Summary& s, Row& row) {
  row.status = s.status;
  row.frames = static_cast<double>(s.frames);
  row.scored_frames = static_cast<double>(s.scored_frames);
  row.mean_error_m = s.mean_error_m;
  row.p95_error_m = s.p95_error_m;
  row.max_error_m = s.max_error_m;
  row.prediction_error_m = s.prediction_error_m;
  row.agreement = s.agreement;
  row.hand_speed_max = s.hand_speed_max;
  row.cone_violation_max = s.cone_violation_max;
  row.frame_ms_median = s.frame_ms_median;
  row.frame_ms_p99 = s.frame_ms_p99;
  row.plant_ms_median = s.plant_ms_median;
  row.planning_s = s.planning_s;
}

}  // namespace

const clothctl::ClothState<double>& Runner::at_rest(const Options& o, const std::string& material,
                                                    const Grid& grid, const Task& task,
                                                    const Scene& scene, const Body& body) {
  const std::string key = (is_implicit(o.plant) ? "newton" : o.plant) + "/" +
                          std::to_string(o.cloth) + "/" + material + "/" + o.targets;
  const auto known = rest_.find(key);
  if (known != rest_.end()) return known->second;
  return rest_.emplace(key, hang_handkerchief(o, grid, task, scene, body)).first->second;
}

const std::optional<clothctl::IdentifiedResponse<double>>& Runner::identified(
    const Options& o, const std::string& material, const Scene& scene, const Body& body,
    const clothctl::ClothState<double>& rest) {
  const std::string key = o.plant + "/" + std::to_string(o.cloth) + "/" + material + "/" +
                          o.targets + "/" + std::to_string(o.horizon);
  const auto known = identified_.find(key);
  if (known != identified_.end()) return known->second;
  return identified_.emplace(key, identify_plant(scene, o, body, rest)).first->second;
}

Task Runner::make_task(const Evaluation& e, const Case& c, int seed, const Grid& grid,
                       const Scene& scene) {
  const auto number = static_cast<std::uint64_t>(seed);
  Options o = c.run;
  o.plant = "newton";  // curves do not depend on the plant that shall follow them
  const clothctl::ClothState<double>& rest = at_rest(o, "", grid, {}, scene, scene.body);
  if (c.kind == "random") {
    const std::vector<int> corners = lower_corners(grid);
    return make_random_task(number, c.noise_sd, e.seconds, o.size, rest.positions.col(corners[0]),
                            rest.positions.col(corners[1]));
  }
  Vec hands[2];
  for (std::size_t side = 0; side < 2; ++side)
    hands[side] = rest.positions.col(scene.setup.grips[side].vertices().front());
  return follow_hands(grid, scene, rest,
                      make_hand_paths(number, c.noise_sd, e.seconds, o.size, hands[0], hands[1]));
}

Row Runner::run(const Evaluation& e, const Case& c, int seed, const std::string& files,
                Progress& progress) {
  Options o = c.run;
  o.seed = static_cast<std::uint64_t>(seed);
  o.out = files;
  Row row;
  row.study_case = c.name;
  row.value = c.value;
  row.seed = seed;
  if (!e.curves.empty()) o.targets = e.curves[static_cast<std::size_t>(seed - 1)];
  const Grid grid = must(clothctl::make_grid<double>(o.cloth, o.cloth, o.size, o.size));
  const std::vector<int> corners = lower_corners(grid);
  const clothctl::Material<double> material = read_material(o.material);
  Scene scene = handkerchief_scene(o, grid, corners, material);
  scene.task = e.curves.empty() ? make_task(e, c, seed, grid, scene) : read_task(o);
  row.curve = e.curves.empty() ? c.kind : std::filesystem::path(o.targets).stem().string();
  scene.title = "Evaluation: " + c.name + ", " + row.curve + " " + std::to_string(seed);
  const Body body = c.mismatch.quantity.empty()
                        ? scene.body
                        : handkerchief_scene(o, grid, corners, changed(material, c.mismatch)).body;
  const std::string changes = c.mismatch.quantity + std::to_string(c.mismatch.factor);
  const Task place = e.curves.empty() ? Task() : scene.task;
  const clothctl::ClothState<double>& rest =
      at_rest(o, c.mismatch.quantity.empty() ? "" : changes, grid, place, scene, body);
  fit_targets(o, grid, corners, rest.positions, scene.task);
  measure(scene.task, row);
  row.vertices = static_cast<double>(grid.positions.cols());
  AnyPlant plant = plant_in_state(o.plant, body, rest);
  RunRecorder recorder(scene, o, scored_frames(scene, o));
  AnyPredictor predictor =
      make_predictor(o, scene.body, scene.settings, identified(o, changes, scene, body, rest));
  const Summary summary = run_loop(scene, o, plant, std::move(predictor), recorder, progress);
  take(summary, row);
  if (!files.empty()) recorder.write(summary);
  return row;
}

}  // namespace program
