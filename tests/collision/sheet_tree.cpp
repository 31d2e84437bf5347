// The parts of a sheet, each once, and the boxes of the tree over them.

#include "clothctl/collision/detail/sheet_tree.hpp"

#include <algorithm>
#include <random>

#include "support/catch.hpp"
#include "support/meshes.hpp"

using namespace clothctl;

TEST_CASE("a sheet consists of triangles, threads and single vertices", "[contact]") {
  const std::vector<std::array<int, 3>> triangles{{0, 1, 2}, {2, 1, 3}};
  const std::vector<std::array<int, 2>> threads{{4, 3}, {1, 0}};  // the second is a side
  const auto edges = detail::sheet_edges(triangles, threads);
  CHECK(edges == std::vector<std::array<int, 2>>{{0, 1}, {0, 2}, {1, 2}, {1, 3}, {2, 3}, {3, 4}});
  const auto parts = detail::sheet_parts(6, triangles, edges);
  REQUIRE(parts.size() == 4);
  CHECK(parts[0].triangle == 0);
  CHECK(parts[0].edge == std::array<int, 3>{0, 2, 1});
  CHECK(parts[1].edge == std::array<int, 3>{2, 3, 4});
  CHECK(parts[2].vertex == std::array<int, 3>{3, 4, -1});
  CHECK(parts[2].edge == std::array<int, 3>{5, -1, -1});
  CHECK(parts[2].count() == 2);
  CHECK(parts[3].vertex == std::array<int, 3>{5, -1, -1});
  CHECK(parts[3].count() == 1);
}

TEST_CASE("a search finds all parts in a box, each once", "[contact]") {
  std::mt19937 random(111);
  const auto mesh = clothctl_test::irregular_mesh(15, 11, random, 0.1);
  const auto edges = detail::sheet_edges(mesh.triangles, {});
  const int n = static_cast<int>(mesh.positions.cols());
  detail::SheetTree<double> tree(mesh.positions, detail::sheet_parts(n, mesh.triangles, edges));
  Points<double> x = mesh.positions;
  for (int trial = 0; trial < 20; ++trial) {
    for (Index i = 0; i < x.size(); ++i) x(i) += clothctl_test::uniform(random, -0.02, 0.02);
    tree.fit(x, x);
    const Vector3<double> low = x.col(static_cast<Index>(random()) % n);
    const BoundingBox<double> box{low, low + Vector3<double>::Constant(0.1)};
    std::vector<int> found;
    tree.for_each_overlap(box, [&](int first, int count) {
      for (int i = first; i < first + count; ++i)
        found.push_back(tree.parts()[static_cast<std::size_t>(i)].triangle);
    });
    std::sort(found.begin(), found.end());
    CHECK(std::adjacent_find(found.begin(), found.end()) == found.end());
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      const auto& c = mesh.triangles[t];
      BoundingBox<double> around{x.col(c[0]), x.col(c[0])};
      around.include(Vector3<double>(x.col(c[1])));
      around.include(Vector3<double>(x.col(c[2])));
      if (around.overlaps(box))
        CHECK(std::binary_search(found.begin(), found.end(), static_cast<int>(t)));
    }
    CHECK(found.size() < mesh.triangles.size() / 2);
  }
}
