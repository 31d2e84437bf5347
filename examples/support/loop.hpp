#pragma once

// The closed loop that the programs share: run_frame after run_frame, recorded; then the figures
// and files of the run.

#include "support/figures.hpp"
#include "support/recorder.hpp"
#include "support/scene.hpp"
#include "support/timing.hpp"

namespace program {

/// Returns the number of frames that count for the errors, and refuses a task that is too short. In
/// the last window the targets are extrapolated.
Index scored_frames(const Scene& scene, const Options& o);

/// Runs the loop on `plant` and records it. Returns the figures.
Summary run_loop(const Scene& scene, const Options& o, AnyPlant& plant, AnyPredictor predictor,
                 RunRecorder& recorder, Progress& progress);

/// Runs the loop on `plant`, writes the requested files and prints the figures. Returns the
/// program's exit code.
int run(const Scene& scene, const Options& o, AnyPlant plant, AnyPredictor predictor);

}  // namespace program
