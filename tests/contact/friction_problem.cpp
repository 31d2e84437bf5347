// The cone, its projection, and the natural map of contact problems.

#include "clothctl/contact/detail/friction_problem.hpp"

#include <limits>

#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("the projection to the cone is the closest point", "[contact]", float, double) {
  using S = TestType;
  clothctl_test::Numbers random(1);
  const S tolerance = S(8) * scalar_traits<S>::epsilon();
  for (int k = 0; k < 500; ++k) {
    Vector3<S> x;
    for (Index i = 0; i < 3; ++i) x[i] = static_cast<S>(random(-1, 1));
    const S mu = k % 7 == 0 ? S(0) : static_cast<S>(random(0, 2));
    const Vector3<S> p = detail::project_to_cone<S>(x, mu), away = x - p;
    // p is in the cone, x - p in its polar cone, and they are orthogonal (Moreau).
    CHECK(detail::tangential_length<S>(p) <= mu * p[0] + tolerance);
    CHECK(mu * detail::tangential_length<S>(away) <= -away[0] + tolerance);
    CHECK(std::abs(p.dot(away)) <= tolerance);
  }
}

TEST_CASE("the natural map vanishes at solutions only", "[contact]") {
  detail::FrictionProblem<double> problem;
  problem.reserve(2);
  problem.resize(2);
  problem.D().diagonal() << 2, 1, 1, 4, 4, 4;
  problem.b() << -1, 3, 0, 0.5, 0, 0;
  problem.friction(0) = 0.5;
  problem.friction(1) = 1;
  REQUIRE(problem.prepare() == -1);
  VectorX<double> lambda(6), u(6);
  lambda << 0.5, -0.25, 0, 0, 0, 0;  // slips; open
  problem.velocities(lambda, u);
  CHECK(u[1] == Approx(2.75));
  auto r = problem.residual(lambda, u, 1e-12, 1e-12);
  CHECK(r.impulse < 1e-15);
  CHECK(r.excess <= 1);
  lambda[0] = 0.4;
  problem.velocities(lambda, u);
  r = problem.residual(lambda, u, 1e-12, 1e-12);
  CHECK(r.impulse > 0.05);
  CHECK(r.velocity == Approx(2 * r.impulse));  // ρ is one over the largest entry, 2
  CHECK(r.excess > 1);
  lambda[0] = std::numeric_limits<double>::quiet_NaN();
  problem.velocities(lambda, u);
  CHECK(is_unbounded(problem.residual(lambda, u, 1e-12, 1e-12).excess));
}

TEST_CASE("contacts that nothing moves are named", "[contact]") {
  detail::FrictionProblem<double> problem;
  problem.reserve(2);
  CHECK(problem.capacity() == 2);
  problem.resize(2);
  problem.D().diagonal() << 2, 1, 1, 4, 0, 0;
  CHECK(problem.prepare() == -1);  // without friction the tangents do not matter
  problem.friction(1) = 0.1;
  CHECK(problem.prepare() == 1);
  problem.D().diagonal() << 0, 1, 1, 4, 1, 1;
  CHECK(problem.prepare() == 0);
}
