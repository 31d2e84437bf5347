#pragma once

// An executor of plain threads, started anew for each loop: slow, but it runs blocks at the same
// time and in an order that changes from run to run.

#include <atomic>
#include <thread>
#include <vector>

#include "clothctl/concepts/executor.hpp"

namespace clothctl_test {

/// Runs blocks on `threads` threads.
struct ThreadExecutor {
  int threads = 2;
  /// Loops that it was given.
  int loops = 0;

  void for_each_block(int count, const clothctl::BlockTask& task) {
    ++loops;
    std::atomic<int> next{0};
    const auto work = [&] {
      for (int i = next++; i < count; i = next++) task(i);
    };
    std::vector<std::thread> team;
    for (int t = 1; t < threads; ++t) team.emplace_back(work);
    work();
    for (std::thread& thread : team) thread.join();
  }
};

/// Runs blocks on the calling thread, last one first.
struct BackwardExecutor {
  void for_each_block(int count, const clothctl::BlockTask& task) {
    while (count-- > 0) task(count);
  }
};

}  // namespace clothctl_test
