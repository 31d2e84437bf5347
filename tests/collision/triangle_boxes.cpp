// Triangles in a tree of boxes against all triangles, where they were made and where they moved.

#include "clothctl/collision/detail/triangle_boxes.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"

using namespace clothctl;
using clothctl_test::irregular_mesh;
using clothctl_test::PlainMesh;
using clothctl_test::uniform;
using V = Vector3<double>;

namespace {

V anywhere(std::mt19937& random) {
  const double x = uniform(random, -0.5, 1.5), y = uniform(random, -1, 1);
  return V(x, y, uniform(random, -0.5, 1.5));
}

/// Compares closest triangles and sweeps with all triangles. Returns the number of hits.
int compare(const detail::TriangleBoxes<double>& boxes, const PlainMesh& mesh,
            std::mt19937& random) {
  std::vector<detail::PreparedTriangle<double>> all;
  for (const auto& t : mesh.triangles)
    all.emplace_back(mesh.positions.col(t[0]), mesh.positions.col(t[1]), mesh.positions.col(t[2]));
  int hits = 0;
  for (int i = 0; i < 200; ++i) {
    const V x = anywhere(random), y = anywhere(random);
    const double reach = 0.01;
    double least = 100, first = no_impact<double>();
    for (const auto& triangle : all) {
      least = std::min(least, triangle.closest(x).square);
      const auto closest = [&](const V& p) {
        const auto q = triangle.closest(p);
        const double length = std::sqrt(q.square);
        return detail::NearestPoint<double>{length, p - q.offset, q.offset / length};
      };
      first = std::min(first, detail::convex_sweep<double>(closest, x, y, reach, 1.0, 2.0));
    }
    const std::size_t nearest = boxes.nearest(x);
    CHECK(std::abs(boxes.triangle(nearest).closest(x).square - least) <= 1e-15);
    const double time = boxes.sweep(x, y, reach, std::sqrt(least));
    if (reach < std::sqrt(least)) CHECK(std::abs(time - first) <= 1e-12);
    // A point that starts inside, by the distance that is said.
    CHECK(boxes.sweep(x, y, reach, -1.0) == 0);
    hits += time <= 1;
  }
  return hits;
}

}  // namespace

TEST_CASE("the closest and the first of many triangles are found", "[contact]") {
  std::mt19937 random(141);
  PlainMesh mesh = irregular_mesh(12, 9, random, 0.3);
  detail::TriangleBoxes<double> boxes;
  const std::vector<int> order = boxes.build(mesh.positions, mesh.triangles);
  CHECK(compare(boxes, mesh, random) > 20);
  const auto sorted = detail::in_order(mesh.triangles, order);
  for (std::size_t k = 0; k < sorted.size(); ++k)
    CHECK(boxes.triangle(k).corner() == V(mesh.positions.col(sorted[k][0])));
  for (int step = 0; step < 3; ++step) {
    for (Index i = 0; i < mesh.positions.size(); ++i)
      mesh.positions(i) += uniform(random, -0.1, 0.1);
    const Points<double> x = mesh.positions;
    const long before = clothctl_test::allocations();
    boxes.fit(x, sorted);
    const long made = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
    CHECK(boxes.bounds().lower == V(x.rowwise().minCoeff()));
    CHECK(boxes.bounds().upper == V(x.rowwise().maxCoeff()));
    CHECK(compare(boxes, mesh, random) > 20);
  }
}

TEST_CASE("far from one triangle, that is the closest", "[contact]") {
  Points<double> x(3, 3);
  x << 0, 1, 0, 0, 0, 1, 0, 0, 0;
  detail::TriangleBoxes<double> boxes;
  CHECK(boxes.build(x, {{0, 1, 2}}) == std::vector<int>{0});
  for (const double away : {1.0, 1e10, 1e200}) CHECK(boxes.nearest(V(away, -away, away)) == 0);
}
