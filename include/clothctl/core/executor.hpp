#pragma once

// Running independent blocks of work. The library starts no threads; it hands blocks to the caller's executor.

#include "clothctl/core/types.hpp"

namespace clothctl {

/// Runs blocks one after the other on the calling thread: the default everywhere.
struct SerialExecutor {
  /// Calls `function(block)` for block = 0 … count-1, in order.
  template <class Function>
  void for_each_block(Index count, Function&& function) const {
    for (Index block = 0; block < count; ++block) function(block);
  }
};

}  // namespace clothctl
