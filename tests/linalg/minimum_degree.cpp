#include "clothctl/linalg/detail/minimum_degree.hpp"

#include <random>
#include <set>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Graph = std::vector<std::set<int>>;

void join(Graph& g, int a, int b) {
  if (a == b) return;
  g[static_cast<std::size_t>(a)].insert(b);
  g[static_cast<std::size_t>(b)].insert(a);
}

bool order(detail::MinimumDegree& degree, const Graph& g, double work = 1e18,
           Index fill = 1 << 20) {
  degree.start(static_cast<Index>(g.size()));
  for (const std::set<int>& neighbours : g) {
    for (int i : neighbours) degree.neighbour(i);
    degree.close();
  }
  return degree.order(work, fill);
}

// Eliminates by definition and returns the number of entries in each column.
std::vector<int> eliminate(Graph g, const std::vector<int>& order) {
  std::vector<int> columns(g.size());
  for (int p : order) {
    const std::set<int> members = g[static_cast<std::size_t>(p)];
    columns[static_cast<std::size_t>(p)] = static_cast<int>(members.size());
    for (int a : members) {
      g[static_cast<std::size_t>(a)].erase(p);
      for (int b : members) join(g, a, b);
    }
  }
  return columns;
}

Graph grid(int side) {
  Graph g(static_cast<std::size_t>(side * side));
  for (int r = 0; r < side; ++r) {
    for (int c = 0; c < side; ++c) {
      if (c + 1 < side) join(g, r * side + c, r * side + c + 1);
      if (r + 1 < side) join(g, r * side + c, r * side + c + side);
    }
  }
  return g;
}

std::vector<int> order_of(const detail::MinimumDegree& degree, std::size_t nodes) {
  std::vector<int> out;
  for (std::size_t k = 0; k < nodes; ++k) out.push_back(degree.node(static_cast<int>(k)));
  return out;
}

}  // namespace

TEST_CASE("the order is a permutation, and its column counts match an elimination", "[qp]") {
  std::mt19937 random(12);
  detail::MinimumDegree degree;
  degree.reserve(60, 60 * 60, 60 * 60);
  for (int trial = 0; trial < 60; ++trial) {
    const int nodes = trial < 3 ? trial + 1 : 60;
    Graph g(static_cast<std::size_t>(nodes));
    const auto drawn = [&] { return static_cast<int>(random() % static_cast<unsigned>(nodes)); };
    const int edges = static_cast<int>(random() % 200);
    for (int e = 0; e < edges; ++e) join(g, drawn(), drawn());
    REQUIRE(order(degree, g));
    const std::vector<int> places = order_of(degree, g.size());
    REQUIRE(std::set<int>(places.begin(), places.end()).size() == g.size());
    const std::vector<int> columns = eliminate(g, places);
    int fill = 0;
    double work = 0;
    for (int p = 0; p < nodes; ++p) {
      REQUIRE(degree.column(p) == columns[static_cast<std::size_t>(p)]);
      fill += degree.column(p);
      work += double(degree.column(p)) * degree.column(p);
    }
    CHECK(degree.fill() == fill);
    CHECK(degree.work() == work);
  }
}

TEST_CASE(
    "minimum degree fills nothing in trees and arrows, and far less in grids than the natural "
    "order",
    "[qp]") {
  detail::MinimumDegree degree;
  degree.reserve(900, 4000, 100000);
  Graph tree(500);
  for (int i = 1; i < 500; ++i) join(tree, i, (i * 7919) % i);
  REQUIRE(order(degree, tree));
  CHECK(degree.fill() == 499);

  Graph arrow(100);
  for (int i = 1; i < 100; ++i) join(arrow, 0, i);
  REQUIRE(order(degree, arrow));
  CHECK(degree.fill() == 99);
  CHECK((degree.node(99) == 0 || degree.node(98) == 0));

  const Graph sheet = grid(30);
  std::vector<int> own(900);
  for (int i = 0; i < 900; ++i) own[static_cast<std::size_t>(i)] = i;
  int banded = 0;
  for (int c : eliminate(sheet, own)) banded += c;
  REQUIRE(order(degree, sheet));
  CHECK(degree.fill() < banded / 2);
}

TEST_CASE("too much fill or work is refused, and the next graph is accepted", "[qp]") {
  detail::MinimumDegree degree;
  degree.reserve(40, 40 * 40, 300);
  Graph full(40);
  for (int a = 0; a < 40; ++a) {
    for (int b = 0; b < a; ++b) join(full, a, b);
  }
  CHECK_FALSE(order(degree, full));  // 780 entries
  const Graph sheet = grid(6);
  REQUIRE(order(degree, sheet));
  const double work = degree.work();
  CHECK_FALSE(order(degree, sheet, work - 1));
  CHECK(order(degree, sheet, work));
  const int fill = degree.fill();
  CHECK_FALSE(order(degree, sheet, 1e18, fill - 1));
  CHECK(order(degree, sheet, 1e18, fill));
}

TEST_CASE("the same graph gets the same order without allocating", "[qp]") {
  detail::MinimumDegree degree;
  degree.reserve(400, 2000, 20000);
  const Graph sheet = grid(20);
  REQUIRE(order(degree, sheet));
  const std::vector<int> first = order_of(degree, 400);
  const long before = clothctl_test::allocations();
  const bool again = order(degree, sheet);
  const long taken = clothctl_test::allocations() - before;
  REQUIRE(again);
  if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
  CHECK(order_of(degree, 400) == first);
}
