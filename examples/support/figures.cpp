#include "support/figures.hpp"

#include <algorithm>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>

#include "support/timing.hpp"

namespace program {

void Figures::add_times(double planning, double plant) {
  frame_ms_.push_back(planning);
  plant_ms_.push_back(plant);
}

void Figures::add_plan(const std::vector<clothctl::Grip<double>>& grips,
                       const clothctl::PlanResult<double>& result,
                       const std::vector<clothctl::FingerForce<double>>& forces) {
  agreement_.push_back(result.agreement);
  prediction_.push_back(result.prediction_error);
  iterations_.push_back(result.qp_iterations);
  double patch_normal = 0;  // of the current finger, whose vertices are consecutive
  for (std::size_t i = 0; i < forces.size(); ++i) {
    const clothctl::FingerForce<double>& f = forces[i];
    const clothctl::Finger<double>& finger =
        grips[static_cast<std::size_t>(f.grip)].fingers[static_cast<std::size_t>(f.finger)];
    const bool same = i > 0 && forces[i - 1].grip == f.grip && forces[i - 1].finger == f.finger;
    patch_normal = (same ? patch_normal : 0) + f.force.dot(f.normal);
    const double violation = clothctl::cone_violation<double>(
        f.force, f.normal, finger.contact.friction, finger.max_normal_force);
    summary.cone_violation_max =
        std::max({summary.cone_violation_max, violation, patch_normal - finger.max_normal_force});
  }
  summary.suboptimal_frames += result.status == clothctl::PlanStatus::Suboptimal ? 1 : 0;
  summary.relaxed_frames += result.status == clothctl::PlanStatus::Relaxed ? 1 : 0;
  summary.patch_residual_max_m = std::max(summary.patch_residual_max_m, result.patch_residual);
}

Summary Figures::sum_up(Index features, Index frames, double size) {
  summary.scored_frames = static_cast<Index>(errors.size()) / features;
  double total = 0;
  for (double e : errors) total += e;
  const double unknown = std::numeric_limits<double>::quiet_NaN();  // "null" in the summary
  summary.mean_error_m = errors.empty() ? unknown : total / static_cast<double>(errors.size());
  summary.p95_error_m = errors.empty() ? unknown : quantile(errors, 0.95);
  summary.max_error_m = errors.empty() ? unknown : *std::max_element(errors.begin(), errors.end());
  if (summary.frames == frames && summary.mean_error_m > 0.5 * size)
    summary.status = "lost the track";
  summary.frame_ms_median = quantile(frame_ms_, 0.5);
  summary.frame_ms_p99 = quantile(frame_ms_, 0.99);
  summary.plant_ms_median = quantile(plant_ms_, 0.5);
  for (double ms : frame_ms_) summary.planning_s += ms / 1000;
  summary.agreement = quantile(agreement_, 0.5);
  summary.prediction_error_m = quantile(prediction_, 0.5);
  summary.qp_iterations_median = quantile(iterations_, 0.5);
  return summary;
}

nlohmann::ordered_json setup_json(const Scene& scene, const Options& o) {
  return {{"material", scene.material},
          {"plant", o.plant},
          {"grip", o.grip},
          {"patch", o.patch},
          {"horizon", o.horizon},
          {"vertices", scene.body.network.vertex_count()},
          {"size_m", o.size},
          {"patch_size", o.patch_size},
          {"predictor", chosen_predictor(o)},
          {"profile", o.profile},
          {"spread", o.spread},
          {"friction", scene.setup.grips.front().fingers.front().contact.friction},
          {"limit_N", o.limit},
          {"max_step_mm", o.max_step_mm},
          {"max_acceleration", o.max_acceleration}};
}

std::string to_json(const Summary& s, const Scene& scene, const Options& o, int indent) {
  nlohmann::ordered_json j;
  j["status"] = s.status;
  j["frames"] = s.frames;
  j["mean_error_m"] = s.mean_error_m;
  j["p95_error_m"] = s.p95_error_m;
  j["max_error_m"] = s.max_error_m;
  j["frame_ms_median"] = s.frame_ms_median;
  j["frame_ms_p99"] = s.frame_ms_p99;
  j["plant_ms_median"] = s.plant_ms_median;
  j["agreement"] = s.agreement;
  j["prediction_error_m"] = s.prediction_error_m;
  j["qp_iterations_median"] = s.qp_iterations_median;
  j["cone_violation_max"] = s.cone_violation_max;
  j["hand_speed_max"] = s.hand_speed_max;
  j["patch_residual_max_m"] = s.patch_residual_max_m;
  j["suboptimal_frames"] = s.suboptimal_frames;
  j["relaxed_frames"] = s.relaxed_frames;
  j["scored_frames"] = s.scored_frames;
  j["setup"] = {{o.targets.empty() ? "task" : "targets", o.targets.empty() ? o.task : o.targets}};
  j["setup"].update(setup_json(scene, o));
  j["setup"]["seed"] = o.seed;
  return j.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}

void print(const Summary& s, const Options& o) {
  std::printf("%s: %ld frames, mean error %.2f mm, 95 %% below %.2f mm, max %.2f mm\n",
              s.status.c_str(), static_cast<long>(s.frames), 1000 * s.mean_error_m,
              1000 * s.p95_error_m, 1000 * s.max_error_m);
  std::printf("planning %.2f ms a frame (p99 %.2f), plant %.2f ms, agreement %.3f\n",
              s.frame_ms_median, s.frame_ms_p99, s.plant_ms_median, s.agreement);
  if (!o.out.empty()) std::printf("open %s/player.html\n", o.out.c_str());
}

}  // namespace program
