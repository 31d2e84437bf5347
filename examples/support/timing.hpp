#pragma once

// Time measurement, summaries and progress of the programs' runs.

#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace program {

/// Milliseconds since `from`.
double milliseconds(std::chrono::steady_clock::time_point from);

/// Returns the processor time of this thread (s), which hardly depends on other work of the
/// machine.
double thread_seconds();

/// Returns the q-quantile of the values, or 0 without values.
double quantile(std::vector<double> values, double q);

/// A progress line on a terminal, for work that takes over two seconds.
class Progress {
 public:
  ~Progress() { clear(); }
  /// Shows the progress.
  void show(long done, long all);
  /// Clears the line before other output.
  void clear();
  /// Sets what the line shows before the number of the frame.
  void set_prefix(std::string prefix) { prefix_ = std::move(prefix); }

 private:
  std::string prefix_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now(), last_ = start_;
  bool shown_ = false;
};

}  // namespace program
