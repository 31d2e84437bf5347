#include "support/reach_trial.hpp"

#include <utility>

#include "support/identified_plant.hpp"
#include "support/inputs.hpp"
#include "support/loop.hpp"

namespace program {

ReachBench::ReachBench(const Options& o)
    : options_(o),
      grid_(must(clothctl::make_grid<double>(o.cloth, o.cloth, o.size, o.size))),
      scene_(handkerchief_scene(o, grid_, lower_corners(grid_), read_material(o.material))),
      rest_(hang_handkerchief(o, grid_, {}, scene_, scene_.body)) {
  identified_ = identify_plant(scene_, o, scene_.body, rest_);
}

Task ReachBench::curve(std::uint64_t seed, double duration, std::string& kind) const {
  const std::vector<int> corners = lower_corners(grid_);
  ReachStart start;
  start.size = options_.size;
  start.left = rest_.positions.col(corners[0]);
  start.right = rest_.positions.col(corners[1]);
  for (std::size_t side = 0; side < 2; ++side)
    start.hands[side] = rest_.positions.col(scene_.setup.grips[side].vertices().front());
  start.follow = [this](const Task& hands) { return follow_hands(grid_, scene_, rest_, hands); };
  return make_reach_curve(seed, duration, start, kind);
}

Summary ReachBench::run(const Task& task, Progress& progress) const {
  Scene scene = scene_;
  scene.task = task;
  AnyPlant plant = plant_in_state(options_.plant, scene.body, rest_);
  RunRecorder recorder(scene, options_, scored_frames(scene, options_));
  AnyPredictor predictor = make_predictor(options_, scene.body, scene.settings, identified_);
  return run_loop(scene, options_, plant, std::move(predictor), recorder, progress);
}

}  // namespace program
