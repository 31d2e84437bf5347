#include "clothctl/core/executor.hpp"

#include <vector>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("the serial executor runs every block once, in order", "[executor]") {
  std::vector<Index> seen;
  const SerialExecutor executor;
  executor.for_each_block(5, [&seen](Index block) { seen.push_back(block); });
  CHECK(seen == std::vector<Index>{0, 1, 2, 3, 4});
}
