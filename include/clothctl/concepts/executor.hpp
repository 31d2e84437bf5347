#pragma once

// Executor: how independent blocks of work are spread over threads that the caller owns.

#include <concepts>
#include <utility>

#include "clothctl/core/types.hpp"

namespace clothctl {

/// How a type executes blocks. The primary forwards to a member `for_each_block`; specialise it for a foreign job system.
template <class T>
struct executor_traits {
  /// Calls `function(block)` once for every block 0 … count-1, in any order or at once; returns when all are done.
  template <class Function>
  requires requires(T& t, Index n, Function&& f) { t.for_each_block(n, std::forward<Function>(f)); }
  static void for_each_block(T& executor, Index count, Function&& function) {
    executor.for_each_block(count, std::forward<Function>(function));
  }
};

namespace detail {
struct BlockProbe {
  void operator()(Index) const {}
};
}  // namespace detail

/// Runs blocks of independent work. Axiom: every block runs exactly once, and all have ended when the call returns.
template <class T>
concept Executor = requires(T& executor, Index count, detail::BlockProbe probe) {
  executor_traits<T>::for_each_block(executor, count, probe);
};

}  // namespace clothctl
