#pragma once

// A sheet that follows one curve: by a planner, and by the best hands that there are for it.

#include <cstdint>
#include <string>

#include "clothctl/mpc/whole_curve.hpp"
#include "support/handkerchief_scene.hpp"
#include "support/timing.hpp"

namespace program {

/// What is compared on every curve.
struct WholeTrialOptions {
  std::string kind = "known";    // of curves from seeds: known or random
  double seconds = 5;            // their duration
  double hand_weight = 1;        // factor on the weights of the hands' motion
  std::string start = "anchor";  // planner, anchor or both
  int iterations = 30;
};

/// How well hands follow the targets; the last window does not count.
struct WholeFigures {
  double mean_error_m = 0, max_error_m = 0, cost = 0, hand_speed_max = 0;
};

/// The outcome of one curve.
struct WholeTrial {
  std::string name;
  std::string status = "finished";  // of the planner
  std::string optimum_status;
  WholeFigures planner, optimum;
  double gradient_norm = 0;  // 1/m
  int iterations = 0, products = 0, rollouts = 0;
  double optimise_s = 0;            // processor time
  clothctl::MatrixX<double> hands;  // of the optimum, 6 × frames, m
};

/// Runs the planner on the curve of a seed (or, if `o` has a file of targets, of that), then
/// improves its hands' path over the whole curve, and that of the anchor.
WholeTrial run_whole_trial(const Options& o, const WholeTrialOptions& w, std::uint64_t seed,
                           Progress& progress);

}  // namespace program
