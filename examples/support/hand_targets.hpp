#pragma once

// What hand_reach measures: inverse kinematics at many random targets, from starts near them and
// from random starts, and a page that shows the hand.

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "clothctl/robot/kinematic_tree.hpp"

namespace program {

/// What the user asked for.
struct ReachRequest {
  std::string model, oracle, out;
  std::vector<std::string> tips;
  int targets = 0;
  std::uint64_t seed = 1;
  bool single = false, json = false;
};

/// Counts and times of several solves.
struct Tally {
  int solves = 0, reached = 0, local_minimum = 0, iteration_limit = 0, starts = 0;
  double error = 0, worst = 0;  // of those that reached, and of all (m)
  std::vector<double> iterations, microseconds;
};

/// Counts for targets at random poses: from random starts, from starts near the targets, and of
/// targets out of reach.
struct ReachRuns {
  Tally random, near_starts, unreachable;
};

/// Returns the links that --tips names, or the ends of all chains. Ends the program where a name is
/// wrong.
template <class Scalar>
std::vector<int> find_tips(const clothctl::KinematicTree<Scalar>& tree, const ReachRequest& o);

/// Draws targets and starts, and solves for all of them. It prints progress.
template <class Scalar>
ReachRuns run_targets(const clothctl::KinematicTree<Scalar>& tree, const std::vector<int>& tips,
                      const ReachRequest& o);

/// Adds the figures of several solves; `suffix` is appended to the keys.
void add_tally(nlohmann::ordered_json& j, const Tally& t, const std::string& suffix);
/// Adds further figures.
void add_more(nlohmann::ordered_json& j, const Tally& t, const std::string& suffix);

/// Writes `player.html` to the folder that the request names: the hand goes from target to target.
void write_reach_page(const clothctl::KinematicTree<double>& tree, const std::string& name,
                      const std::vector<int>& tips, const ReachRequest& o,
                      const nlohmann::ordered_json& figures);

}  // namespace program
