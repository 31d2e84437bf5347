// The tree of a sheet that is compared with itself: each pair whose boxes overlap, once.

#include "clothctl/collision/detail/self_tree.hpp"

#include <map>
#include <random>

#include "support/catch.hpp"
#include "support/folded_sheets.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::uniform;

TEST_CASE("a tree compared with itself gives each pair of features once", "[self_contact]") {
  using Boxes = std::vector<BoundingBox<double>>;
  std::mt19937 random(31);
  const auto mesh = clothctl_test::layer(9, 1);
  const std::vector<std::array<int, 2>> threads{{81, 82}, {82, 83}};
  Points<double> x(3, 85);  // the last vertex is alone
  x << mesh.positions, Points<double>::Random(3, 4);
  const auto edges = detail::sheet_edges(mesh.triangles, threads);
  std::vector<int> alias(85);
  for (int v = 0; v < 85; ++v) alias[static_cast<std::size_t>(v)] = v;
  alias[83] = 0;
  detail::SelfTree<double> tree(x, detail::sheet_parts(85, mesh.triangles, edges), edges, alias);
  for (int trial = 0; trial < clothctl_test::trials(10, 200, 3); ++trial) {
    Points<double> a = x, b = x;
    for (Index i = 0; i < x.size(); ++i) {
      a(i) += uniform(random, -0.1, 0.1);
      b(i) = a(i) + uniform(random, -0.1, 0.1);
    }
    const double grow = 0.01;
    tree.fit(a, b, grow);
    const auto box = [&](std::initializer_list<int> vertices) {
      BoundingBox<double> out{a.col(*vertices.begin()), a.col(*vertices.begin())};
      for (const int v : vertices) {
        out.include(Vector3<double>(a.col(v)));
        out.include(Vector3<double>(b.col(v)));
      }
      return out.grown(grow);
    };
    const auto same = [&](std::initializer_list<int> p, std::initializer_list<int> q) {
      for (const int v : p) {
        for (const int w : q) {
          if (alias[static_cast<std::size_t>(v)] == alias[static_cast<std::size_t>(w)]) return true;
        }
      }
      return false;
    };
    std::map<std::array<int, 3>, int> found, pierced;
    tree.for_each_pair([&](bool e, int p, int q) { ++found[{e, p, q}]; });
    tree.for_each_edge_triangle([&](int e, int t) { ++pierced[{0, e, t}]; });
    int wrong = 0, count = 0, crossing = 0;
    Boxes of_edges, of_triangles;
    for (const auto& e : edges) of_edges.push_back(box({e[0], e[1]}));
    for (const auto& t : mesh.triangles) of_triangles.push_back(box({t[0], t[1], t[2]}));
    for (int t = 0; t < static_cast<int>(mesh.triangles.size()); ++t) {
      const auto& c = mesh.triangles[static_cast<std::size_t>(t)];
      const auto& around = of_triangles[static_cast<std::size_t>(t)];
      for (int v = 0; v < 85; ++v) {
        const bool expected = !same({v}, {c[0], c[1], c[2]}) && box({v}).overlaps(around);
        wrong += found.count({0, v, t}) != (expected ? 1u : 0u);
        count += expected;
      }
      for (int e = 0; e < static_cast<int>(edges.size()); ++e) {
        const auto& s = edges[static_cast<std::size_t>(e)];
        const bool expected = !same({s[0], s[1]}, {c[0], c[1], c[2]}) &&
                              of_edges[static_cast<std::size_t>(e)].overlaps(around);
        wrong += pierced.count({0, e, t}) != (expected ? 1u : 0u);
        crossing += expected;
      }
    }
    for (int e = 0; e < static_cast<int>(edges.size()); ++e) {
      for (int f = e + 1; f < static_cast<int>(edges.size()); ++f) {
        const auto &p = edges[static_cast<std::size_t>(e)], &q = edges[static_cast<std::size_t>(f)];
        const bool expected =
            !same({p[0], p[1]}, {q[0], q[1]}) &&
            of_edges[static_cast<std::size_t>(e)].overlaps(of_edges[static_cast<std::size_t>(f)]);
        wrong += found.count({1, e, f}) != (expected ? 1u : 0u);
        count += expected;
      }
    }
    for (const auto& [key, times] : found) wrong += times != 1;
    for (const auto& [key, times] : pierced) wrong += times != 1;
    CHECK(wrong == 0);
    CHECK(count > 1000);
    CHECK(crossing > 100);
  }
}

TEST_CASE("a tree without parts has no pairs", "[self_contact]") {
  detail::SelfTree<double> tree(Points<double>(3, 0), {}, {}, {});
  tree.fit(Points<double>(3, 0), Points<double>(3, 0), 0.1);
  int count = 0;
  tree.for_each_pair([&](bool, int, int) { ++count; });
  CHECK(count == 0);
}
