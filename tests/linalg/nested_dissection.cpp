#include "clothctl/linalg/nested_dissection.hpp"

#include <algorithm>
#include <limits>
#include <random>

#include "math/assertion.hpp"
#include "support/block_matrices.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

BlockSymmetric<double> pattern_of(const Graph& graph) {
  return BlockSymmetric<double>(graph.size(), graph.pairs);
}

/// Checks that the order is a permutation, nodes cover it, children precede parents, and couplings
/// only lead towards a root.
void check_tree(const EliminationTree& tree, const Graph& graph) {
  const std::size_t n = static_cast<std::size_t>(graph.size()), nodes = tree.parent.size();
  REQUIRE(tree.permutation.size() == n);
  REQUIRE(tree.node_begin.size() == nodes + 1);
  CHECK(tree.node_begin.front() == 0);
  CHECK(tree.node_begin.back() == graph.size());
  CHECK(std::is_sorted(tree.node_begin.begin(), tree.node_begin.end()));
  std::vector<int> sorted = tree.permutation;
  std::sort(sorted.begin(), sorted.end());
  for (std::size_t i = 0; i < n; ++i) REQUIRE(sorted[i] == static_cast<int>(i));
  std::vector<int> node_of(n);
  for (std::size_t k = 0; k < nodes; ++k) {
    CHECK((tree.parent[k] == -1 || tree.parent[k] > static_cast<int>(k)));
    CHECK(tree.parent[k] < static_cast<int>(nodes));
    for (int p = tree.node_begin[k]; p < tree.node_begin[k + 1]; ++p) {
      node_of[static_cast<std::size_t>(tree.permutation[static_cast<std::size_t>(p)])] =
          static_cast<int>(k);
    }
  }
  int strangers = 0;
  for (const auto& [i, j] : graph.pairs) {
    int low = node_of[static_cast<std::size_t>(i)], high = node_of[static_cast<std::size_t>(j)];
    if (low > high) std::swap(low, high);
    while (low != -1 && low < high) low = tree.parent[static_cast<std::size_t>(low)];
    strangers += low != high;
  }
  CHECK(strangers == 0);
}

}  // namespace

TEST_CASE("Orders of sheets, ropes, solids and random graphs are valid elimination trees") {
  std::mt19937 random(41);
  const Graph graphs[] = {sheet_graph(9, 9, true),
                          sheet_graph(33, 33, true),
                          sheet_graph(4, 30, false),
                          rope_graph(100),
                          rope_graph(1),
                          random_graph(60, 90, random),
                          random_graph(40, 700, random),
                          cloud_graph(300, 0.25, random),
                          random_graph(50, 0, random)};
  for (const Graph& graph : graphs) {
    for (const int leaf : {1, 4, 12, 1000})
      check_tree(nested_dissection(pattern_of(graph), graph.positions, leaf), graph);
  }
}

TEST_CASE("An empty graph has an order without nodes") {
  const EliminationTree tree = nested_dissection(BlockSymmetric<double>(), Points<double>(3, 0));
  CHECK(tree.parent.empty());
  CHECK(tree.permutation.empty());
  CHECK(tree.node_begin == std::vector<int>{0});
}

TEST_CASE("A sheet is divided into halves along a line of vertices") {
  const Graph springs = sheet_graph(17, 17, false), bent = sheet_graph(17, 17, true);
  const EliminationTree one = nested_dissection(pattern_of(springs), springs.positions);
  const EliminationTree two = nested_dissection(pattern_of(bent), bent.positions);
  CHECK(one.node_begin.back() - one.node_begin[one.node_begin.size() - 2] == 17);
  CHECK(two.node_begin.back() - two.node_begin[two.node_begin.size() - 2] == 34);
  CHECK(std::count(one.parent.begin(), one.parent.end(), -1) == 1);
  CHECK(std::count(one.parent.begin(), one.parent.end(), static_cast<int>(one.parent.size()) - 1) ==
        2);
}

TEST_CASE("Separate bodies need no common ancestor") {
  Graph graph = sheet_graph(6, 6, true);
  const Graph other = sheet_graph(6, 6, true);
  graph.positions.conservativeResize(3, 72);
  graph.positions.rightCols(36) = other.positions.colwise() + Eigen::Vector3d(5.0, 0.0, 0.0);
  for (const auto& [i, j] : other.pairs) graph.pairs.push_back({i + 36, j + 36});
  const EliminationTree tree = nested_dissection(pattern_of(graph), graph.positions);
  check_tree(tree, graph);
  CHECK(std::count(tree.parent.begin(), tree.parent.end(), -1) >= 2);
}

TEST_CASE("Coincident vertices are ordered") {
  Graph graph = sheet_graph(10, 10, true);
  graph.positions.setZero();
  check_tree(nested_dissection(pattern_of(graph), graph.positions), graph);
}

TEST_CASE("The same input gives the same order") {
  std::mt19937 random(42);
  const Graph graph = cloud_graph(200, 0.3, random);
  const EliminationTree a = nested_dissection(pattern_of(graph), graph.positions);
  const EliminationTree b = nested_dissection(pattern_of(graph), graph.positions);
  CHECK(a.permutation == b.permutation);
  CHECK(a.node_begin == b.node_begin);
  CHECK(a.parent == b.parent);
}

TEST_CASE("Positions that are not finite stop at an assert, or still give a valid order") {
  std::mt19937 random(43);
  Graph graph = cloud_graph(200, 0.3, random);
  const double bad[] = {std::numeric_limits<double>::quiet_NaN(),
                        std::numeric_limits<double>::infinity(),
                        -std::numeric_limits<double>::infinity()};
  for (int v = 0; v < 200; v += 3) graph.positions(v % 2, v) = bad[(v / 3) % 3];
  CHECK(is_stopped([&] { nested_dissection(pattern_of(graph), graph.positions); }));
  const BlockSymmetric<double> pattern = pattern_of(graph);
  const PointsView<double> positions(graph.positions);
  check_tree(detail::Dissection<double>(pattern, positions, 4).take(), graph);
  // If no position is finite, the order is that of the indices.
  graph.positions.setConstant(bad[0]);
  check_tree(detail::Dissection<double>(pattern, positions, 4).take(), graph);
}
