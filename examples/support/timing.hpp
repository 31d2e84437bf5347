#pragma once

// What the programs' runs are timed, summed up and watched with.

#include <chrono>
#include <vector>

namespace program {

/// Milliseconds since `from`.
double milliseconds(std::chrono::steady_clock::time_point from);

/// The value below which a share `q` of the values lies; 0 without values.
double quantile(std::vector<double> values, double q);

/// A progress line on a terminal, for work over two seconds.
class Progress {
 public:
  ~Progress() { clear(); }
  /// Shows how far the work is.
  void show(long done, long all);
  /// Wipes the line, before anything else is printed.
  void clear();

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now(), last_ = start_;
  bool shown_ = false;
};

}  // namespace program
