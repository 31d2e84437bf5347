#pragma once

// What any Executor must obey. Call check_executor_laws(executor) inside a TEST_CASE.
//
//   blocks    every block from 0 to count-1 is run exactly once, and no other
//   done      all of them are done when for_each_block returns
//   in place  the function is used where it stands, not copied

#include <atomic>
#include <vector>

#include "clothctl/concepts/executor.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// Checks the laws for several numbers of blocks, again and again with the same executor.
template <class E>
void check_executor_laws(E& executor) {
  using namespace clothctl;
  static_assert(Executor<E>);
  struct Counter {
    explicit Counter(Index count) : runs(static_cast<std::size_t>(count)) {}
    Counter(const Counter&) = delete;
    void operator()(Index block) {
      if (block < 0 || block >= static_cast<Index>(runs.size()))
        ++strays;
      else
        ++runs[static_cast<std::size_t>(block)];
    }
    std::vector<std::atomic<int>> runs;
    std::atomic<int> strays{0};
  };
  for (int again = 0; again < 3; ++again) {
    for (const Index count : {0, 1, 2, 7, 64, 1000}) {
      CAPTURE(again, count);
      Counter counter(count);
      executor_traits<E>::for_each_block(executor, count, counter);
      int once = 0;
      for (const std::atomic<int>& runs : counter.runs) once += runs == 1 ? 1 : 0;
      CHECK(once == count);
      CHECK(counter.strays == 0);
    }
  }
}

}  // namespace clothctl_test
