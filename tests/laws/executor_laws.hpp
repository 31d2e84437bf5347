#pragma once

// The laws that every Executor must obey. Call check_executor_laws(executor) inside a TEST_CASE.
//
//   once       each block from 0 to count - 1 runs once, others never; for count 0 none
//   visible    when the call returns, what all blocks wrote is there
//   again      the same executor runs loop after loop
//   reference  an ExecutorRef to it does the same

#include <atomic>
#include <vector>

#include "clothctl/concepts/executor.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

template <class E>
void check_executor_laws(E& executor) {
  static_assert(clothctl::Executor<E>);
  const clothctl::ExecutorRef reference(executor);
  for (const int count : {0, 1, 2, 3, 16, 100, 5000}) {
    for (const bool by_reference : {false, true}) {
      std::vector<int> runs(static_cast<std::size_t>(count), 0);
      std::atomic<int> off_range{0};
      const auto body = [&](int block) {
        if (block < 0 || block >= count) {
          ++off_range;
        } else {
          runs[static_cast<std::size_t>(block)] += block + 1;
        }
      };
      if (by_reference) {
        reference.for_each_block(count, body);
      } else {
        clothctl::executor_traits<E>::for_each_block(executor, count, clothctl::BlockTask(body));
      }
      int wrong = off_range.load();
      for (int i = 0; i < count; ++i) {
        if (runs[static_cast<std::size_t>(i)] != i + 1) ++wrong;
      }
      CAPTURE(count, by_reference);
      CHECK(wrong == 0);
    }
  }
}

}  // namespace clothctl_test
