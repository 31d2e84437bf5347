#pragma once

// The command line of qp_solve, the file that it reads, and its clocks.

#include <string>

#include "clothctl/io/qp_problem.hpp"
#include "clothctl/qp/problem.hpp"

namespace program {

/// The user's options.
struct Request {
  std::string file, solution, out;
  double time_limit = 0, tolerance = 0;
  int max_iterations = 0, passes = 3;
  bool json = false, closest_point = false;
};

/// Parses the command line. --help exits with 0. A bad command line, or two options that name the
/// same file, prints one line and exits with 2.
Request parse_request(int argc, char** argv);

/// Reads a QPT or QPS file, or ends the program with an error message.
clothctl::QpProblem read_problem(const std::string& path);

/// Returns the settings of a solver for the request.
clothctl::QpSettings<double> settings_of(const Request& request);

}  // namespace program
