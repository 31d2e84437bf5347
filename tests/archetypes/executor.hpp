#pragma once

// The least type that satisfies Executor: it cannot be copied, and it runs the blocks in an order that no one expects.

#include "clothctl/concepts/executor.hpp"

namespace clothctl_test {

/// Runs blocks from the last to the first; an algorithm that minds the order is wrong.
class ExecutorArchetype {
 public:
  explicit ExecutorArchetype(int) {}
  ExecutorArchetype(const ExecutorArchetype&) = delete;
  ExecutorArchetype& operator=(const ExecutorArchetype&) = delete;

  template <class Function>
  void for_each_block(clothctl::Index count, Function&& function) {
    for (clothctl::Index block = count; block-- > 0;) function(block);
  }
};

}  // namespace clothctl_test
