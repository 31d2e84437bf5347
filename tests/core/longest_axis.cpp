#include "clothctl/core/longest_axis.hpp"

#include <algorithm>
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

TEST_CASE("the halves along the longest axis are equal, and ties go by number", "[longest_axis]") {
  Points<double> points(3, 5);
  points << 0, 0, 0, 0, 0, 4, 1, 3, 1, 0, 0, 0, 0, 0, 0;
  std::vector<int> order{4, 0, 1, 2, 3};
  CHECK(split_along_longest_axis(points, order, 0, 5) == 2);
  std::sort(order.begin(), order.begin() + 2);
  CHECK(order[0] == 1);  // of 1 and 3, which are at the same place, the first
  CHECK(order[1] == 4);
  std::vector<int> part{0, 1, 2, 3, 4};
  CHECK(split_along_longest_axis(points, part, 0, 3) == 1);
  CHECK(part[0] == 1);
  CHECK(part[3] == 3);  // the rest keeps its order
  CHECK(part[4] == 4);
}
