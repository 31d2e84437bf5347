// The direction in which a crossing becomes shorter: against the length of the cut after a small
// motion.

#include "clothctl/contact/detail/contour_push.hpp"

#include <cmath>
#include <vector>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// A large triangle 0 1 2 in the plane z = 0, and a triangle 3 4 5 that an edge 3 4 takes through.
Points<double> pierced() {
  Points<double> x(3, 6);
  x.col(0) << -5, -5, 0;
  x.col(1) << 5, -5, 0;
  x.col(2) << 0, 9, 0;
  x.col(3) << 0, 0, -0.4;
  x.col(4) << 0.2, 0, 0.6;
  x.col(5) << 1, 0.3, 0.5;
  return x;
}

/// The length of the cut of the triangle 3 4 5 with the plane z = 0.
double cut(const Points<double>& x) {
  std::vector<Vector3<double>> ends;
  for (int i = 3; i < 6; ++i) {
    const Vector3<double> p = x.col(i), q = x.col(i == 5 ? 3 : i + 1);
    if (p[2] * q[2] < 0) ends.push_back(p + p[2] / (p[2] - q[2]) * (q - p));
  }
  return ends.size() == 2 ? (ends[0] - ends[1]).norm() : 0;
}

}  // namespace

TEST_CASE("a contour row is the rate at which the cut becomes shorter", "[self_contact]") {
  const Points<double> x = pierced();
  const auto first = detail::contour_row<double>(x, {3, 4}, {0, 1, 2}, {5, -1});
  const auto second = detail::contour_row<double>(x, {3, 5}, {0, 1, 2}, {4, -1});
  const auto full = [](const detail::PairRow<double>& row) {
    const double square = row.normal.squaredNorm();
    return Vector3<double>(row.normal / std::sqrt(1 - square));
  };
  // Both ends of the cut move with the triangle.
  const Vector3<double> rate = full(first) + full(second);
  for (int i = 0; i < 3; ++i) {
    Points<double> moved = x;
    moved.rightCols(3).row(i).array() += 1e-6;
    CHECK((cut(x) - cut(moved)) / 1e-6 == Approx(rate[i]).margin(1e-4));
  }
  CHECK(first.normal.norm() < 1);
  double sum = 0;
  for (const double w : first.weight) sum += w;
  CHECK(std::abs(sum) <= 1e-15);
  CHECK(first.weight[1] == Approx(0.4));
}

TEST_CASE("a straight contour through an edge pulls nowhere", "[self_contact]") {
  Points<double> x(3, 7);
  x.leftCols(6) = pierced();
  x.col(6) = x.col(3) + x.col(4) - x.col(5);
  const auto row = detail::contour_row<double>(x, {3, 4}, {0, 1, 2}, {5, 6});
  CHECK(row.normal.norm() <= 1e-12);
  // Threads have no contour.
  CHECK(detail::contour_row<double>(x, {3, 4}, {0, 1, 2}, {-1, -1}).normal.norm() == 0);
}

TEST_CASE("a tip goes back to the side of its edge", "[self_contact]") {
  const Points<double> x = pierced();
  const auto up = detail::tip_row<double>(x, 3, 4, {0, 1, 2});
  CHECK(up.normal[2] == 1);
  CHECK(up.vertex == std::array<int, 4>{3, 0, 1, 2});
  CHECK(detail::tip_row<double>(x, 4, 3, {0, 1, 2}).normal[2] == -1);
  double sum = 0;
  for (const double w : up.weight) sum += w;
  CHECK(sum == 0);
}
