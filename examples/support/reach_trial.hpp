#pragma once

// Trials of the study of reachability: a sheet at rest, and closed loops on it.

#include <nlohmann/json.hpp>
#include <string>

#include "support/handkerchief_scene.hpp"
#include "support/reach_curves.hpp"

namespace program {

/// What decides the outcome of a trial, for --json.
nlohmann::ordered_json setup_json(const Options& o);

/// How a closed loop ended. Errors in m: means and largest over corners and frames.
struct TrialOutcome {
  bool finished = false;
  double mean_error_m = 0, max_error_m = 0;
};

/// A handkerchief at rest between two hands, on which trials start.
class ReachBench {
 public:
  explicit ReachBench(const Options& o);

  /// Returns the curve of a seed.
  Task curve(std::uint64_t seed, double duration, std::string& kind) const;
  /// Runs the loop from rest until a window before the end of the curves.
  TrialOutcome run(const Task& task) const;

  const Scene& scene() const { return scene_; }
  const Points& positions() const { return rest_.positions; }

 private:
  Task follow(const Task& hands) const;

  Options options_;
  Grid grid_;
  Scene scene_;
  clothctl::ClothState<double> rest_;
};

}  // namespace program
