// Unions: the laws, the least distance of the parts, parts of several types, and what is refused.

#include "clothctl/collision/collider_union.hpp"

#include <random>

#include "archetypes/collider.hpp"
#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/collision/shapes.hpp"
#include "laws/collider_laws.hpp"
#include "support/catch.hpp"
#include "support/solids.hpp"

using namespace clothctl;
using clothctl_test::exact_laws;
using clothctl_test::uniform;
using clothctl_test::law_detail::one_closest;
using clothctl_test::law_detail::one_distance;

TEMPLATE_TEST_CASE("unions obey the laws", "[contact]", float, double) {
  using S = TestType;
  using Ball = SphereCollider<S>;
  auto laws = exact_laws<S>(S(1));
  laws.exact_inside = false;
  const auto balls =
      ColliderUnion<S, Ball>::create(
          {Ball::create(Vector3<S>(S(0.2), S(0), S(0)), S(0.3)).value(),
           Ball::create(Vector3<S>(S(-0.2), S(0.1), S(0)), S(0.4), {S(0.1), 5}).value()})
          .value();
  check_collider_laws<S>(balls, laws);
  CHECK(one_closest<S>(balls, Vector3<S>(S(-1), S(0), S(0))).body == 5);
  CHECK(one_closest<S>(balls, Vector3<S>(S(-1), S(0), S(0))).friction == S(0.1));
  const auto box =
      BoxCollider<S>::create(Vector3<S>::Zero(), Vector3<S>(S(0.5), S(0.2), S(0.1))).value();
  const auto ball = Ball::create(Vector3<S>(S(0.5), S(0.3), S(0)), S(0.2)).value();
  const auto mixed = ColliderUnion<S>::create({ColliderRef<S>(box), ColliderRef<S>(ball)}).value();
  check_collider_laws<S>(mixed, laws);
  CHECK(mixed.part_count() == 2);
  CHECK(mixed.part(0).is_convex());
  CHECK_FALSE(ColliderRef<S>(mixed).is_convex());
  CHECK(ColliderRef<S>(mixed).part_count() == 2);
}

TEST_CASE("a union needs no more from its parts than the concept names", "[contact]") {
  const clothctl_test::ColliderArchetype<double> ground(1);
  const auto ball = SphereCollider<double>::create(Vector3<double>(0, 0, 0.1), 0.2).value();
  const auto both =
      ColliderUnion<double>::create({ColliderRef<double>(ground), ColliderRef<double>(ball)})
          .value();
  std::mt19937 random(51);
  for (int i = 0; i < 200; ++i) {
    const Vector3<double> x(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1));
    const double expected = std::min(x[2], one_distance<double>(ball, x));
    CHECK(one_distance<double>(both, x) == expected);
  }
}

TEST_CASE("parts of a union may move", "[contact]") {
  using Moving = MovingCollider<double, SphereCollider<double>>;
  const auto ball = SphereCollider<double>::create(Vector3<double>::Zero(), 0.1).value();
  RigidMotion<double> m;
  m.position = Vector3<double>(1, 0, 0);
  auto hand = ColliderUnion<double, Moving>::create(
                  {Moving::create(ball, {}).value(), Moving::create(ball, m, {0.5, 1}).value()})
                  .value();
  m.velocity = Vector3<double>(0, 0, 10);
  CHECK(hand.parts()[1].set_motion(m).empty());
  const auto s = one_closest<double>(hand, Vector3<double>(1, 0, 1));
  CHECK(s.body == 1);
  CHECK(s.velocity == Vector3<double>(0, 0, 10));
  Points<double> x(3, 1);
  x << 1, 0, 1;
  VectorX<double> t(1);
  CHECK(hand.sweep(x, x, 0, 0.1, t) == QueryStatus::Answered);
  CHECK(t[0] == Approx(0.9));
}

TEST_CASE("a union without parts, or with a part without a box, is refused", "[contact]") {
  CHECK(ColliderUnion<double>::create({}).error() == "the union has no parts");
  struct Boxless : clothctl_test::ColliderArchetype<double> {
    Boxless() : ColliderArchetype<double>(1) {}
    BoundingBox<double> bounds(double) const {
      return {Vector3<double>(0, 1, 0), Vector3<double>(0, 0, 0)};
    }
  };
  const Boxless bad;
  const clothctl_test::ColliderArchetype<double> ground(1);
  CHECK(ColliderUnion<double>::create({ColliderRef<double>(ground), ColliderRef<double>(bad)})
            .error() == "part 1 of the union has no box");
}
