#pragma once

// The engine's cloth of bring_your_own as a hanging sheet, also with other material and substeps
// than the planner knows, and what a long run with it counts.

#include <cstdint>
#include <vector>

#include "bring_your_own/cloth_plant.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/spring_network.hpp"

namespace program {

/// How the engine's cloth differs from the springs that it was made from.
struct ForeignVariant {
  double stiffness = 1, damping = 1;  // factors on all springs
  double drag = 0.2;                  // 1/s
  double substeps = 1;                // factor on as many as these springs need
};

/// Draws a variant: stiffness and damping from half to twice, drag from 0.1 to 0.8 1/s, substeps
/// from 0.71 to 1.41 times, each with an even density of its logarithm. The same on every machine.
ForeignVariant draw_variant(std::uint64_t seed);

/// Returns the engine's sheet at rest, hanging from its upper corners. The hands are closer
/// together than in the flat sheet, and the sheet starts bent, so that it folds to one side. Ends
/// the program where it does not come to rest.
game::Cloth hanging_foreign_cloth(const clothctl::GridMesh<double>& grid,
                                  const clothctl::SpringNetwork<double>& network,
                                  const ForeignVariant& variant);

/// Errors of a run, m and s.
class LongRun {
 public:
  /// Counts a frame: time at its end, mean and largest error, and what the planner says of itself.
  void add(double time, double mean, double largest, bool losing);
  /// Prints the figures.
  void print() const;

 private:
  static constexpr double kPart = 5, kLost = 0.03;  // s; m
  double sum_ = 0, largest_ = 0, first_ = 0, worst_ = 0, part_ = 0;
  double lost_ = -1, losing_ = -1;  // when the error passes kLost, and when that is said
  int frames_ = 0, part_frames_ = 0, parts_ = 0;
};

}  // namespace program
