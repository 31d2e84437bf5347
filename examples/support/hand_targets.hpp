#pragma once

// The measurements of hand_reach: inverse kinematics for many random targets, from starts near them
// and from random starts; and a page that shows the hand.

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "clothctl/robot/kinematic_tree.hpp"

namespace program {

/// The user's options.
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
  double error = 0, worst = 0;  // over those that were reached, and over all (m)
  std::vector<double> iterations, microseconds;
};

/// Results for targets at random poses from random starts and from nearby starts, and for targets
/// out of reach.
struct ReachRuns {
  Tally random, near_starts, unreachable;
};

/// Returns the links that --tips names, or the ends of all chains. A wrong name ends the program.
template <class Scalar>
std::vector<int> find_tips(const clothctl::KinematicTree<Scalar>& tree, const ReachRequest& o);

/// Draws targets and starts, and solves for all of them. Prints progress.
template <class Scalar>
ReachRuns run_targets(const clothctl::KinematicTree<Scalar>& tree, const std::vector<int>& tips,
                      const ReachRequest& o);

/// Adds the figures of several solves; `suffix` is appended to the keys.
void add_tally(nlohmann::ordered_json& j, const Tally& t, const std::string& suffix);
/// Adds further figures.
void add_more(nlohmann::ordered_json& j, const Tally& t, const std::string& suffix);

/// Writes `player.html` to the requested folder: the hand moves from target to target.
void write_reach_page(const clothctl::KinematicTree<double>& tree, const std::string& name,
                      const std::vector<int>& tips, const ReachRequest& o,
                      const nlohmann::ordered_json& figures);

}  // namespace program
