#include "clothctl/linalg/detail/front_layout.hpp"

#include "support/block_matrices.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using namespace clothctl_test;

namespace {

/// A rope of seven vertices with couplings to the next but one: two pairs at the ends, two pairs
/// between, the middle on top.
struct Rope {
  BlockSymmetric<double> pattern;
  EliminationTree tree{{0, 1, 6, 5, 2, 3, 4}, {0, 2, 4, 7}, {2, 2, -1}};

  Rope() {
    const Graph graph = rope_graph(7);
    pattern = BlockSymmetric<double>(7, graph.pairs);
  }
};

}  // namespace

TEST_CASE("Fronts contain their pivots and the vertices above that these couple to") {
  const Rope rope;
  const FrontLayout layout(rope.pattern, rope.tree, 8);
  REQUIRE(layout.fronts.size() == 3);
  const Front& left = layout.fronts[0];
  const Front& right = layout.fronts[1];
  const Front& top = layout.fronts[2];
  CHECK(left.pivots == 6);
  CHECK(left.border == 6);  // vertices 2 and 3
  CHECK(right.pivots == 6);
  CHECK(right.border == 6);  // vertices 3 and 4
  CHECK(top.pivots == 9);
  CHECK(top.border == 0);
  const auto rows = [&](const Front& front) {
    const auto begin = layout.vertices.begin() + front.vertex_begin;
    return std::vector<int>(begin, begin + (front.pivots + front.border) / 3);
  };
  CHECK(rows(left) == std::vector<int>{0, 1, 2, 3});
  CHECK(rows(right) == std::vector<int>{6, 5, 3, 4});
  CHECK(rows(top) == std::vector<int>{2, 3, 4});
  for (const Front& front : layout.fronts) {
    CHECK(front.ld % 8 == 0);
    CHECK(front.ldu % 8 == 0);
    CHECK(front.ld >= front.pivots + front.border);
    CHECK(front.ldu >= front.border);
    CHECK(front.ld * front.pivots <= layout.largest_front);
    CHECK(front.pivots <= layout.most_pivots);
    CHECK(front.factor + packed_size(front.pivots, front.border) <= layout.factor_size);
  }
}

TEST_CASE("Each block of the matrix has one place, below or on the diagonal") {
  const Rope rope;
  const FrontLayout layout(rope.pattern, rope.tree, 4);
  int diagonal = 0;
  std::vector<int> seen(static_cast<std::size_t>(rope.pattern.lower_count()), 0);
  for (const Front& front : layout.fronts) {
    for (int e = front.entry_begin; e < front.entry_end; ++e) {
      const FrontEntry& entry = layout.entries[static_cast<std::size_t>(e)];
      const Index row = entry.target % front.ld, column = entry.target / front.ld;
      CHECK(row >= column);
      CHECK(column < front.pivots);
      const int* vertices = layout.vertices.data() + front.vertex_begin;
      const int below = vertices[row / 3], right = vertices[column / 3];
      CHECK(below == (entry.transposed ? entry.column : entry.row));
      CHECK(right == (entry.transposed ? entry.row : entry.column));
      if (entry.slot < 0) {
        ++diagonal;
        CHECK(row == column);
      } else {
        ++seen[static_cast<std::size_t>(entry.slot)];
        CHECK(rope.pattern.find(below, right) == entry.slot);
      }
    }
  }
  CHECK(diagonal == 7);
  CHECK(seen == std::vector<int>(seen.size(), 1));
}

TEST_CASE("The rows of children are found in the parent as long runs") {
  const Rope rope;
  const FrontLayout layout(rope.pattern, rope.tree, 1);
  const Front& top = layout.fronts[2];
  REQUIRE(top.child_end - top.child_begin == 2);
  const Index targets[] = {0, 3};  // vertices 2 3 and 3 4 among 2 3 4
  for (int c = 0; c < 2; ++c) {
    const FrontChild& child = layout.children[static_cast<std::size_t>(top.child_begin + c)];
    CHECK(child.front == c);
    REQUIRE(child.run_end - child.run_begin == 1);
    const FrontRun& run = layout.runs[static_cast<std::size_t>(child.run_begin)];
    CHECK(run.source == 0);
    CHECK(run.target == targets[c]);
    CHECK(run.length == 6);
  }
}

TEST_CASE("A run ends where the parent's border begins") {
  // 0 couples to 1 and 2, and 1 is a child of 2. In the front of 1, row 1 is a pivot and row 2 is
  // border.
  const BlockSymmetric<double> pattern(3, {{0, 1}, {0, 2}});
  const FrontLayout layout(pattern, {{0, 1, 2}, {0, 1, 2, 3}, {1, 2, -1}}, 1);
  const FrontChild& child = layout.children[static_cast<std::size_t>(layout.fronts[1].child_begin)];
  REQUIRE(child.run_end - child.run_begin == 2);
  CHECK(layout.runs[static_cast<std::size_t>(child.run_begin)].target == 0);
  CHECK(layout.runs[static_cast<std::size_t>(child.run_begin) + 1].target == 3);
}

TEST_CASE("Each front lists its children in ascending order for any number of nodes") {
  // Combs: vertex 2i is a child of vertex 2i+1, and those form a chain. Every seventh tooth is
  // disconnected.
  const int teeth = 20000, n = 2 * teeth;
  std::vector<std::pair<int, int>> pairs;
  EliminationTree tree;
  tree.node_begin.push_back(0);
  for (int i = 0; i < n; ++i) {
    const bool tooth = i % 2 == 0, loose = tooth && i % 7 == 0;
    const int parent = tooth ? i + 1 : i + 2;
    if (!loose && parent < n) pairs.push_back({i, parent});
    tree.permutation.push_back(i);
    tree.node_begin.push_back(i + 1);
    tree.parent.push_back(parent < n ? parent : -1);
  }
  const FrontLayout layout(BlockSymmetric<double>(n, pairs), tree, 8);
  REQUIRE(layout.fronts.size() == static_cast<std::size_t>(n));
  bool right = true;
  for (int k = 0; k < n; ++k) {
    const Front& front = layout.fronts[static_cast<std::size_t>(k)];
    std::vector<int> found, expected;
    for (int c = front.child_begin; c < front.child_end; ++c)
      found.push_back(layout.children[static_cast<std::size_t>(c)].front);
    if (k % 2 == 1) {
      if (k > 1) expected.push_back(k - 2);
      if ((k - 1) % 7 != 0) expected.push_back(k - 1);
    }
    right = right && found == expected;
  }
  CHECK(right);
}

TEST_CASE("Update matrices that exist at the same time do not overlap, and memory is reused") {
  // Six leaves of one vertex around a hub of four: all are kept until the hub.
  std::vector<std::pair<int, int>> pairs;
  for (int leaf = 0; leaf < 6; ++leaf) {
    for (int hub = 0; hub <= leaf % 4; ++hub) pairs.push_back({leaf, 6 + hub});
  }
  const BlockSymmetric<double> star(10, pairs);
  const FrontLayout layout(
      star, {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9}, {0, 1, 2, 3, 4, 5, 6, 10}, {6, 6, 6, 6, 6, 6, -1}}, 4);
  for (std::size_t k = 0; k < 6; ++k) {
    const Front& front = layout.fronts[k];
    CHECK(front.update + front.ldu * front.border <= layout.update_size);
    for (std::size_t other = 0; other < k; ++other) {
      const Front& before = layout.fronts[other];
      const bool apart = front.update >= before.update + before.ldu * before.border ||
                         before.update >= front.update + front.ldu * front.border;
      CHECK(apart);
    }
  }
  // A chain: only a vertex and the previous one exist together.
  const BlockSymmetric<double> chain(6, {{0, 1}, {1, 2}, {2, 3}, {3, 4}, {4, 5}});
  const FrontLayout links(chain, {{0, 1, 2, 3, 4, 5}, {0, 1, 2, 3, 4, 5, 6}, {1, 2, 3, 4, 5, -1}},
                          1);
  CHECK(links.update_size == 18);
  CHECK(links.fronts[1].update != links.fronts[0].update);
  CHECK(links.fronts[2].update == links.fronts[0].update);
}
