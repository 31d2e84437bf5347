#include "clothctl/cloth/detail/level_input.hpp"

#include <algorithm>
#include <array>
#include <vector>

#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

SpringNetwork<double> small_sheet() {
  return sheet_network(make_grid<double>(5, 6, 0.4, 0.5).value(),
                       material_preset<double>("cotton").value())
      .value();
}

}  // namespace

TEST_CASE("level input: pinned vertices come first, then corners, boundary, inside",
          "[level_input]") {
  const SpringNetwork<double> network = small_sheet();
  const std::vector<int> ranks = level_ranks(30, network.triangles, {13});
  std::vector<int> triangles(30, 0);
  for (const std::array<int, 3>& t : network.triangles) {
    for (int v : t) ++triangles[static_cast<std::size_t>(v)];
  }
  for (int row = 0; row < 5; ++row) {
    for (int col = 0; col < 6; ++col) {
      const int v = row * 6 + col;
      const bool boundary = row % 4 == 0 || col % 5 == 0;
      const bool corner = triangles[static_cast<std::size_t>(v)] <= 2;
      CHECK(ranks[static_cast<std::size_t>(v)] == (v == 13 ? 0 : !boundary ? 3 : corner ? 1 : 2));
    }
  }
  for (const std::size_t set : {std::size_t{0}, std::size_t{1}}) {
    std::vector<int> order = level_order(ranks, set);
    CHECK(order.front() == 13);
    CHECK(std::is_sorted(order.begin(), order.end(), [&](int a, int b) {
      return ranks[static_cast<std::size_t>(a)] < ranks[static_cast<std::size_t>(b)];
    }));
    std::sort(order.begin(), order.end());
    for (int v = 0; v < 30; ++v) CHECK(order[static_cast<std::size_t>(v)] == v);
  }
  CHECK(level_order(ranks, 0) != level_order(ranks, 1));
}

TEST_CASE("level input: no surface, no boundary: the number of triangles decides",
          "[level_input]") {
  // Three triangles at one edge.
  CHECK(level_ranks(6, {{0, 1, 2}, {0, 1, 3}, {0, 1, 4}}, {}) ==
        std::vector<int>{3, 3, 1, 1, 1, 0});
}

TEST_CASE("level input: springs without stiffness and bend springs join nothing", "[level_input]") {
  SpringNetwork<double> network = small_sheet();
  const std::size_t all = level_input(network, {}).edges.size();
  CHECK(all == network.springs.size());
  network.springs[3].stiffness = 0.0;
  network.springs[4].kind = SpringKind::Bend;
  const LevelInput input = level_input(network, {0, 5});
  CHECK(input.edges.size() == all - 2);
  CHECK(input.tethered == std::vector<int>{0, 5});
  CHECK(input.mass.size() == 30);
  CHECK(level_input(network, {0, 1, 2, 3, 4}).tethered.empty());
}
