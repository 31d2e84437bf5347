// Hidden markers, and what is no measurement.

#include "clothctl/estimate/marker_measurement.hpp"

#include <limits>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("marker measurement: room has all markers hidden", "[estimate]") {
  MarkerMeasurement<double> seen;
  seen.reserve(3);
  CHECK(seen.validate(3).empty());
  for (Index i = 0; i < 3; ++i) CHECK_FALSE(seen.is_seen(i));
}

TEST_CASE("marker measurement: lost markers are hidden", "[estimate]") {
  MarkerMeasurement<double> seen;
  seen.reserve(3);
  seen.positions(1, 1) = std::numeric_limits<double>::quiet_NaN();
  seen.positions(2, 2) = std::numeric_limits<double>::infinity();
  const long before = clothctl_test::allocations();
  const Index count = seen.see_finite();
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(count == 1);
  CHECK(seen.is_seen(0));
  CHECK_FALSE(seen.is_seen(1));
  CHECK_FALSE(seen.is_seen(2));
  CHECK(seen.validate(3).empty());
}

TEST_CASE("marker measurement: refusals name sizes, marker and value", "[estimate]") {
  MarkerMeasurement<double> seen;
  seen.reserve(3);
  CHECK(seen.validate(2) == "there are 3 positions and 3 flags for 2 markers");
  seen.seen.pop_back();
  CHECK(seen.validate(3) == "there are 3 positions and 2 flags for 3 markers");
  seen.reserve(2);
  seen.positions(1, 1) = std::numeric_limits<double>::quiet_NaN();
  CHECK(seen.validate(2).empty());  // hidden
  seen.seen[1] = 1;
  CHECK(seen.validate(2) == "marker 1 is seen, but its y is nan");
}
