#pragma once

// Seeded curves of many kinds for the study of reachability: some easy, some hard, some impossible.

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "support/tasks.hpp"

namespace program {

/// Where the two lower corners of a sheet rest, and how hands move them.
struct ReachStart {
  double size = 0.5;
  Vec left = Vec::Zero(), right = Vec::Zero();
  Vec hands[2] = {Vec::Zero(), Vec::Zero()};
  /// Returns the curves of the lower corners while the hands follow the given paths.
  std::function<Task(const Task&)> follow;
};

/// The kinds of curves, in the order in which seeds go through them.
const std::vector<std::string>& reach_kinds();

/// Returns the curve of a seed, of kind number (seed - 1) mod 8, and its name in `kind`. known: of
/// hands on random splines; random: two noisy lines; fast: those in less time; apart: corners that
/// part by up to 1.3 times the width of the sheet; jump: by up to 0.8 sizes in 0.06 to 0.4 s; sway:
/// up to 12 rad/s; drop: down and up again; calm: noisy lines on a small scale. `duration`: s.
Task make_reach_curve(std::uint64_t seed, double duration, const ReachStart& start,
                      std::string& kind);

}  // namespace program
