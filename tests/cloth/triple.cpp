#include "clothctl/cloth/detail/triple.hpp"

#include <cmath>
#include <cstring>
#include <limits>
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

TEST_CASE("triples read and write rows of coordinates", "[cloth]") {
  Lanes<double, 1> row(1, 6);
  row << 1, 2, 3, 4, 5, 6;
  CHECK(same_bits<double>(point(row, 1), Vector3<double>(4, 5, 6)));
  set_point(row, 0, {7.0, 8.0, 9.0});
  CHECK(as_points(row).col(0) == Vector3<double>(7, 8, 9));
  CHECK(as_points(row).data() == row.data());
}

TEST_CASE("points move along a direction, in place too", "[cloth]") {
  Points<double> x(3, 2), v(3, 2), out(3, 2);
  x << 1, 2, 3, 4, 5, 6;
  v << 1, 0, -1, 2, 0, 4;
  move_along(x, 0.5, v, out);
  CHECK(out == x + 0.5 * v);
  move_along(x, -1.0, v, x);
  CHECK(x == out - 1.5 * v);
}

TEST_CASE("the largest magnitude of an entry skips what is not a number", "[cloth]") {
  Points<double> x(3, 2);
  x << 1, -7, 3, 4, 5, 6;
  CHECK(largest_magnitude(x) == 7.0);
  x(0, 1) = std::numeric_limits<double>::quiet_NaN();
  CHECK(largest_magnitude(x) == 6.0);
  CHECK(largest_magnitude(Points<double>(3, 0)) == 0.0);
}
