// The time of impact with a convex solid: exact where it is known, never late, and few steps beside
// a surface.

#include "clothctl/collision/detail/convex_sweep.hpp"

#include <cmath>

#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;

namespace {

/// The ball of radius 1 about the origin, and how often it was asked.
struct Ball {
  mutable int asked = 0;
  detail::NearestPoint<double> operator()(const V& x) const {
    ++asked;
    const double length = x.norm();
    return {length - 1, x / length, x / length};
  }
};

}  // namespace

TEST_CASE("a sweep onto a ball takes few steps", "[contact]") {
  const Ball ball;
  // The gap along x = s is √(s² + y²) - 1.
  for (const double y : {0.0, 0.3, 0.9, 0.999}) {
    ball.asked = 0;
    const double t = detail::convex_sweep<double>(ball, V(-3, y, 0), V(3, y, 0), 0.0);
    CHECK(std::abs(t - (3 - std::sqrt(1 - y * y)) / 6) <= 1e-12);
    CHECK(ball.asked <= 12);
  }
  ball.asked = 0;
  CHECK(detail::convex_sweep<double>(ball, V(-3, 1.0001, 0), V(3, 1.0001, 0), 0.0) ==
        no_impact<double>());
  CHECK(ball.asked <= 30);
}

TEST_CASE("a sweep ends at its latest time, and where the ball rests or leaves", "[contact]") {
  const Ball ball;
  const V a(-3, 0, 0), b(3, 0, 0);
  CHECK(detail::convex_sweep<double>(ball, a, b, 0.0, 0.3) == no_impact<double>());
  CHECK(detail::convex_sweep<double>(ball, a, b, 0.0, 0.34) == Approx(1.0 / 3));
  CHECK(detail::convex_sweep<double>(ball, a, a, 0.0) == no_impact<double>());
  CHECK(detail::convex_sweep<double>(ball, a, a, 2.0) == 0.0);
  CHECK(detail::convex_sweep<double>(ball, V(1.1, 0, 0), b, 0.0) == no_impact<double>());
  CHECK(detail::convex_sweep<double>(ball, V(1.1, 0, 0), b, 0.2) == 0.0);
}
