// The tree of triangles: all triangles are in it, its sweeps pass nothing, its boxes are entered at
// the right time.

#include "clothctl/collision/detail/triangle_tree.hpp"

#include <cmath>
#include <random>

#include "support/catch.hpp"
#include "support/solids.hpp"

using namespace clothctl;
using clothctl_test::uniform;
using V = Vector3<double>;

namespace {

detail::TriangleTree<double> tree_of(const clothctl_test::PlainMesh& mesh) {
  const Topology topology = make_topology(mesh.positions.cols(), mesh.triangles).value();
  return {mesh.positions, mesh.triangles,
          detail::pseudonormals<double>(mesh.positions, mesh.triangles, topology)};
}

}  // namespace

TEST_CASE("a ray is in a box from its entry", "[contact]") {
  const BoundingBox<double> box{V(0, 0, 0), V(1, 1, 1)};
  CHECK(detail::box_entry<double>(box, V(-1, 0.5, 0.5), V(1, 0.5, 0.5), 1.0) == 0.5);
  CHECK(detail::box_entry<double>(box, V(0.5, 0.5, 0.5), V(9, 0.5, 0.5), 1.0) == 0.0);
  CHECK(detail::box_entry<double>(box, V(-1, 0.5, 0.5), V(1, 0.5, 0.5), 0.4) ==
        no_impact<double>());
  CHECK(detail::box_entry<double>(box, V(-1, 2, 0.5), V(1, 2, 0.5), 1.0) == no_impact<double>());
  CHECK(detail::box_entry<double>(box, V(-1, -1, 0), V(1, 1, 0), 1.0) == 0.5);
  CHECK(detail::box_entry<double>(box, V(-3, 0.5, 0.5), V(-2, 0.5, 0.5), 1.0) ==
        no_impact<double>());
}

TEST_CASE("every corner of a mesh is found at the distance 0", "[contact]") {
  for (const auto& mesh : {clothctl_test::icosphere(3, 1), clothctl_test::torus_mesh(9, 6, 1, 0.3),
                           clothctl_test::box_mesh({1, 2, 3})}) {
    const auto tree = tree_of(mesh);
    double worst = 0;
    for (Index v = 0; v < mesh.positions.cols(); ++v)
      worst = std::max(worst, std::abs(tree.nearest(mesh.positions.col(v)).distance));
    CHECK(worst <= 1e-15);
    const auto box = tree.bounds();
    CHECK(box.lower == V(mesh.positions.rowwise().minCoeff()));
    CHECK(box.upper == V(mesh.positions.rowwise().maxCoeff()));
  }
}

TEST_CASE("a ball hits a mesh when it hits the first of its triangles", "[contact]") {
  const auto mesh = clothctl_test::torus_mesh(14, 9, 1, 0.3);
  const auto tree = tree_of(mesh);
  std::mt19937 random(91);
  int hits = 0;
  for (int i = 0; i < 200; ++i) {
    V a, b;
    for (int c = 0; c < 3; ++c) {
      a[c] = uniform(random, -2, 2);
      b[c] = uniform(random, -2, 2);
    }
    const double radius = i % 2 == 0 ? 0.0 : 0.05;
    if (tree.nearest(a).distance <= radius) continue;
    double first = no_impact<double>();
    for (const auto& t : mesh.triangles) {
      const detail::PreparedTriangle<double> triangle(
          mesh.positions.col(t[0]), mesh.positions.col(t[1]), mesh.positions.col(t[2]));
      const auto nearest = [&](const V& x) {
        const auto q = triangle.closest(x);
        const double length = std::sqrt(q.square);
        return detail::NearestPoint<double>{length, x - q.offset, q.offset / length};
      };
      first = std::min(first, detail::convex_sweep<double>(nearest, a, b, radius));
    }
    const double found = tree.sweep(a, b, radius);
    CHECK(std::abs(found - first) <= 1e-12);
    hits += found <= 1;
  }
  CHECK(hits > 50);
}
