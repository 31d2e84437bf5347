// How long a window is suggested, and the search for one.

#include "clothctl/mpc/planner_settings.hpp"

#include <cmath>
#include <limits>
#include <vector>

#include "mpc/planner_loops.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("a window sees three quarters of the way of a swing down the sheet", "[mpc]") {
  CHECK(suggest_horizon(0.25, 0.02).value() == 12);
  CHECK(suggest_horizon(0.5, 0.02).value() == 17);
  CHECK(suggest_horizon(1.0, 0.02).value() == 24);
  CHECK(suggest_horizon(0.5, 0.01).value() == 34);
  CHECK(suggest_horizon(0.5, 0.02, 4 * 9.81).value() == 9);
  CHECK(suggest_horizon(1e-6, 0.02).value() == 1);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(suggest_horizon(nan, 0.02).error().find("hanging length is nan") != std::string::npos);
  CHECK(suggest_horizon(0.0, 0.02).error().find("hanging length is 0") != std::string::npos);
  CHECK(suggest_horizon(0.5, -0.02).error().find("dt is -0.02") != std::string::npos);
  CHECK(suggest_horizon(0.5, 0.02, nan).error().find("gravity") != std::string::npos);
  CHECK(suggest_horizon(0.5, 1e-9).error().find("10000") != std::string::npos);
}

TEST_CASE("a search stops at the first horizon that is accurate enough", "[mpc]") {
  std::vector<Index> tried;
  const auto error = [&](Index horizon) {
    tried.push_back(horizon);
    return horizon == 3 ? std::numeric_limits<double>::quiet_NaN()
                        : 1.0 / static_cast<double>(horizon);
  };
  HorizonSearch<double> found = search_horizon(1, 20, 2, 0.15, error);
  CHECK(found.horizon == 7);
  CHECK(found.accurate);
  CHECK(found.error == Approx(1.0 / 7));
  CHECK(tried == std::vector<Index>{1, 3, 5, 7});
  // Where none is accurate enough, the best one.
  found = search_horizon(1, 20, 2, 1e-3, [](Index k) { return std::abs(9.5 - double(k)); });
  CHECK(found.horizon == 9);
  CHECK(!found.accurate);
  CHECK(search_horizon(1, 20, 0, 1.0, error).horizon == 0);
  CHECK(search_horizon(0, 20, 1, 1.0, error).horizon == 0);
}

TEST_CASE("the suggested window is nearly as accurate as a much longer one", "[mpc]") {
  for (const double size : {0.25, 0.5}) {
    const auto sheet = clothctl_test::hanging_sheet(5, 1, 60, "handkerchief", size);
    const auto error = [&](Index horizon) {
      auto planner = clothctl_test::frozen_planner(
          sheet, clothctl_test::corner_setup(sheet),
          clothctl_test::corner_settings(sheet, GripInput::Pose, horizon));
      auto plant = clothctl_test::sheet_plant(sheet, Integration::LinearlyImplicit);
      return clothctl_test::run_loop(planner, plant, 100, clothctl_test::corners(sheet),
                                     clothctl_test::AsyncTarget(sheet, size / 0.5),
                                     clothctl_test::NoWind(), clothctl_test::NoWatch())
          .mean_error;
    };
    const Index suggested = suggest_horizon(size, 0.02).value();
    const double there = error(suggested), short_window = error(suggested / 3);
    CAPTURE(size, suggested, there, short_window, error(2 * suggested));
    CHECK(there < 1.3 * error(2 * suggested));
    CHECK(1.4 * there < short_window);
  }
}
