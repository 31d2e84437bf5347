#pragma once

// The closed loop that the programs share: run_frame after run_frame, recorded; then the figures
// and files of the run.

#include "support/scene.hpp"

namespace program {

/// Runs the loop on `plant`, writes the files that were asked for, prints the figures; returns the
/// program's exit code.
int run(const Scene& scene, const Options& o, AnyPlant plant, AnyPredictor predictor);

}  // namespace program
