#include "clothctl/concepts/executor.hpp"

#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "clothctl/core/executor.hpp"
#include "support/catch.hpp"

namespace other_engine {

// A job system with words of its own, which has never heard of clothctl.
class JobSystem {
 public:
  void parallel_jobs(unsigned first, unsigned last, const std::function<void(unsigned)>& job) {
    ++submissions;
    for (unsigned i = first; i < last; ++i) job(i);
  }
  int submissions = 0;
};

}  // namespace other_engine

template <>
struct clothctl::executor_traits<other_engine::JobSystem> {
  template <class Function>
  static void for_each_block(other_engine::JobSystem& jobs, Index count, Function&& function) {
    jobs.parallel_jobs(0, static_cast<unsigned>(count), [&function](unsigned i) { function(static_cast<Index>(i)); });
  }
};

using namespace clothctl;

namespace {

// Real threads: blocks run at once and in any order.
struct ThreadPerBlock {
  template <class Function>
  void for_each_block(Index count, Function&& function) {
    std::vector<std::thread> threads;
    for (Index block = 0; block < count; ++block) threads.emplace_back([&function, block] { function(block); });
    for (std::thread& thread : threads) thread.join();
  }
};

// The axiom: every block exactly once, all done on return.
template <Executor E>
std::vector<int> visits(E& executor, Index count) {
  std::vector<int> seen(static_cast<std::size_t>(count), 0);
  executor_traits<E>::for_each_block(executor, count, [&seen](Index block) { ++seen[static_cast<std::size_t>(block)]; });
  return seen;
}

struct WrongName {
  template <class Function>
  void for_each(Index, Function&&) {}
};
struct WrongFunction {
  void for_each_block(Index, void (*)(double, double)) {}
};

}  // namespace

static_assert(Executor<SerialExecutor> && Executor<const SerialExecutor>);
static_assert(Executor<other_engine::JobSystem> && Executor<ThreadPerBlock>);
static_assert(!Executor<int> && !Executor<void*> && !Executor<std::string> && !Executor<WrongName> && !Executor<WrongFunction>);

TEST_CASE("every executor runs each block exactly once", "[executor]") {
  const std::vector<int> once(9, 1);
  SerialExecutor serial;
  other_engine::JobSystem foreign;
  ThreadPerBlock threads;
  CHECK(visits(serial, 9) == once);
  CHECK(visits(foreign, 9) == once);
  CHECK(visits(threads, 9) == once);
  CHECK(foreign.submissions == 1);
  CHECK(visits(serial, 0).empty());
}
