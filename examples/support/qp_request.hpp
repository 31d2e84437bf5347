#pragma once

// The command line of qp_solve, the file that it reads, and its clocks.

#include <string>

#include "clothctl/io/qp_problem.hpp"
#include "clothctl/qp/problem.hpp"

namespace program {

/// What the user asked for.
struct Request {
  std::string file, solution, out;
  double time_limit = 0, tolerance = 0;
  int max_iterations = 0, passes = 3;
  bool json = false, closest_point = false;
};

/// Parses the command line. --help exits 0; a bad command line, or two options that name the same
/// file, exits 2 with one line.
Request parse_request(int argc, char** argv);

/// Reads a QPT or QPS file, or ends the program with what is wrong with it.
clothctl::QpProblem read_problem(const std::string& path);

/// Settings of a solver for the request.
clothctl::QpSettings<double> settings_of(const Request& request);

/// Processor time of this thread, s. Other work on the machine disturbs it little.
double seconds_now();

}  // namespace program
