#include "clothctl/cloth/detail/sweep_order.hpp"

#include <cstddef>
#include <vector>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

std::vector<std::size_t> visited(const SweepPlaces& places) {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < places.count(); ++i) out.push_back(places[i]);
  return out;
}

}  // namespace

TEST_CASE("sweep order: the last sweep runs forward, the one before it back", "[sweep_order]") {
  CHECK(alternating(0, 1) == SweepOrder::Forward);
  CHECK(alternating(0, 2) == SweepOrder::Backward);
  CHECK(alternating(1, 2) == SweepOrder::Forward);
  for (int count = 1; count < 6; ++count) {
    CHECK(alternating(count - 1, count) == SweepOrder::Forward);
    for (int i = 1; i < count; ++i) CHECK(alternating(i, count) != alternating(i - 1, count));
  }
}

TEST_CASE("sweep order: places in either direction", "[sweep_order]") {
  CHECK(visited({SweepOrder::Forward, 3, 6}) == std::vector<std::size_t>{3, 4, 5});
  CHECK(visited({SweepOrder::Backward, 3, 6}) == std::vector<std::size_t>{5, 4, 3});
  CHECK(visited({SweepOrder::Forward, 8, 32, 8}) == std::vector<std::size_t>{8, 16, 24});
  CHECK(visited({SweepOrder::Backward, 0, 24, 8}) == std::vector<std::size_t>{16, 8, 0});
  for (const SweepOrder order : {SweepOrder::Forward, SweepOrder::Backward}) {
    CHECK(SweepPlaces(order, 0, 0).count() == 0);
    CHECK(SweepPlaces(order, 16, 16, 8).count() == 0);
    CHECK(visited({order, 0, 1}) == std::vector<std::size_t>{0});
  }
}
