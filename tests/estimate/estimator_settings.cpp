// Settings are refused by name and value.

#include "clothctl/estimate/estimator_settings.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("estimator settings: the defaults are good", "[estimate]") {
  CHECK(EstimatorSettings<double>().validate().empty());
  CHECK(EstimatorSettings<float>().validate().empty());
}

TEST_CASE("estimator settings: a bad one is named with its value", "[estimate]") {
  const auto line = [](auto change) {
    EstimatorSettings<double> settings;
    change(settings);
    return settings.validate();
  };
  CHECK(line([](auto& s) { s.dt = 0; }) == "dt is 0, must be positive and finite");
  CHECK(line([](auto& s) { s.noise = -0.002; }) == "noise is -0.002, must be positive and finite");
  CHECK(line([](auto& s) { s.acceleration = std::numeric_limits<double>::quiet_NaN(); }) ==
        "acceleration is nan, must be positive and finite");
  CHECK(line([](auto& s) { s.correlation = std::numeric_limits<double>::infinity(); }) ==
        "correlation is inf, must be positive and finite");
  CHECK(line([](auto& s) { s.gate = 0; }) == "gate is 0, must be positive and finite");
  CHECK(line([](auto& s) { s.step_tolerance = -1; }) ==
        "step_tolerance is -1, must be finite and not negative");
  CHECK(line([](auto& s) { s.interval = 0; }) == "interval is 0, must be at least 1");
  CHECK(line([](auto& s) { s.history = 0; }) == "history is 0, must be at least 1");
  CHECK(line([](auto& s) { s.latency = -1; }) == "latency is -1, must be at least 0");
  CHECK(line([](auto& s) { s.patience = -1; }) == "patience is -1, must be at least 0");
  CHECK(line([](auto& s) { s.newton_steps = -1; }) == "newton_steps is -1, must be at least 0");
  CHECK(line([](auto& s) { s.first_newton_steps = -1; }) ==
        "first_newton_steps is -1, must be at least 0");
  CHECK(line([](auto& s) { s.latency = 9; }) == "history is 8, must be at least the latency of 9");
}
