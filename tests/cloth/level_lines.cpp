#include "clothctl/cloth/detail/level_lines.hpp"

#include <algorithm>
#include <cstdlib>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

TEST_CASE("level lines: a level keeps both ends, and its weights reproduce every line",
          "[level_lines]") {
  for (int count = 2; count < 70; ++count) {
    for (const int spacing : {1, 2, 4, 8}) {
      for (const int shift : {0, spacing / 2}) {
        const LevelLines lines(count, spacing, shift);
        CHECK(lines.fine.front() == 0);
        CHECK(lines.fine.back() == count - 1);
        CHECK(std::is_sorted(lines.fine.begin(), lines.fine.end()));
        CHECK(std::adjacent_find(lines.fine.begin(), lines.fine.end()) == lines.fine.end());
        const LevelLines all(count, 1);
        REQUIRE(all.count() == count);
        for (int line = 0; line < count; ++line) {
          const LineParents<double> parents(all, lines, line);
          const auto at = [&](int i) {
            return i < lines.count() ? lines.fine[static_cast<std::size_t>(i)] : count - 1;
          };
          // The weights reproduce the line.
          const double sum =
              (1 - parents.second) * at(parents.first) + parents.second * at(parents.first + 1);
          CHECK(sum == Approx(line).margin(1e-12));
          CHECK((parents.second >= 0 && parents.second < 1));
          const int nearest = lines.nearest(line);
          for (int other : lines.fine)
            CHECK(std::abs(at(nearest) - line) <= std::abs(other - line));
        }
      }
    }
  }
}

TEST_CASE("level lines: the lines are evenly spaced, with a shift halfway between",
          "[level_lines]") {
  CHECK(LevelLines(9, 4).fine == std::vector<int>{0, 4, 8});
  CHECK(LevelLines(11, 4).fine == std::vector<int>{0, 4, 8, 10});
  CHECK(LevelLines(9, 4, 2).fine == std::vector<int>{0, 2, 6, 8});
  CHECK(LevelLines(3, 8, 4).fine == std::vector<int>{0, 2});
  CHECK(LevelLines(1, 1).fine == std::vector<int>{0});
  CHECK(LevelLines(9, 4).nearest(2) == 0);
  CHECK(LevelLines(9, 4).nearest(3) == 1);
}

TEST_CASE("level lines: between two levels, a line lies where both put it", "[level_lines]") {
  for (int count = 5; count < 60; ++count) {
    const LevelLines fine(count, 2, 1), coarse(count, 4, 2);
    for (int line = 0; line < fine.count(); ++line) {
      const LineParents<float> parents(fine, coarse, line);
      const auto at = [&](int i) {
        return static_cast<float>(i < coarse.count() ? coarse.fine[static_cast<std::size_t>(i)]
                                                     : 0);
      };
      CHECK((1.0f - parents.second) * at(parents.first) + parents.second * at(parents.first + 1) ==
            Approx(fine.fine[static_cast<std::size_t>(line)]));
    }
  }
}
