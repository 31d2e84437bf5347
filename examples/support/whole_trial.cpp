#include "support/whole_trial.hpp"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/run_frame.hpp"
#include "support/inputs.hpp"
#include "support/loop.hpp"

namespace program {

namespace {

using Curve = clothctl::WholeCurve<double>;

/// A sheet at rest, and what its lower corners shall do.
struct WholeScene {
  Grid grid;
  Scene scene;
  clothctl::ClothState<double> rest;

  clothctl::Vector3<double> operator()(Index i, double t) const {
    return scene.task.curves[static_cast<std::size_t>(i)].position(t);
  }
  Vec hand(std::size_t side) const {
    return rest.positions.col(scene.setup.grips[side].vertices().front());
  }
};

WholeScene make_whole_scene(const Options& o, const WholeTrialOptions& w, std::uint64_t seed) {
  WholeScene s;
  s.grid = must(clothctl::make_grid<double>(o.cloth, o.cloth, o.size, o.size));
  const std::vector<int> corners = lower_corners(s.grid);
  s.scene = handkerchief_scene(o, s.grid, corners, read_material(o.material));
  Task given;
  if (!o.targets.empty()) given = read_task(o);
  s.rest = hang_handkerchief(o, s.grid, given, s.scene, s.scene.body);
  if (!o.targets.empty()) {
    s.scene.task = given;
    fit_targets(o, s.grid, corners, s.rest.positions, s.scene.task);
  } else if (w.kind == "random") {
    s.scene.task =
        make_random_task(seed, 0.06 * o.size, w.seconds, o.size, s.rest.positions.col(corners[0]),
                         s.rest.positions.col(corners[1]));
  } else {
    s.scene.task =
        follow_hands(s.grid, s.scene, s.rest,
                     make_hand_paths(seed, 0.04 * o.size, w.seconds, o.size, s.hand(0), s.hand(1)));
  }
  return s;
}

/// Runs the planner, and returns the path of its hands. A run that ends early goes on with its
/// hands at rest.
clothctl::MatrixX<double> planned_path(WholeScene& s, const Options& o, Index frames,
                                       WholeTrial& trial, Progress& progress) {
  AnyPredictor predictor = make_predictor(o, s.scene.body, s.scene.settings);
  auto planner = must(clothctl::Planner<AnyPredictor>::create(
      s.scene.setup, s.scene.settings, std::move(predictor), s.rest.positions));
  AnyPlant plant = plant_in_state("newton", s.scene.body, s.rest);
  clothctl::PlanResult<double> result = planner.make_result();
  clothctl::MatrixX<double> path(6, frames);
  for (Index k = 0; k < frames; ++k) {
    progress.show(k, frames);
    if (trial.status == "finished" &&
        !run_frame(planner, plant, s.scene.settings.dt * static_cast<double>(k), s, result)
             .advanced())
      trial.status = "ended in frame " + std::to_string(k);
    for (std::size_t g = 0; g < 2; ++g)
      path.block<3, 1>(3 * static_cast<Index>(g), k) =
          plant.positions().col(s.scene.setup.grips[g].vertices().front());
  }
  progress.clear();
  return path;
}

WholeFigures measure_whole(const Curve& curve, const clothctl::WholeCurveResult<double>& result,
                           const WholeScene& s) {
  WholeFigures figures;
  figures.cost = result.cost;
  const Index frames = result.path.cols(), scored = frames - s.scene.settings.horizon;
  for (Index k = 0; k < frames; ++k) {
    for (Index i = 0; i < 2; ++i) {
      const Vec before =
          k == 0 ? s.hand(static_cast<std::size_t>(i)) : Vec(result.path.block<3, 1>(3 * i, k - 1));
      const double speed =
          (result.path.block<3, 1>(3 * i, k) - before).norm() / s.scene.settings.dt;
      figures.hand_speed_max = std::max(figures.hand_speed_max, speed);
      if (k >= scored) continue;
      const double error =
          (result.features.block<3, 1>(3 * i, k) - curve.targets().block<3, 1>(3 * i, k)).norm();
      figures.mean_error_m += error / (2 * static_cast<double>(scored));
      figures.max_error_m = std::max(figures.max_error_m, error);
    }
  }
  return figures;
}

}  // namespace

WholeTrial run_whole_trial(const Options& o, const WholeTrialOptions& w, std::uint64_t seed,
                           Progress& progress) {
  WholeScene s = make_whole_scene(o, w, seed);
  WholeTrial trial;
  trial.name = o.targets.empty() ? w.kind + " " + std::to_string(seed)
                                 : std::filesystem::path(o.targets).stem().string();
  const Index frames = scored_frames(s.scene, o) + s.scene.settings.horizon - 1;
  const clothctl::MatrixX<double> path = planned_path(s, o, frames, trial, progress);
  auto settings = clothctl::WholeCurveSettings<double>::of(s.scene.settings);
  for (double* weight :
       {&settings.weights.velocity, &settings.weights.smooth, &settings.weights.jerk})
    *weight *= w.hand_weight;
  settings.max_iterations = w.iterations;
  const double begin = thread_seconds();
  Curve curve = must(Curve::create(
      make_mass_spring(s.scene.body, s.scene.body.network, clothctl::Integration::Newton),
      s.scene.setup, settings, s.rest, s, 0.0, frames));
  clothctl::MatrixX<double> gradient;
  trial.planner = measure_whole(curve, must(curve.evaluate(path, gradient)), s);
  for (const bool anchored : {false, true}) {
    if (w.start == (anchored ? "planner" : "anchor")) continue;
    const auto best = must(curve.optimise(anchored ? curve.anchor_path() : path));
    trial.iterations += best.iterations;
    trial.products += best.products;
    trial.rollouts += best.rollouts;
    if (!trial.optimum_status.empty() && trial.optimum.cost <= best.cost) continue;
    trial.optimum = measure_whole(curve, best, s);
    trial.optimum_status = to_string(best.status);
    trial.gradient_norm = best.gradient_norm;
    trial.hands = best.path;
  }
  trial.optimise_s = thread_seconds() - begin;
  return trial;
}

}  // namespace program
