#pragma once

// The least type that satisfies Executor.

#include "clothctl/concepts/executor.hpp"

namespace clothctl_test {

/// A type with only what Executor names. It runs every other block first.
class ExecutorArchetype {
 public:
  explicit ExecutorArchetype(int) {}
  ExecutorArchetype(const ExecutorArchetype&) = delete;
  ExecutorArchetype& operator=(const ExecutorArchetype&) = delete;

  void for_each_block(int count, const clothctl::BlockTask& task) {
    for (int i = 1; i < count; i += 2) task(i);
    for (int i = 0; i < count; i += 2) task(i);
  }
};

}  // namespace clothctl_test
