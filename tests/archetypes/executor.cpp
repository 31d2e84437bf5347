// The archetype satisfies its concept, has nothing else, obeys the laws, and runs a step.

#include "archetypes/executor.hpp"

#include <type_traits>

#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "laws/executor_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ExecutorArchetype;

static_assert(Executor<ExecutorArchetype> && !Executor<const ExecutorArchetype>);
static_assert(!Executor<int> && !Executor<BlockTask>);
static_assert(!std::is_copy_constructible_v<ExecutorArchetype> &&
              !std::is_default_constructible_v<ExecutorArchetype>);

TEST_CASE("the archetype of an executor obeys the laws", "[archetypes]") {
  ExecutorArchetype executor(1);
  clothctl_test::check_executor_laws(executor);
}

TEST_CASE("a step needs no more from its executor than the concept names", "[archetypes]") {
  const auto mesh = make_grid<double>(5, 130, 1.0, 0.04).value();
  const auto model =
      PositionBased<double>::create(sheet_network<double>(mesh, Material<double>()).value())
          .value();
  auto workspace = model.make_workspace();
  auto state = model.rest_state();
  ExecutorArchetype executor(1);
  CHECK(model.step(state, {}, 0.02, workspace, executor).advanced);
}
