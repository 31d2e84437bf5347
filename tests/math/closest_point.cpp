// The closest points of segments and triangles.

#include "clothctl/math/closest_point.hpp"

#include "support/catch.hpp"
#include "support/meshes.hpp"

using namespace clothctl;
using clothctl_test::uniform;

namespace {

using V = Vector3<double>;

V any(std::mt19937& random, double size) {
  return {uniform(random, -size, size), uniform(random, -size, size), uniform(random, -size, size)};
}

}  // namespace

TEST_CASE("the closest point of a segment is its projection or an end", "[math]") {
  const V a(0, 0, 0), b(2, 0, 0);
  CHECK(closest_on_segment<double>({0.5, 3, 1}, a, b) == 0.25);
  CHECK(closest_on_segment<double>({-1, 3, 1}, a, b) == 0);
  CHECK(closest_on_segment<double>({5, 0, 1}, a, b) == 1);
  CHECK(closest_on_segment<double>({5, 0, 1}, a, a) == 0);
}

TEST_CASE("the closest point of a triangle is closer than any other", "[math]") {
  std::mt19937 random(1);
  for (int trial = 0; trial < 200; ++trial) {
    const std::array<V, 3> x{any(random, 1), any(random, 1), any(random, 1)};
    const V p = any(random, 2);
    const auto best = closest_on_triangle<double>(p, x);
    V place = V::Zero();
    double sum = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      CHECK(best.weights[i] >= 0);
      place += best.weights[i] * x[i];
      sum += best.weights[i];
    }
    CHECK(sum == Approx(1));
    CHECK((place - p).squaredNorm() == Approx(best.squared_distance));
    for (int sample = 0; sample < 100; ++sample) {
      double a = uniform(random, 0, 1), b = uniform(random, 0, 1);
      if (a + b > 1) {
        a = 1 - a;
        b = 1 - b;
      }
      const V other = (1 - a - b) * x[0] + a * x[1] + b * x[2];
      CHECK((other - p).squaredNorm() > best.squared_distance - 1e-12);
    }
  }
}

TEST_CASE("the closest point of a triangle without area is on a side", "[math]") {
  const std::array<V, 3> line{V(0, 0, 0), V(1, 0, 0), V(2, 0, 0)};
  CHECK(closest_on_triangle<double>({1.5, 1, 0}, line).squared_distance == Approx(1));
  const std::array<V, 3> point{V(1, 2, 3), V(1, 2, 3), V(1, 2, 3)};
  CHECK(closest_on_triangle<double>({1, 2, 5}, point).squared_distance == Approx(4));
}
