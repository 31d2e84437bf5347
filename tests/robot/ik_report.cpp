#include "clothctl/robot/ik_report.hpp"

#include <cmath>

#include "support/catch.hpp"

using namespace clothctl::robot;

TEST_CASE("settings of inverse kinematics name the first bad value", "[robot]") {
  const IkSettings<double> good;
  CHECK(good.check().empty());
  IkSettings<double> settings = good;
  settings.tolerance = -1.0;
  CHECK(settings.check() == "tolerance is not a positive length");
  settings = good;
  settings.gradient_tolerance = std::nan("");
  CHECK(settings.check() == "gradient_tolerance is not a positive number");
  settings = good;
  settings.posture_weight = -1e-9;
  CHECK(settings.check() == "posture_weight is negative or not finite");
  settings = good;
  settings.damping = 0.0;
  CHECK(settings.check() == "damping is not a positive number");
  settings = good;
  settings.max_iterations = 0;
  CHECK(settings.check() == "max_iterations is less than 1");
}

TEST_CASE("the gradient's tolerance leaves room for rounding", "[robot]") {
  CHECK(IkSettings<double>().gradient_tolerance == 1e-6);
  CHECK(IkSettings<float>().gradient_tolerance == Approx(4 * std::sqrt(clothctl::scalar_traits<float>::epsilon())));
}

TEST_CASE("every reason to stop has a name of its own", "[robot]") {
  CHECK(to_string(IkStatus::Reached) == "reached");
  CHECK(to_string(IkStatus::LocalMinimum) == "local_minimum");
  CHECK(to_string(IkStatus::Stalled) == "stalled");
  CHECK(to_string(IkStatus::IterationLimit) == "iteration_limit");
  CHECK(to_string(IkStatus::InvalidInput) == "invalid_input");
}
