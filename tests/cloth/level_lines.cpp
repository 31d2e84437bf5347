#include "clothctl/cloth/detail/level_lines.hpp"

#include <cmath>

#include "support/catch.hpp"

using namespace clothctl;
using detail::LevelLines;
using detail::LineParents;

TEST_CASE("lines of a level: every s-th and the last, or shifted", "[cloth][levels]") {
  CHECK(LevelLines(9, 2).fine == std::vector<int>{0, 2, 4, 6, 8});
  CHECK(LevelLines(8, 2).fine == std::vector<int>{0, 2, 4, 6, 7});
  CHECK(LevelLines(8, 4, 2).fine == std::vector<int>{0, 2, 6, 7});
  CHECK(LevelLines(1, 2).fine == std::vector<int>{0});
}

TEST_CASE("the nearest line is the nearest by distance, the smaller of two", "[cloth][levels]") {
  for (int count : {5, 8, 17, 33}) {
    for (int spacing : {1, 2, 4, 8}) {
      const LevelLines lines(count, spacing, spacing / 2);
      for (int line = 0; line < count; ++line) {
        int best = 0;
        for (int i = 0; i < lines.count(); ++i) {
          const auto away = [&](int j) {
            return std::abs(lines.fine[static_cast<std::size_t>(j)] - line);
          };
          if (away(i) < away(best)) best = i;
        }
        CAPTURE(count, spacing, line);
        CHECK(lines.nearest(line) == best);
      }
    }
  }
}

TEST_CASE("parents of a line enclose it, and their weights give its place", "[cloth][levels]") {
  for (int count : {8, 9, 30, 65}) {
    for (int spacing : {2, 4, 8}) {
      const LevelLines fine(count, spacing / 2), coarse(count, spacing, spacing / 2);
      for (int line = 0; line < fine.count(); ++line) {
        const LineParents<double> parents(fine, coarse, line);
        const std::size_t first = static_cast<std::size_t>(parents.first);
        const double from = coarse.fine[first];
        const double to = first + 1 < coarse.fine.size() ? coarse.fine[first + 1] : from;
        CAPTURE(count, spacing, line, parents.first, parents.second);
        CHECK(parents.second >= 0.0);
        CHECK(parents.second < 1.0);
        CHECK(from + parents.second * (to - from) ==
              Approx(fine.fine[static_cast<std::size_t>(line)]).epsilon(1e-14));
      }
    }
  }
}
