#include "clothctl/cloth/detail/triple.hpp"

#include <cmath>
#include <cstring>
#include <random>

#include <Eigen/Geometry>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

template <class Scalar>
bool same_bits(const Triple<Scalar>& a, const Vector3<Scalar>& b) {
  return std::memcmp(&a, b.data(), sizeof a) == 0;
}

}  // namespace

TEMPLATE_TEST_CASE("triples compute the same as Eigen's vectors", "[cloth]", float, double) {
  using S = TestType;
  std::mt19937 random(3);
  std::uniform_real_distribution<S> uniform(S(-1), S(1));
  for (int k = 0; k < 200; ++k) {
    const Vector3<S> u(uniform(random), uniform(random), uniform(random));
    const Vector3<S> v(uniform(random), uniform(random), uniform(random));
    const S f = uniform(random);
    const Triple<S> a = triple(u), b = triple(v);
    CHECK(same_bits<S>(a + b, u + v));
    CHECK(same_bits<S>(a - b, u - v));
    CHECK(same_bits<S>(a * f, u * f));
    CHECK(same_bits<S>(a / f, u / f));
    const S tolerance = S(4) * scalar_traits<S>::epsilon();
    CHECK(std::abs(dot(a, b) - u.dot(v)) <= tolerance);
    CHECK(std::abs(squared_norm(a) - u.squaredNorm()) <= tolerance);
    const Triple<S> c = cross(a, b);
    CHECK((Vector3<S>(c.x, c.y, c.z) - u.cross(v)).norm() <= tolerance);
    const Matrix3<S> m = Matrix3<S>::NullaryExpr([&](Index, Index) { return uniform(random); });
    CHECK(same_bits<S>(product(m, a), Vector3<S>(m * u)));
  }
}

TEST_CASE("triples read and write columns", "[cloth]") {
  Points<double> points(3, 2);
  points << 1, 2, 3, 4, 5, 6;
  CHECK(same_bits<double>(column(points, 1), points.col(1)));
  set_column(points, 0, {7.0, 8.0, 9.0});
  add_to_column(points, 0, {1.0, 1.0, 1.0});
  subtract_from_column(points, 1, {2.0, 4.0, 6.0});
  CHECK(points.col(0) == Vector3<double>(8, 9, 10));
  CHECK(points.col(1).isZero(0.0));
}
