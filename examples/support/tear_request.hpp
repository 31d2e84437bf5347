#pragma once

// The command line of the program that tears a sheet.

#include <string>
#include <vector>

#include "clothctl/core/types.hpp"

namespace program {

/// The user's options of the program that tears a sheet.
struct TearRequest {
  int cloth = 33;
  double size = 0.5, limit = 0.25, pull = 0.6, seconds = 3;
  std::string material = "handkerchief", model = "mass-spring", out;
  std::vector<double> cut{0.5, -0.1, 0.5, 0.35};
  bool whole = false, json = false;
};

/// Reads the command line. --help exits with 0; a bad command line prints one line and exits
/// with 2.
TearRequest read_tear_request(int argc, char** argv);

/// Returns the cut on the rest positions of the sheet, 3×points, m.
clothctl::Points<double> cut_line(const TearRequest& o);

}  // namespace program
