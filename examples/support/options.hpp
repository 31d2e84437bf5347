#pragma once

// The options that the programs share. Bad input prints one line on stderr and exits with 2.

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/result.hpp"

namespace program {

/// Ends the program because of bad input.
[[noreturn]] void refuse(const std::string& reason);

/// Makes the folder of an option --out if there is none; does nothing for an empty name. Ends the
/// program where that fails.
void make_folder(const std::string& out);

/// Returns the value of a result, or ends the program with its error.
template <class T>
T must(clothctl::Result<T> result) {
  if (!result) refuse(result.error());
  return std::move(result).value();
}

/// The user's options. Options that a program does not offer keep their defaults.
struct Options {
  std::string task = "async";
  std::string targets;
  double dt = 0.02;
  int cloth = 17;
  int model = 17;
  double size = 0.5;
  std::string material = "handkerchief";
  int horizon = 20;
  std::string plant = "newton";
  std::string grip = "force";
  std::string patch = "soft";
  int patch_size = 1;
  std::string predictor = "auto";
  std::string profile = "standard";
  double friction = -1;
  double limit = 20;
  int generators = 4;
  double max_step_mm = 50;
  double max_acceleration = 0;
  std::vector<long> input_intervals;
  int input_degree = 0;
  double spread = 0.9;
  double gusts = 0;
  double unknown = 0;
  std::uint64_t seed = 1;
  double noise = 0, delay = 0;  // of measurements: standard deviation, m; age, s
  int markers = 0;              // along a side of the sheet; 0: all vertices are seen
  int latency = 0;              // frames from a command to its effect
  std::uint64_t noise_seed = 1;
  bool measured = false;  // one of these is given: plans are made for an estimate
  bool hands = false;
  bool second_thread = true;  // rollouts use one; plans have the same bits without it
  bool json = false;
  std::string out;
  bool dt_given = false;
  bool friction_given = false;

  /// Whether air moves past the sheet.
  bool windy() const { return 0 < gusts || (targets.empty() && task == "wind"); }
};

}  // namespace program
