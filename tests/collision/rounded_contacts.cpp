// Parts of the contacts of spheres and capsules: crossing and parallel cores, depth inside of a
// polytope, and the two points of a capsule on a face.

#include "clothctl/collision/detail/rounded_contacts.hpp"

#include <Eigen/Dense>
#include <cmath>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using V = Vector3<double>;
using M = Matrix3<double>;
using Segment = RoundedSegment<double>;

TEST_CASE("cores that cross or coincide have a normal") {
  const Segment x{V(-1, 0, 0), V(2, 0, 0), 0.1}, y{V(0, -1, 0), V(0, 2, 0), 0.2};
  const Segment point{V(0, 0, 0), V(0, 0, 0), 0.3};
  for (const Segment* A : {&x, &y, &point}) {
    for (const Segment* B : {&x, &y, &point}) {
      BodyContacts<double> out;
      segment_contacts<double>(*A, *B, 0.01, out);
      REQUIRE(out.count >= 1);
      for (int i = 0; i < out.count; ++i) {
        const BodyContactPoint<double>& p = out.points[static_cast<std::size_t>(i)];
        CHECK(p.normal.norm() == Approx(1));
        CHECK(p.gap == Approx(-A->radius - B->radius));
        if (A->u.norm() > 0) CHECK(std::abs(p.normal.dot(A->u)) < 1e-12);
      }
    }
  }
}

TEST_CASE("parallel capsules touch at both ends of the stretch that they share") {
  const Segment A{V(0, 0, 0.3), V(2, 0, 0), 0.1}, B{V(3, 0, 0), V(-2, 0, 0), 0.2};
  BodyContacts<double> out;
  segment_contacts<double>(A, B, 0.01, out);
  REQUIRE(out.count == 2);
  CHECK(out.points[0].position[0] == Approx(1));
  CHECK(out.points[1].position[0] == Approx(2));
  CHECK(out.points[0].gap == Approx(0).margin(1e-12));
}

TEST_CASE("a capsule in a box is as deep as the nearest face") {
  const Polytope<double> box = box_polytope<double>(V(1, 1, 1));
  const PosedPolytope<double> P(box, M::Identity(), V(0, 0, 0));
  const Segment S{V(-0.2, 0, 0.7), V(0.4, 0, 0), 0.1};
  for (const bool flip : {false, true}) {
    BodyContacts<double> out;
    SegmentOnPolytope<double>(S, P).add(0.01, 0.1, flip, out);
    REQUIRE(out.count == 2);
    for (std::size_t i = 0; i < 2; ++i) {
      CHECK(out.points[i].gap == Approx(-0.4));
      CHECK((out.points[i].normal - V(0, 0, flip ? -1 : 1)).norm() < 1e-12);
    }
  }
}

TEST_CASE("a capsule over an edge has one point; one that overhangs a face has two") {
  const Polytope<double> box = box_polytope<double>(V(1, 1, 1));
  const PosedPolytope<double> P(box, M::Identity(), V(0, 0, 0));
  const V out_of_edge = V(1, 0, 1).normalized();
  const Segment over{V(1, -3, 1) + 0.105 * out_of_edge + 0.0 * V(0, 1, 0), V(0, 2.5, 0), 0.1};
  const Segment across{V(1, 0, 1) + 0.105 * out_of_edge - V(0.5, 0, -0.5), V(1, 0, -1), 0.1};
  BodyContacts<double> one;
  SegmentOnPolytope<double>(across, P).add(0.01, 0.1, false, one);
  REQUIRE(one.count == 1);
  CHECK(one.points[0].gap == Approx(0.005));
  CHECK((one.points[0].normal - out_of_edge).norm() < 1e-9);
  BodyContacts<double> along;
  SegmentOnPolytope<double>(over, P).add(0.01, 0.1, false, along);
  CHECK(along.count == 1);
  const Segment overhang{V(-3, 0, 1.1), V(6, 0, 0), 0.1};
  BodyContacts<double> two;
  SegmentOnPolytope<double>(overhang, P).add(0.01, 0.1, false, two);
  REQUIRE(two.count == 2);
  CHECK(std::abs(two.points[0].position[0]) == Approx(1));
}
