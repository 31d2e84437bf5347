#pragma once

// Shared by the programs for hands: the ends of a robot's fingers, a motion from pose to pose
// and printing.

#include <cmath>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "clothctl/robot/kinematic_tree.hpp"

namespace program {

/// Prints figures as one JSON object on a line, or as a table without the null entries.
void print_figures(const nlohmann::ordered_json& figures, bool json);

/// Returns a number, or null if it is unknown or not finite.
nlohmann::ordered_json known(double value, bool is_known = true);

/// Returns the larger number, or NaN where one of them is.
inline double larger(double a, double b) { return std::isnan(a) || b <= a ? a : b; }

/// Returns a length as text, in millimetres.
std::string millimetres(double metres);

/// Position, 0 to 1, of a motion from rest to rest at time s, 0 to 1, with continuous acceleration:
/// 10 s³ - 15 s⁴ + 6 s⁵.
double smooth_share(double s);
/// Its derivative.
double smooth_speed(double s);

/// Returns the link at the end of each chain of joints: of each body without children, the link
/// furthest from the body's origin.
template <class Scalar>
std::vector<int> chain_ends(const clothctl::KinematicTree<Scalar>& tree) {
  std::vector<int> ends;
  for (int b = 0; b < static_cast<int>(tree.bodies().size()); ++b) {
    if (tree.bodies()[static_cast<std::size_t>(b)].subtree_end != b + 1) continue;
    int end = -1;
    for (int k = 0; k < static_cast<int>(tree.links().size()); ++k) {
      if (tree.links()[static_cast<std::size_t>(k)].body != b) continue;
      const auto reach = [&](int link) {
        return tree.links()[static_cast<std::size_t>(link)].placement.p.norm();
      };
      if (end < 0 || reach(k) >= reach(end)) end = k;
    }
    if (end >= 0) ends.push_back(end);
  }
  return ends;
}

}  // namespace program
