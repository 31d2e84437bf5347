#pragma once

// Trials of the study of reachability: a sheet at rest, and closed loops on it.

#include <optional>
#include <string>

#include "support/figures.hpp"
#include "support/handkerchief_scene.hpp"
#include "support/reach_curves.hpp"
#include "support/timing.hpp"

namespace program {

/// A handkerchief at rest between two hands, on which trials start.
class ReachBench {
 public:
  explicit ReachBench(const Options& o);

  /// Returns the curve of a seed.
  Task curve(std::uint64_t seed, double duration, std::string& kind) const;
  /// Runs the loop from rest. `progress` shows its frames.
  Summary run(const Task& task, Progress& progress) const;

  const Scene& scene() const { return scene_; }
  const Points& positions() const { return rest_.positions; }

 private:
  Options options_;
  Grid grid_;
  Scene scene_;
  clothctl::ClothState<double> rest_;
  std::optional<clothctl::IdentifiedResponse<double>> identified_;
};

}  // namespace program
