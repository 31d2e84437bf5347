#pragma once

// The closed loop that the programs share: run_frame after run_frame, recorded; then the figures
// and files of the run.

#include "support/scene.hpp"

namespace program {

/// Runs the loop on `plant`, writes the requested files and prints the figures. Returns the
/// program's exit code.
int run(const Scene& scene, const Options& o, AnyPlant plant, AnyPredictor predictor);

}  // namespace program
