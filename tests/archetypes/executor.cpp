#include "archetypes/executor.hpp"

#include <thread>
#include <vector>

#include "laws/executor_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ExecutorArchetype;

namespace other_engine {

// Two threads of a job system, which take every second block each.
struct Jobs {
  template <class Job>
  void run(int count, Job& job) {
    std::thread other([&] {
      for (int i = 1; i < count; i += 2) job(i);
    });
    for (int i = 0; i < count; i += 2) job(i);
    other.join();
  }
};

}  // namespace other_engine

template <>
struct clothctl::executor_traits<other_engine::Jobs> {
  template <class Function>
  static void for_each_block(other_engine::Jobs& jobs, Index count, Function&& function) {
    jobs.run(static_cast<int>(count), function);
  }
};

static_assert(Executor<ExecutorArchetype>);
static_assert(!std::is_copy_constructible_v<ExecutorArchetype> && !std::is_default_constructible_v<ExecutorArchetype>);

TEST_CASE("the archetype runs every block once, backwards", "[archetypes]") {
  ExecutorArchetype executor(1);
  std::vector<Index> seen;
  executor_traits<ExecutorArchetype>::for_each_block(executor, 4, [&seen](Index block) { seen.push_back(block); });
  CHECK(seen == std::vector<Index>{3, 2, 1, 0});
}

TEST_CASE("archetype and a foreign job system obey the laws of executors", "[archetypes]") {
  ExecutorArchetype executor(1);
  clothctl_test::check_executor_laws(executor);
  other_engine::Jobs jobs;
  clothctl_test::check_executor_laws(jobs);
}
