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

TEST_CASE("no blocks, no calls", "[executor]") {
  int calls = 0;
  SerialExecutor{}.for_each_block(0, [&calls](Index) { ++calls; });
  CHECK(calls == 0);
}

TEST_CASE("a function object is used in place, not copied", "[executor]") {
  struct Counter {
    Counter() = default;
    Counter(const Counter&) = delete;
    void operator()(Index block) { total += block; }
    Index total = 0;
  } counter;
  SerialExecutor{}.for_each_block(4, counter);
  CHECK(counter.total == 6);
}
