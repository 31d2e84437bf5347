#include "clothctl/core/longest_axis.hpp"

#include <vector>

#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("the longest axis is that of the given points alone", "[longest_axis]", float,
                   double, long double) {
  Points<TestType> points(3, 5);
  points << 0, 1, 2, 3, 9, -1, 4, 0, 0, 0, 5, 5, 5, 7, -90;
  CHECK(longest_axis(points, std::vector<int>{0, 1, 2, 3, 4}) == 2);
  CHECK(longest_axis(points, std::vector<int>{0, 1, 2, 3}) == 1);
  CHECK(longest_axis(points, std::vector<int>{2, 3}) == 2);
  CHECK(longest_axis(points, std::vector<int>{0, 2}) == 0);
  CHECK(longest_axis(PointsView<TestType>(points), std::vector<int>{3, 2, 0}) == 0);
}

TEST_CASE("of equal extents the first axis counts", "[longest_axis]") {
  Points<double> points(3, 3);
  points << 0, 1, 1, 0, 1, 1, 0, 0.5, 0.5;
  CHECK(longest_axis(points, std::vector<int>{0, 1}) == 0);
  CHECK(longest_axis(points, std::vector<int>{1, 2}) == 0);
  CHECK(longest_axis(points, std::vector<int>{2}) == 0);
  CHECK(longest_axis(points, std::vector<int>{}) == 0);
}
