// Contacts with a collider by its distances: the deepest points of edges and faces, and what the
// search takes from a foreign collider.

#include "clothctl/collision/detail/collider_contacts.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "clothctl/collision/body_contacts.hpp"
#include "clothctl/collision/mesh_collider.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;
using M = Matrix3<double>;

namespace {

const ConvexShape<double>& cube() {
  static const ConvexShape<double> shape = ConvexShape<double>::box(V(0.5, 0.5, 0.5)).value();
  return shape;
}
template <class C>
BodyContacts<double> find(const ConvexShape<double>& shape, const M& R, const V& p, const C& c) {
  return find_collider_contacts<double>(shape, R, p, ColliderRef<double>(c), 0.01);
}

}  // namespace

TEST_CASE("a small ball under the middle of a face, and under an edge") {
  const SphereCollider<double> ball = SphereCollider<double>::create(V(0.1, 0.05, 0), 0.1).value();
  const BodyContacts<double> face = find(cube(), M::Identity(), V(0, 0, 0.595), ball);
  REQUIRE(face.count == 1);
  CHECK(face.points[0].gap == Approx(-0.005).margin(1e-4));
  CHECK((face.points[0].normal - V(0, 0, 1)).norm() < 0.02);
  const double down = std::sqrt(0.5);
  const M turned = rotation_exp<double>(V(0, std::acos(-1.0) / 4, 0));
  const BodyContacts<double> edge = find(cube(), turned, V(0.1, 0, down + 0.095), ball);
  REQUIRE(edge.count == 1);
  CHECK(edge.points[0].gap == Approx(-0.005).margin(1e-4));
}

TEST_CASE("a hull with sharp faces finds no contact beyond itself") {
  const PlaneCollider<double> plane = PlaneCollider<double>::create(V(0, 0, 0), V(0, 0, 1)).value();
  std::mt19937 random(3);
  for (int trial = 0; trial < 200; ++trial) {
    Points<double> x(3, 8);
    for (Index i = 0; i < x.size(); ++i) x(i) = static_cast<double>(random()) / 4294967296.0 - 0.5;
    x.row(1) *= 0.1;
    const ConvexShape<double> hull = ConvexShape<double>::hull(x).value();
    const double lowest = hull.core().corners.row(2).minCoeff();
    const BodyContacts<double> c = find(hull, M::Identity(), V(0, 0, -lowest - 0.005), plane);
    REQUIRE(c.count >= 1);
    for (int i = 0; i < c.count; ++i) {
      CHECK(c.points[static_cast<std::size_t>(i)].gap > -0.0051);
      CHECK(c.points[static_cast<std::size_t>(i)].position.norm() < 2);
    }
  }
}

TEST_CASE("a box on a mesh and on its grid") {
  const detail::Polytope<double> corners = detail::box_polytope<double>(V(2, 2, 1));
  const HullCollider<double> hull = HullCollider<double>::create(corners.corners).value();
  const MeshCollider<double> mesh =
      MeshCollider<double>::create(hull.vertices(), hull.triangles()).value();
  const BodyContacts<double> c = find(cube(), M::Identity(), V(0.2, 0.3, 1.499), mesh);
  REQUIRE(c.count == 4);
  for (std::size_t i = 0; i < 4; ++i) CHECK(c.points[i].gap == Approx(-0.001));
}

TEST_CASE("a capsule across a thin rod touches between its ends") {
  const CapsuleCollider<double> rod =
      CapsuleCollider<double>::create(V(0, -2, 0), V(0, 2, 0), 0.05).value();
  const ConvexShape<double> capsule = ConvexShape<double>::capsule(1.0, 0.1).value();
  const M lying = rotation_exp<double>(V(0, std::acos(-1.0) / 2, 0));
  const BodyContacts<double> c = find(capsule, lying, V(0.4, 0, 0.149), rod);
  REQUIRE(c.count == 1);
  CHECK(c.points[0].gap == Approx(-0.001).margin(1e-4));
  CHECK(std::abs(c.points[0].position[0]) < 0.01);
}
