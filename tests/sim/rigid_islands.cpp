// Islands: against the components of random graphs.

#include "clothctl/sim/detail/rigid_islands.hpp"

#include <algorithm>
#include <random>
#include <utility>
#include <vector>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("islands are the components, numbered by their first bodies") {
  std::mt19937 random(1);
  detail::RigidIslands islands;
  islands.reserve(30, 60, 10);
  for (int trial = 0; trial < 100; ++trial) {
    const int n = 1 + static_cast<int>(random() % 30);
    std::vector<std::pair<int, int>> links;
    for (int k = 0; k < n / 2; ++k)
      links.push_back({static_cast<int>(random() % static_cast<unsigned>(n)),
                       static_cast<int>(random() % static_cast<unsigned>(n))});
    const auto moves = [](int i) { return i % 5 != 4; };
    islands.clear(n);
    std::vector<int> label(static_cast<std::size_t>(n));
    for (int i = 0; i < n; ++i) label[static_cast<std::size_t>(i)] = i;
    for (const auto& [a, b] : links) {
      if (!moves(a) || !moves(b)) continue;
      islands.join(a, b);
      const int from = label[static_cast<std::size_t>(a)], to = label[static_cast<std::size_t>(b)];
      for (int& l : label) {
        if (l == from || l == to) l = std::min(from, to);
      }
    }
    const auto mover = [&](int k) {
      const auto [a, b] = links[static_cast<std::size_t>(k)];
      return moves(a) ? a : (moves(b) ? b : -1);
    };
    islands.build(moves, static_cast<int>(links.size()), mover, 0, [](int) { return -1; });
    int bodies = 0, last = -1;
    for (int k = 0; k < islands.count(); ++k) {
      REQUIRE(!islands.bodies(k).empty());
      const int first = islands.bodies(k).front();
      CHECK(first > last);
      last = first;
      CHECK(std::is_sorted(islands.bodies(k).begin(), islands.bodies(k).end()));
      for (const int i : islands.bodies(k)) {
        ++bodies;
        CHECK(label[static_cast<std::size_t>(i)] == first);
      }
      for (const int c : islands.contacts(k))
        CHECK(label[static_cast<std::size_t>(mover(c))] == first);
      CHECK(islands.joints(k).empty());
    }
    int moving = 0;
    for (int i = 0; i < n; ++i) moving += moves(i);
    CHECK(bodies == moving);
  }
}
