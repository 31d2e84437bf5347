// Contacts of bodies: known cases, separation against sampled distances for random pairs, symmetry,
// degenerate poses, and contacts with any collider.

#include "clothctl/collision/body_contacts.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <vector>

#include "clothctl/collision/collider_union.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::allocation_counting_works;
using clothctl_test::allocations;
using clothctl_test::trials;

namespace {

using V = Vector3<double>;
using M = Matrix3<double>;
using Shape = ConvexShape<double>;
using Contacts = BodyContacts<double>;

const M kUpright = M::Identity();

double unit(std::mt19937& random) { return static_cast<double>(random()) / 4294967296.0; }
V direction(std::mt19937& random) {
  V v;
  do {
    for (int k = 0; k < 3; ++k) v[k] = 2 * unit(random) - 1;
  } while (v.norm() < 0.1 || v.norm() > 1);
  return v.normalized();
}
Shape some_shape(std::mt19937& random, int kind) {
  const double a = 0.2 + 0.4 * unit(random), b = 0.2 + 0.4 * unit(random);
  if (kind == 0) return Shape::sphere(a).value();
  if (kind == 1) return Shape::capsule(a, b).value();
  if (kind == 2) return Shape::box(V(a, b, 0.2 + 0.4 * unit(random))).value();
  Points<double> x(3, 14);
  for (int k = 0; k < 14; ++k) x.col(k) = 0.6 * direction(random);
  return Shape::hull(x).value();
}
/// The extent of a posed shape along a direction: max n·x.
double reach(const Shape& s, const M& R, const V& p, const V& n) {
  double most = -1e30;
  for (int i = 0; i < s.core().corner_count(); ++i)
    most = std::max(most, n.dot(p + R * s.core().corners.col(i)));
  return most + s.radius();
}
double deepest(const Contacts& c) {
  double least = 1e30;
  for (int i = 0; i < c.count; ++i)
    least = std::min(least, c.points[static_cast<std::size_t>(i)].gap);
  return least;
}

}  // namespace

TEST_CASE("boxes face to face have four points") {
  const Shape box = Shape::box(V(0.5, 0.5, 0.5)).value();
  for (const double gap : {0.005, 0.0, -0.001}) {
    const Contacts c = find_body_contacts<double>(box, kUpright, V(0, 0, 1 + gap), box, kUpright,
                                                  V(0, 0, 0), 0.01);
    REQUIRE(c.count == 4);
    V sum = V::Zero();
    for (const BodyContactPoint<double>& p : {c.points[0], c.points[1], c.points[2], c.points[3]}) {
      CHECK(p.gap == Approx(gap).margin(1e-12));
      CHECK((p.normal - V(0, 0, 1)).norm() < 1e-12);
      CHECK(p.position[2] == Approx(0.5 + 0.5 * gap));
      sum += p.position;
    }
    CHECK(sum.head<2>().norm() < 1e-9);
  }
  CHECK(find_body_contacts<double>(box, kUpright, V(0, 0, 1.02), box, kUpright, V(0, 0, 0), 0.01)
            .count == 0);
  CHECK(find_body_contacts<double>(box, kUpright, V(0, 1.5, 1), box, kUpright, V(0, 0, 0), 0.01)
            .count == 0);
}

TEST_CASE("crossed edges have one point between them") {
  const Shape box = Shape::box(V(0.5, 0.5, 0.5)).value();
  const M A = rotation_exp<double>(V(std::acos(-1.0) / 4, 0, 0));
  const M B = rotation_exp<double>(V(0, std::acos(-1.0) / 4, 0));
  const double far_apart = std::sqrt(2.0);
  for (const double gap : {0.004, -0.01}) {
    const Contacts c =
        find_body_contacts<double>(box, A, V(0, 0, far_apart + gap), box, B, V(0, 0, 0), 0.01);
    REQUIRE(c.count == 1);
    CHECK(c.points[0].gap == Approx(gap).margin(1e-12));
    CHECK((c.points[0].position - V(0, 0, 0.5 * far_apart + 0.5 * gap)).norm() < 1e-9);
    CHECK((c.points[0].normal - V(0, 0, 1)).norm() < 1e-9);
  }
}

TEST_CASE("round shapes: faces, edges, corners, sides") {
  const Shape box = Shape::box(V(0.5, 0.5, 0.5)).value(), ball = Shape::sphere(0.25).value();
  const V corner = V(1, 1, 1).normalized();
  const V places[] = {V(0.1, 0.2, 0.76), V(0.5, 0, 0.5) + 0.26 * V(1, 0, 1).normalized(),
                      V(0.5, 0.5, 0.5) + 0.26 * corner};
  const V normals[] = {V(0, 0, 1), V(1, 0, 1).normalized(), corner};
  for (int i = 0; i < 3; ++i) {
    const Contacts c =
        find_body_contacts<double>(ball, kUpright, places[i], box, kUpright, V(0, 0, 0), 0.02);
    REQUIRE(c.count == 1);
    CHECK(c.points[0].gap == Approx(0.01));
    CHECK((c.points[0].normal - normals[i]).norm() < 1e-9);
  }
  const Shape capsule = Shape::capsule(0.3, 0.1).value();
  const M lying = rotation_exp<double>(V(0, std::acos(-1.0) / 2, 0));
  CHECK(find_body_contacts<double>(capsule, lying, V(0.4, 0, 0.6), box, kUpright, V(0, 0, 0), 0.01)
            .count == 2);
  CHECK(find_body_contacts<double>(capsule, kUpright, V(0, 0, 0.9), box, kUpright, V(0, 0, 0), 0.01)
            .count == 1);
  CHECK(find_body_contacts<double>(capsule, lying, V(0.2, 0, 0.2), capsule, lying, V(0, 0, 0), 0.01)
            .count == 2);
  CHECK(find_body_contacts<double>(capsule, lying, V(0, 0, 0.2), capsule,
                                   rotation_exp<double>(V(std::acos(-1.0) / 2, 0, 0)), V(0, 0, 0),
                                   0.01)
            .count == 1);
}

TEST_CASE("the deepest gap is the best separation of random pairs") {
  std::mt19937 random(5);
  for (int trial = 0; trial < trials(800, 20000, 100); ++trial) {
    const Shape A = some_shape(random, trial % 4), B = some_shape(random, trial / 4 % 4);
    const M R = rotation_exp<double>(3 * unit(random) * direction(random));
    const M Q = rotation_exp<double>(3 * unit(random) * direction(random));
    const V p = 0.9 * direction(random), q = 0.1 * direction(random);
    const Contacts c = find_body_contacts<double>(A, R, p, B, Q, q, 0.3);
    CAPTURE(trial);
    for (int i = 0; i < c.count; ++i) {
      const V n = c.points[static_cast<std::size_t>(i)].normal;
      CHECK(n.norm() == Approx(1));
      // The normal separates: the supports along it differ by about the deepest gap.
      const double apart = -reach(A, R, p, -n) - reach(B, Q, q, n);
      CHECK(apart < deepest(c) + 1e-6);
      // Faces are preferred to edges within 8 degrees; what a face cuts off may be deeper.
      CHECK(apart > deepest(c) - 0.08);
    }
    if (c.count == 0) continue;
    // No direction separates better.
    for (int k = 0; k < 60; ++k) {
      const V n = (c.points[0].normal + 0.3 * unit(random) * direction(random)).normalized();
      CHECK(-reach(A, R, p, -n) - reach(B, Q, q, n) < deepest(c) + 0.02);
    }
    // B and A exchanged: the same depth, the opposite normal.
    const Contacts d = find_body_contacts<double>(B, Q, q, A, R, p, 0.3);
    CHECK(d.count > 0);
    if (d.count > 0) CHECK(deepest(d) == Approx(deepest(c)).margin(0.02));
  }
}

TEST_CASE("degenerate poses: the same place, containment, parallel and touching") {
  std::mt19937 random(6);
  for (int a = 0; a < 4; ++a) {
    for (int b = 0; b < 4; ++b) {
      const Shape A = some_shape(random, a), B = some_shape(random, b);
      for (const V& p : {V(0, 0, 0), V(1e-14, 0, 0), V(0, 0.1, 0)}) {
        const Contacts c =
            find_body_contacts<double>(A, kUpright, p, B, kUpright, V(0, 0, 0), 0.01);
        CAPTURE(a, b, p[1]);
        REQUIRE(c.count > 0);
        for (int i = 0; i < c.count; ++i) {
          const BodyContactPoint<double>& point = c.points[static_cast<std::size_t>(i)];
          CHECK(point.gap < 0);
          CHECK(point.normal.norm() == Approx(1));
          CHECK(all_finite(point.position));
        }
      }
    }
  }
}

TEST_CASE("contacts with a collider agree with those of the shape") {
  std::mt19937 random(7);
  const PlaneCollider<double> plane = PlaneCollider<double>::create(V(0, 0, 0), V(0, 0, 1)).value();
  for (int trial = 0; trial < trials(200, 5000); ++trial) {
    const Shape A = some_shape(random, trial % 4);
    const M R = rotation_exp<double>(3 * unit(random) * direction(random));
    const V low(0, 0, -reach(A, R, V(0, 0, 0), V(0, 0, -1)));
    const Contacts c = find_collider_contacts<double>(A, R, V(0, 0, -0.01) - low,
                                                      ColliderRef<double>(plane), 0.02);
    CAPTURE(trial);
    REQUIRE(c.count >= 1);
    CHECK(deepest(c) == Approx(-0.01).margin(1e-9));
  }
  // Against a ball and a box as colliders: distances as of pairs.
  for (int trial = 0; trial < trials(200, 5000); ++trial) {
    const Shape A = some_shape(random, trial % 4), B = some_shape(random, 0);
    const M R = rotation_exp<double>(3 * unit(random) * direction(random));
    const SphereCollider<double> ball =
        SphereCollider<double>::create(V(0, 0, 0), B.radius()).value();
    const V way = direction(random);
    V p = 2 * way;
    for (int k = 0; k < 60; ++k) {  // bring them together to 5 mm
      const Contacts now = find_body_contacts<double>(A, R, p, B, kUpright, V(0, 0, 0), 10);
      if (now.count == 0 || deepest(now) < 0.005) break;
      p -= (deepest(now) - 0.004) * way;
    }
    const Contacts pair = find_body_contacts<double>(A, R, p, B, kUpright, V(0, 0, 0), 0.05);
    const Contacts c = find_collider_contacts<double>(A, R, p, ColliderRef<double>(ball), 0.05);
    CAPTURE(trial);
    REQUIRE(pair.count >= 1);
    REQUIRE(c.count >= 1);
    CHECK(deepest(c) == Approx(deepest(pair)).margin(2e-3));
  }
}

TEST_CASE("a box in the corner of a union touches floor and wall") {
  const std::vector<PlaneCollider<double>> planes = {
      PlaneCollider<double>::create(V(0, 0, 0), V(0, 0, 1), {0.3, 1}).value(),
      PlaneCollider<double>::create(V(0, 0, 0), V(1, 0, 0), {0.6, 2}).value()};
  const ColliderUnion<double, PlaneCollider<double>> both =
      ColliderUnion<double, PlaneCollider<double>>::create(planes).value();
  const Shape box = Shape::box(V(0.5, 0.5, 0.5)).value();
  const Contacts c = find_collider_contacts<double>(box, kUpright, V(0.5, 0, 0.5),
                                                    ColliderRef<double>(both), 0.01);
  REQUIRE(c.count == 8);
  CHECK(c.points[0].friction == 0.3);
  CHECK(c.points[7].friction == 0.6);
}

TEST_CASE("no allocation, and the same bits each time") {
  std::mt19937 random(8);
  const Shape A = some_shape(random, 3), B = some_shape(random, 2);
  const M R = rotation_exp<double>(direction(random));
  const PlaneCollider<double> plane = PlaneCollider<double>::create(V(0, 0, 0), V(0, 0, 1)).value();
  const bool counts = allocation_counting_works();
  const long before = allocations();
  const Contacts c = find_body_contacts<double>(A, R, V(0, 0, 0.6), B, kUpright, V(0, 0, 0), 0.01);
  const Contacts d = find_body_contacts<double>(A, R, V(0, 0, 0.6), B, kUpright, V(0, 0, 0), 0.01);
  const Contacts e =
      find_collider_contacts<double>(A, R, V(0, 0, 0.2), ColliderRef<double>(plane), 0.01);
  if (counts) CHECK(allocations() == before);
  CHECK(e.count > 0);
  REQUIRE(c.count == d.count);
  for (int i = 0; i < c.count; ++i) {
    const std::size_t k = static_cast<std::size_t>(i);
    CHECK(c.points[k].position == d.points[k].position);
    CHECK(c.points[k].feature == d.points[k].feature);
  }
}
