#include "support/reach_trial.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/run_frame.hpp"
#include "support/inputs.hpp"

namespace program {

nlohmann::ordered_json setup_json(const Options& o) {
  return {{"cloth", o.cloth},
          {"size_m", o.size},
          {"material", o.material},
          {"plant", o.plant},
          {"grip", o.grip},
          {"predictor", chosen_predictor(o)},
          {"horizon", o.horizon},
          {"max_step_mm", o.max_step_mm},
          {"max_acceleration", o.max_acceleration}};
}

namespace {

Scene make_scene(const Options& o, const Grid& grid) {
  const std::vector<int> corners{grid.vertex(0, 0), grid.vertex(0, grid.cols - 1)};
  return handkerchief_scene(o, grid, corners, read_material(o.material));
}

}  // namespace

ReachBench::ReachBench(const Options& o)
    : options_(o),
      grid_(must(clothctl::make_grid<double>(o.cloth, o.cloth, o.size, o.size))),
      scene_(make_scene(o, grid_)),
      rest_(hang_handkerchief(o, grid_, {}, scene_, scene_.body)) {}

Task ReachBench::curve(std::uint64_t seed, double duration, std::string& kind) const {
  ReachStart start;
  start.size = options_.size;
  start.left = rest_.positions.col(grid_.vertex(0, 0));
  start.right = rest_.positions.col(grid_.vertex(0, grid_.cols - 1));
  for (std::size_t side = 0; side < 2; ++side)
    start.hands[side] = rest_.positions.col(scene_.setup.grips[side].vertices().front());
  start.follow = [this](const Task& hands) { return follow(hands); };
  return make_reach_curve(seed, duration, start, kind);
}

Task ReachBench::follow(const Task& hands) const {
  AnyPlant plant = make_plant("newton", scene_.body, scene_.body.drag);
  plant.set_state(rest_);
  const clothctl::VectorX<double> times = frame_times(hands.duration);
  Points paths[2] = {Points(3, times.size()), Points(3, times.size())};
  clothctl::ClothInput<double> input;
  for (const clothctl::Grip<double>& grip : scene_.setup.grips)
    input.driven_vertices.push_back(grip.vertices().front());
  input.driven_positions.resize(3, 2);
  for (Index i = 0; i < times.size(); ++i) {
    for (Index side = 0; side < 2; ++side)
      input.driven_positions.col(side) =
          hands.curves[static_cast<std::size_t>(side)].position(times[i]);
    plant.apply(input);
    if (i > 0 && !plant.advance(0.02).advanced)
      refuse("the sheet cannot follow the hands in frame " + std::to_string(i));
    paths[0].col(i) = plant.positions().col(grid_.vertex(0, 0));
    paths[1].col(i) = plant.positions().col(grid_.vertex(0, grid_.cols - 1));
  }
  return curves_task(times, paths[0], paths[1]);
}

TrialOutcome ReachBench::run(const Task& task) const {
  AnyPlant plant = make_plant(options_.plant, scene_.body, scene_.body.drag);
  plant.set_state(rest_);
  clothctl::PlannerSettings<double> settings = scene_.settings;
  AnyPredictor predictor = make_predictor(options_, scene_.body, settings);
  auto planner = must(clothctl::Planner<AnyPredictor>::create(
      scene_.setup, settings, std::move(predictor), plant.positions()));
  clothctl::PlanResult<double> result = planner.make_result();
  const auto target = [&](Index i, double t) {
    return task.curves[static_cast<std::size_t>(i)].position(t);
  };
  const long frames = std::lround(task.duration / settings.dt) - settings.horizon;
  TrialOutcome out;
  for (long frame = 0; frame < frames; ++frame) {
    const double t = settings.dt * static_cast<double>(frame);
    const auto report = run_frame(planner, plant, t, target, task.wind, result);
    if (!report.advanced()) return out;
    out.mean_error_m += report.mean_error / static_cast<double>(frames);
    out.max_error_m = std::max(out.max_error_m, report.max_error);
  }
  out.finished = std::isfinite(out.mean_error_m);
  return out;
}

}  // namespace program
