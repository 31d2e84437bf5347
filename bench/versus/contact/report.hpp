#pragma once

// Tables on standard output, and the same figures as JSON.

#include <string>
#include <vector>

#include "run.hpp"

namespace versus {

/// All figures of one scene.
struct SceneReport {
  int side = 0;
  bool box = false, self = false;
  std::vector<RunResult> runs;
};

/// Prints engines and versions.
void print_entries(const std::vector<Entry>& entries);
/// Prints the table of one scene.
void print_scene(const SceneReport& report);
/// Returns all figures as JSON; figures that make no sense are null.
std::string to_json(const std::vector<Entry>& entries, const RunSettings& settings, int substeps,
                    const std::vector<SceneReport>& scenes);

}  // namespace versus
