#pragma once

// Executor: runs the independent blocks of a loop, on one thread or several. A step divides its
// work by the sheet alone, so its result has the same bits with every executor.

#include <concepts>
#include <memory>
#include <type_traits>
#include <utility>

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A loop body that an executor calls: `task(i)` runs block i. Two words, cheap to copy; it refers
/// to data of the caller of `for_each_block`, so it must not outlive that call. Calls with
/// different i may run at the same time. It never throws or allocates.
class BlockTask {
 public:
  /// Refers to a function `body(int block)`, which must outlive this.
  template <class Body>
  requires(!std::same_as<std::remove_cv_t<Body>, BlockTask>) explicit BlockTask(Body& body)
      : body_(std::addressof(body)),
        call_([](const void* f, int block) { (*static_cast<const Body*>(f))(block); }) {}

  /// Runs block i.
  void operator()(int block) const { call_(body_, block); }

 private:
  const void* body_;
  void (*call_)(const void*, int);
};

/// How a type acts as an executor. The primary template forwards to a member of the same name.
template <class E>
struct executor_traits {
  /// Calls `task(i)` once for each i from 0 to `count` - 1 and returns when all calls have
  /// returned.
  static void for_each_block(E& executor, int count, const BlockTask& task) requires requires {
    executor.for_each_block(count, task);
  }
  { executor.for_each_block(count, task); }
};

/// What runs the blocks of a loop: a thread pool, or the job system of an engine.
///
/// Axioms: `for_each_block(e, n, task)` calls task(0) … task(n - 1) once each, in any order and on
/// any threads; all effects of the calls are visible to the caller when it returns; n may be 0.
/// Optional hooks: none.
template <class E>
concept Executor = requires(E& executor, int count, const BlockTask& task) {
  executor_traits<E>::for_each_block(executor, count, task);
};

/// A reference to any executor, or to none: blocks then run on the calling thread, in order.
class ExecutorRef {
 public:
  /// No executor.
  ExecutorRef() = default;

  /// Refers to an executor, which must outlive this.
  template <Executor E>
  requires(!std::same_as<std::remove_cv_t<E>, ExecutorRef>) explicit ExecutorRef(E& executor)
      : executor_(std::addressof(executor)), run_([](void* e, int count, const BlockTask& task) {
          executor_traits<E>::for_each_block(*static_cast<E*>(e), count, task);
        }) {}

  /// Runs `body(i)` for each i from 0 to `count` - 1. Never allocates by itself.
  template <class Body>
  void for_each_block(int count, const Body& body) const {
    if (run_ == nullptr || count < 2) {
      for (int i = 0; i < count; ++i) body(i);
    } else {
      run_(executor_, count, BlockTask(body));
    }
  }

 private:
  void* executor_ = nullptr;
  void (*run_)(void*, int, const BlockTask&) = nullptr;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
