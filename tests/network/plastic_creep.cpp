// Rest lengths that creep: against the differential equation, and its limits.

#include "clothctl/network/plastic_creep.hpp"

#include <limits>

#include "clothctl/network/sheet.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

SpringNetwork<double> grid_network() {
  return sheet_network(make_grid<double>(4, 4, 1.0, 1.0).value(), Material<double>()).value();
}

}  // namespace

TEST_CASE("creep follows its differential equation and is elastic below the yield", "[network]") {
  const SpringNetwork<double> start = grid_network();
  CreepSettings<double> settings;
  settings.rate = 3;
  for (const double factor : {1.3, 0.8, 1.04, 0.97}) {
    const Points<double> x = factor * start.rest_positions;
    SpringNetwork<double> one = start, many = start;
    const double change = creep_rest_lengths(one, x, settings, 0.2);
    for (int i = 0; i < 100; ++i) creep_rest_lengths(many, x, settings, 0.002);
    for (std::size_t s = 0; s < start.springs.size(); ++s) {
      const double rest = start.springs[s].rest_length, length = factor * rest;
      // Integrated in 10^5 steps.
      double expected = rest;
      for (int i = 0; i < 100000; ++i) {
        const double strain = length / expected - 1;
        if (strain > 0.05) expected += 2e-6 * 3 * (length / 1.05 - expected);
        if (strain < -0.05) expected += 2e-6 * 3 * (length / 0.95 - expected);
      }
      CHECK(one.springs[s].rest_length == Approx(expected).epsilon(1e-5));
      CHECK(many.springs[s].rest_length == Approx(one.springs[s].rest_length));
      CHECK(change == Approx(std::abs(expected / rest - 1)).margin(1e-5));
    }
    CHECK((change == 0) == (std::abs(factor - 1) < 0.05));
  }
}

TEST_CASE("creep ends at the limit, and seams do not creep", "[network]") {
  SpringNetwork<double> network = grid_network();
  detail::add_spring(network, 0, 15, 1.0, 0.0, SpringKind::Seam);
  const double seam = network.springs.back().rest_length;
  CreepSettings<double> settings;
  settings.rate = 100;
  settings.limit = 0.1;
  creep_rest_lengths(network, Points<double>(2 * network.rest_positions), settings, 10.0);
  for (std::size_t s = 0; s + 1 < network.springs.size(); ++s) {
    const auto& spring = network.springs[s];
    const double rest =
        (network.rest_positions.col(spring.a) - network.rest_positions.col(spring.b)).norm();
    CHECK(spring.rest_length == Approx(1.1 * rest));
  }
  CHECK(network.springs.back().rest_length == seam);
  // A spring that is beyond the limit already is not pulled back to it.
  network.springs[0].rest_length *= 1.5;
  const double beyond = network.springs[0].rest_length;
  creep_rest_lengths(network, Points<double>(3 * network.rest_positions), settings, 10.0);
  CHECK(network.springs[0].rest_length == beyond);
}

TEST_CASE("creep refuses what is not finite and never allocates", "[network]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  SpringNetwork<double> network = grid_network();
  Points<double> x = 2 * network.rest_positions;
  CreepSettings<double> settings;
  CHECK(creep_rest_lengths(network, x, settings, 0.1) == 0);  // the default rate
  settings.rate = 1;
  const double rest = network.springs[3].rest_length;
  for (const double dt : {nan, -1.0, std::numeric_limits<double>::infinity()})
    CHECK(creep_rest_lengths(network, x, settings, dt) == -1);
  CHECK(creep_rest_lengths(network, Points<double>(Points<double>::Zero(3, 2)), settings, 0.1) ==
        -1);
  x(1, 5) = nan;
  CHECK(creep_rest_lengths(network, x, settings, 0.1) == -1);
  CHECK(network.springs[3].rest_length == rest);
  x = 2 * network.rest_positions;
  const long before = clothctl_test::allocations();
  CHECK(creep_rest_lengths(network, x, settings, 0.1) > 0);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  x.setZero();  // all vertices in one place
  CHECK(creep_rest_lengths(network, x, settings, 1e9) >= 0);
  CHECK(network.validate() == "");

  for (const double bad : {nan, -0.1, 1.0}) {
    settings = {};
    settings.yield_strain = bad;
    CHECK(settings.validate().find("yield strain") == 0);
    settings = {};
    settings.limit = bad;
    CHECK(settings.validate().find("creep limit") == 0);
    settings = {};
    settings.rate = bad;
    CHECK((settings.validate().find("creep rate") == 0) == (bad != 1.0));
  }
}
