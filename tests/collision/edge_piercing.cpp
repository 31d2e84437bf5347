// Edges that pierce triangles: random cases against exact intersections, and edges that pass
// exactly through a shared side or a corner of a mesh.

#include "clothctl/collision/detail/edge_piercing.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>

#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;

namespace {

double draw(std::mt19937& random) { return 2 * static_cast<double>(random()) / 4294967296.0 - 1; }

}  // namespace

TEMPLATE_TEST_CASE("an edge pierces a triangle when the cut lies inside", "[self_contact]", float,
                   double) {
  using S = TestType;
  std::mt19937 random(21);
  int pierced = 0;
  for (int trial = 0; trial < clothctl_test::trials(5000, 200000, 200); ++trial) {
    Points<S> x(3, 5);
    for (Index i = 0; i < x.size(); ++i) x(i) = static_cast<S>(draw(random));
    const DenseMatrix<long double, 3, 5> y = x.template cast<long double>();
    DenseMatrix<long double, 3, 3> system;
    system << y.col(1) - y.col(0), y.col(2) - y.col(0), y.col(3) - y.col(4);
    const DenseMatrix<long double, 3, 1> s = system.fullPivLu().solve(y.col(3) - y.col(0));
    const long double inside = std::min({s[0], s[1], 1 - s[0] - s[1], s[2], 1 - s[2]});
    if (std::abs(inside) < 1e-5L) continue;
    const bool expected = inside > 0;
    CHECK(detail::edge_pierces<S>(x, {3, 4}, {0, 1, 2}) == expected);
    CHECK(detail::edge_pierces<S>(x, {4, 3}, {1, 0, 2}) == expected);
    CHECK(detail::edge_pierces<S>(x, {4, 3}, {2, 0, 1}) == expected);
    pierced += expected;
  }
  CHECK(pierced > 5);
}

TEST_CASE("no edge slips between triangles that share a side", "[self_contact]") {
  // A fan of six triangles about vertex 0; edges whose cut is on sides. (At the centre, rounding
  // decides six volumes one by one.)
  std::mt19937 random(22);
  for (int trial = 0; trial < clothctl_test::trials(2000, 50000, 100); ++trial) {
    Points<double> x(3, 9);
    x.col(0).setZero();
    for (int i = 0; i < 6; ++i) {
      x.col(i + 1) << std::cos(i * 1.0471975511965976), std::sin(i * 1.0471975511965976), 0;
    }
    const double share = 0.05 + 0.4 * (draw(random) + 1);
    const Vector3<double> cut = share * x.col(1 + trial % 6);
    const Vector3<double> way(draw(random), draw(random), 1);
    x.col(7) = cut + way;
    x.col(8) = cut - 0.5 * way;
    int count = 0;
    for (int i = 0; i < 6; ++i)
      count += detail::edge_pierces<double>(x, {7, 8}, {0, 1 + i, 1 + (i + 1) % 6});
    CHECK(count % 2 == 1);
  }
}

TEST_CASE("the sign of a volume follows the order", "[self_contact]") {
  Points<double> x(3, 4);
  x << 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1;
  CHECK(detail::positive_volume<double>(x, {0, 1, 2, 3}) !=
        detail::positive_volume<double>(x, {1, 0, 2, 3}));
  CHECK(detail::positive_volume<double>(x, {0, 1, 2, 3}) ==
        detail::positive_volume<double>(x, {1, 2, 0, 3}));
  x(2, 3) = 0;
  CHECK(detail::positive_volume<double>(x, {0, 1, 2, 3}));
  CHECK_FALSE(detail::positive_volume<double>(x, {1, 0, 2, 3}));
}
