// The closest point of a triangle: against long double, for thin triangles and far points, and the
// features that it names.

#include "clothctl/collision/detail/triangle_point.hpp"

#include <cmath>
#include <limits>
#include <random>

#include "support/catch.hpp"
#include "support/solids.hpp"

using namespace clothctl;
using clothctl_test::uniform;
using detail::TriangleFeature;

TEMPLATE_TEST_CASE("distances from triangles are exact to rounding", "[contact]", float, double) {
  using S = TestType;
  std::mt19937 random(81);
  double worst = 0, orthogonal = 0;
  for (int i = 0; i < 4000; ++i) {
    const double thin = std::pow(10.0, uniform(random, -4, 0));
    Points<S> x(3, 4);
    for (Index k = 0; k < 12; ++k) x(k) = S(uniform(random, -1, 1));
    // The third corner moves onto the line of the first two.
    x.col(2) =
        x.col(0) + S(uniform(random, -0.5, 1.5)) * (x.col(1) - x.col(0)) + S(thin) * x.col(2);
    if (i % 3 == 0) x.col(3) = x.col(0) + S(0.1) * x.col(3);
    if (i % 3 == 1) {  // over the inside, where the normal of a thin triangle decides
      const double u = uniform(random, 0, 1), v = uniform(random, 0, 1 - u);
      const Points<double> t = x.template cast<double>();
      const Vector3<double> ab = t.col(1) - t.col(0), ac = t.col(2) - t.col(0);
      const Vector3<double> over =
          t.col(0) + u * ab + v * ac + uniform(random, -1, 1) * ab.cross(ac).normalized();
      x.col(3) = over.cast<S>();
    }
    const detail::PreparedTriangle<S> triangle(x.col(0), x.col(1), x.col(2));
    const auto q = triangle.closest(x.col(3));
    const auto wide = [&](Index k) {
      return clothctl_test::LongVector(x.col(k).template cast<long double>());
    };
    const auto exact =
        static_cast<double>(clothctl_test::triangle_distance(wide(3), wide(0), wide(1), wide(2)));
    worst = std::max(worst, std::abs(std::sqrt(static_cast<double>(q.square)) - exact));
    orthogonal =
        std::max(orthogonal, std::abs(static_cast<double>(q.offset.squaredNorm() - q.square)));
  }
  CHECK(worst <= 8 * static_cast<double>(std::numeric_limits<S>::epsilon()));
  CHECK(orthogonal <= 1e2 * static_cast<double>(std::numeric_limits<S>::epsilon()));
}

TEST_CASE("the feature of the closest point is named", "[contact]") {
  using V = Vector3<double>;
  const detail::PreparedTriangle<double> triangle(V(0, 0, 0), V(1, 0, 0), V(0, 1, 0));
  const auto feature = [&](const V& x) { return triangle.closest(x).feature; };
  CHECK(feature(V(0.2, 0.3, 1)) == TriangleFeature::Face);
  CHECK(feature(V(0.2, 0.3, -1)) == TriangleFeature::Face);
  CHECK(feature(V(-1, -1, 1)) == TriangleFeature::Corner0);
  CHECK(feature(V(3, 0.5, 0)) == TriangleFeature::Corner1);
  CHECK(feature(V(-0.5, 3, 0)) == TriangleFeature::Corner2);
  CHECK(feature(V(0.4, -1, 1)) == TriangleFeature::Side0);
  CHECK(feature(V(1, 1, 1)) == TriangleFeature::Side1);
  CHECK(feature(V(-1, 0.4, 1)) == TriangleFeature::Side2);
  CHECK(triangle.closest(V(0.2, 0.3, -2)).offset == V(0, 0, -2));
  // A triangle without area counts as its sides.
  const detail::PreparedTriangle<double> line(V(0, 0, 0), V(1, 0, 0), V(2, 0, 0));
  CHECK(line.closest(V(1.5, 0, 1)).square == 1.0);
  const detail::PreparedTriangle<double> point(V(1, 1, 1), V(1, 1, 1), V(1, 1, 1));
  CHECK(point.closest(V(1, 1, 3)).square == 4.0);
}
