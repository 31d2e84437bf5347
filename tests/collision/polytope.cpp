// Polytopes: faces merged from the triangles of hulls, edges, and the moments of solids.

#include "clothctl/collision/detail/polytope.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "clothctl/collision/mesh_collider.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using V = Vector3<double>;

namespace {

/// Checks Euler's formula, that all corners are below all faces, and that edges join their faces.
void check_polytope(const Polytope<double>& P, int corners_in_use) {
  CHECK(corners_in_use - P.edge_count() + P.face_count() == 2);
  for (int f = 0; f < P.face_count(); ++f) {
    const V n = P.normals.col(f);
    CHECK(n.norm() == Approx(1));
    for (int i = 0; i < P.corner_count(); ++i) CHECK(n.dot(P.corners.col(i)) < P.offsets[f] + 1e-9);
    for (int k = 0; k < P.face_size(f); ++k)
      CHECK(n.dot(P.corners.col(P.face_corner(f, k))) == Approx(P.offsets[f]).margin(1e-5));
  }
  for (const PolytopeEdge& e : P.edges) {
    CHECK(e.left != e.right);
    const V m = 0.5 * (P.corners.col(e.a) + P.corners.col(e.b));
    for (const int f : {e.left, e.right}) {
      const V n = P.normals.col(f);
      CHECK(n.dot(m) == Approx(P.offsets[f]).margin(1e-5));
    }
  }
}

}  // namespace

TEST_CASE("a box has six faces, twelve edges, and outward normals") {
  const Polytope<double> P = box_polytope<double>(V(1, 2, 3));
  CHECK(P.face_count() == 6);
  check_polytope(P, 8);
  for (const V& d : {V(1, 0, 0), V(0, -1, 0), V(0, 0, 1)})
    CHECK((V(P.normals.col(P.face_towards(d))) - d).norm() < 1e-12);
}

TEST_CASE("the triangles of a hull become faces") {
  const Polytope<double> box = box_polytope<double>(V(0.3, 0.2, 0.1));
  const HullCollider<double> hull = HullCollider<double>::create(box.corners).value();
  const Polytope<double> P = hull_polytope<double>(hull.vertices(), hull.triangles());
  CHECK(P.face_count() == 6);
  CHECK(P.edge_count() == 12);
  check_polytope(P, 8);
  std::mt19937 random(1);
  for (int trial = 0; trial < 20; ++trial) {
    Points<double> x(3, 20);
    for (Index i = 0; i < x.size(); ++i) x(i) = static_cast<double>(random()) / 4294967296.0 - 0.5;
    const HullCollider<double> made = HullCollider<double>::create(x).value();
    check_polytope(hull_polytope<double>(made.vertices(), made.triangles()),
                   static_cast<int>(made.vertices().cols()));
  }
}

TEST_CASE("moments of a solid, wherever it is") {
  const Polytope<double> box = box_polytope<double>(V(1, 2, 3));
  for (const V& shift : {V(0, 0, 0), V(100, -50, 7)}) {
    const Points<double> x = box.corners.colwise() + shift;
    const HullCollider<double> hull = HullCollider<double>::create(x).value();
    const SolidMoments<double> m = solid_moments<double>(hull.vertices(), hull.triangles());
    CHECK(m.volume == Approx(48));
    CHECK((m.centre - shift).norm() < 1e-9);
    const V expected = 48.0 / 3 * V(4 + 9, 1 + 9, 1 + 4);
    CHECK((m.inertia - Matrix3<double>(expected.asDiagonal())).norm() < 1e-6);
  }
}
