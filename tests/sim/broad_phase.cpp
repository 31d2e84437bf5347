// The broad phase against all pairs.

#include "clothctl/sim/detail/broad_phase.hpp"

#include <Eigen/Dense>
#include <random>
#include <vector>

#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;

TEST_CASE("the pairs are those that overlap and are wanted, in ascending order") {
  std::mt19937 random(1);
  const auto draw = [&] { return static_cast<double>(random()) / 4294967296.0; };
  detail::BroadPhase<double> broad;
  broad.reserve(60, 100);
  for (int trial = 0; trial < 50; ++trial) {
    const std::size_t n = trial < 25 ? 40 : 60;
    std::vector<BoundingBox<double>> boxes(n);
    for (BoundingBox<double>& box : boxes) {
      box.lower = V(draw(), draw(), draw());
      box.upper = box.lower + 0.3 * V(draw(), draw(), draw());
    }
    boxes[3] = {};  // without bound
    const auto wanted = [](int i, int j) { return (i + j) % 3 != 0; };
    std::vector<detail::BoxPair> expected;
    for (int i = 0; i < static_cast<int>(n); ++i) {
      for (int j = i + 1; j < static_cast<int>(n); ++j) {
        if (wanted(i, j) &&
            boxes[static_cast<std::size_t>(i)].overlaps(boxes[static_cast<std::size_t>(j)]))
          expected.push_back({i, j});
      }
    }
    CHECK(broad.find(boxes, wanted) == expected);
    CHECK(broad.pairs() == expected);
  }
}
