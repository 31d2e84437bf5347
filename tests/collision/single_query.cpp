// Queries of one point: the answers of the batch, without allocation, for any collider.

#include "clothctl/collision/detail/single_query.hpp"

#include <limits>

#include "archetypes/collider.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("a single query asks for one point", "[contact]", float, double) {
  using S = TestType;
  const clothctl_test::ColliderArchetype<S> ground(1);
  const Vector3<S> x(S(1), S(2), S(0.5)), below(S(1), S(2), S(-0.5));
  const long before = clothctl_test::allocations();
  const S d = detail::distance_of<S>(ground, x);
  const SurfacePoint<S> s = detail::closest_of<S>(ground, x);
  const S t = detail::sweep_of<S>(ground, x, below, S(0.25), S(0));
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(d == S(0.5));
  CHECK(s.distance == S(0.5));
  CHECK(s.point == Vector3<S>(S(1), S(2), S(0)));
  CHECK(t == S(0.25));
}

TEST_CASE("a single query without an answer says so", "[contact]") {
  const clothctl_test::ColliderArchetype<double> ground(1);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Vector3<double> x(0, nan, 0);
  CHECK(is_unbounded(detail::distance_of<double>(ground, x)));
  CHECK(detail::closest_of<double>(ground, x).body == -1);
  SurfacePoint<double> out;
  out.body = 3;
  CHECK(detail::ask_closest<double>(ground, x, out) == QueryStatus::InvalidPoint);
  CHECK(out.body == -1);
  CHECK(detail::sweep_of<double>(ground, x, x, 0.0, 0.0) == no_impact<double>());
}
