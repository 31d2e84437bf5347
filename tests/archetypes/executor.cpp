#include "archetypes/executor.hpp"

#include <vector>

#include "laws/executor_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ExecutorArchetype;

static_assert(Executor<ExecutorArchetype>);
static_assert(!std::is_copy_constructible_v<ExecutorArchetype> && !std::is_default_constructible_v<ExecutorArchetype>);

TEST_CASE("the archetype runs every block once, backwards", "[archetypes]") {
  ExecutorArchetype executor(1);
  std::vector<Index> seen;
  executor_traits<ExecutorArchetype>::for_each_block(executor, 4, [&seen](Index block) { seen.push_back(block); });
  CHECK(seen == std::vector<Index>{3, 2, 1, 0});
}

TEST_CASE("the archetype obeys the laws of executors", "[archetypes]") {
  ExecutorArchetype executor(1);
  clothctl_test::check_executor_laws(executor);
}
