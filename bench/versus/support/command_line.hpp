#pragma once

// The command line of the comparisons. Apart from that of the examples, whose parser knows the
// options of the planner.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

namespace versus {

using Names = std::vector<std::string>;

inline bool holds(const Names& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Prints one line and exits with 2.
[[noreturn]] inline void refuse(const char* program, const std::string& message) {
  std::fprintf(stderr, "%s: %s\n", program, message.c_str());
  std::exit(2);
}

/// Parses the command line. --help exits with 0; `refuse(message)` is called for a bad one.
template <class Refuse>
void parse(CLI::App& app, int argc, char** argv, Refuse refuse) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::CallForHelp& e) {
    std::exit(app.exit(e));
  } catch (const CLI::ParseError& e) {
    refuse(std::string(e.what()) + " (see --help)");
  }
}

}  // namespace versus
