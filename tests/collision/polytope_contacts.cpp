// Parts of the contact of polytopes: closest points of segments, separating axes, clipping.

#include "clothctl/collision/detail/polytope_contacts.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "clothctl/math/rotation.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using V = Vector3<double>;
using M = Matrix3<double>;

TEST_CASE("closest points of segments beat sampled ones") {
  std::mt19937 random(4);
  const auto draw = [&] { return static_cast<double>(random()) / 4294967296.0 - 0.5; };
  for (int trial = 0; trial < 300; ++trial) {
    const V a(draw(), draw(), draw()), b(draw(), draw(), draw());
    V u(draw(), draw(), draw()), v(draw(), draw(), draw());
    if (trial % 10 == 1) v = 0.7 * u;
    if (trial % 10 == 2) u.setZero();
    if (trial % 10 == 3) v.setZero();
    const std::array<double, 2> st = closest_on_segments<double>(a, u, b, v);
    CHECK((st[0] >= 0 && st[0] <= 1 && st[1] >= 0 && st[1] <= 1));
    const double found = (a + st[0] * u - b - st[1] * v).norm();
    for (int i = 0; i <= 20; ++i) {
      for (int j = 0; j <= 20; ++j)
        REQUIRE(found <= (a + i / 20.0 * u - b - j / 20.0 * v).norm() + 1e-9);
    }
  }
}

TEST_CASE("separating axes of boxes") {
  const Polytope<double> box = box_polytope<double>(V(0.5, 0.5, 0.5));
  const M upright = M::Identity();
  const PosedPolytope<double> A(box, upright, V(0, 0, 0)), B(box, upright, V(0.3, 0, 1.2));
  const SeparatingAxis<double> face = best_face<double>(A, B, 1.0);
  CHECK(face.separation == Approx(0.2));
  CHECK((A.n(face.a) - V(0, 0, 1)).norm() < 1e-12);
  CHECK(best_edges<double>(A, B).a == -1);  // parallel edges have no cross product
  const PosedPolytope<double> C(box, rotation_exp<double>(V(std::acos(-1.0) / 4, 0, 0)),
                                V(0, 0, 0));
  const PosedPolytope<double> D(box, rotation_exp<double>(V(0, std::acos(-1.0) / 4, 0)),
                                V(0, 0, std::sqrt(2.0) + 0.1));
  const SeparatingAxis<double> edges = best_edges<double>(C, D);
  CHECK(edges.separation == Approx(0.1));
  CHECK((edges.axis - V(0, 0, 1)).norm() < 1e-12);
}

TEST_CASE("a clipped face keeps what lies above the other") {
  const Polytope<double> box = box_polytope<double>(V(0.5, 0.5, 0.5));
  const M upright = M::Identity();
  const PosedPolytope<double> A(box, upright, V(0, 0, 0)), B(box, upright, V(0.75, 0.25, 1));
  FaceClip<double> polygon(B, box.face_towards(V(0, 0, -1)));
  polygon.clip(A, box.face_towards(V(0, 0, 1)));
  REQUIRE(polygon.count() == 4);
  double area = 0;
  for (int k = 0; k < 4; ++k) {
    const V a = polygon.x(k), b = polygon.x((k + 1) % 4);
    area += 0.5 * std::abs((a - polygon.x(0)).cross(b - polygon.x(0))[2]);
    for (int l = 0; l < k; ++l) CHECK(polygon.feature(k) != polygon.feature(l));
  }
  CHECK(area == Approx(0.25 * 0.75));
  const PosedPolytope<double> away(box, upright, V(2, 0, 1));
  FaceClip<double> nothing(away, box.face_towards(V(0, 0, -1)));
  nothing.clip(A, box.face_towards(V(0, 0, 1)));
  CHECK(nothing.count() == 0);
}

TEST_CASE("tilted faces that overlap touch as faces") {
  const Polytope<double> box = box_polytope<double>(V(0.5, 0.5, 0.5));
  const PosedPolytope<double> A(box, rotation_exp<double>(V(0.01, 0.02, 0.8)), V(0, 0, 0.96));
  const PosedPolytope<double> B(box, M::Identity(), V(0, 0, 0));
  BodyContacts<double> out;
  polytope_contacts<double>(A, B, 0.01, 0.5, out);
  CHECK(out.count == 4);
}
