#include "clothctl/concepts/executor.hpp"

#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "clothctl/core/executor.hpp"
#include "laws/executor_laws.hpp"
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

TEST_CASE("the serial executor, a foreign job system and threads obey the laws of executors", "[executor]") {
  SerialExecutor serial;
  clothctl_test::check_executor_laws(serial);
  ThreadPerBlock threads;
  clothctl_test::check_executor_laws(threads);
  other_engine::JobSystem foreign;
  clothctl_test::check_executor_laws(foreign);
  foreign.submissions = 0;
  executor_traits<other_engine::JobSystem>::for_each_block(foreign, 9, [](Index) {});
  CHECK(foreign.submissions == 1);
}
