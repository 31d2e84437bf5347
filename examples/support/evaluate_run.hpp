#pragma once

// One run of the evaluation: its curve, its sheets, its loop. A run depends on its case and seed
// alone, so that it has the same bits whoever makes it, in whatever order.

#include <map>
#include <optional>
#include <string>

#include "support/evaluate_row.hpp"
#include "support/evaluate_study.hpp"
#include "support/handkerchief_scene.hpp"
#include "support/timing.hpp"

namespace program {

/// Makes runs; remembers sheets at rest and what was identified, which take long.
class Runner {
 public:
  /// Makes the run of a case and a seed. With `files`, a folder, it writes the files of the run
  /// there. `progress` shows its frames.
  Row run(const Evaluation& e, const Case& c, int seed, const std::string& files,
          Progress& progress);

 private:
  /// The curves of a run, which start where the corners of the predicted sheet rest.
  Task make_task(const Evaluation& e, const Case& c, int seed, const Grid& grid,
                 const Scene& scene);
  /// The sheet at rest.
  const clothctl::ClothState<double>& at_rest(const Options& o, const std::string& material,
                                              const Grid& grid, const Task& task,
                                              const Scene& scene, const Body& body);

  /// What --predictor identified tells of the plant that hangs in `rest`. `material`: how its body
  /// differs from the scene's.
  const std::optional<clothctl::IdentifiedResponse<double>>& identified(
      const Options& o, const std::string& material, const Scene& scene, const Body& body,
      const clothctl::ClothState<double>& rest);

  std::map<std::string, clothctl::ClothState<double>> rest_;
  std::map<std::string, std::optional<clothctl::IdentifiedResponse<double>>> identified_;
};

}  // namespace program
