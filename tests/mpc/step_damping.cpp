// How the weight of the change from the last plan grows and fades.

#include "clothctl/mpc/detail/step_damping.hpp"

#include <algorithm>

#include "support/catch.hpp"

using clothctl::detail::StepDamping;

TEST_CASE("damping grows by attempts up to a bound, and fades afterwards", "[mpc]") {
  StepDamping<double> damping;
  damping.start(0.05, true);
  CHECK(damping.weight() == 0.05);
  CHECK(damping.raise());
  CHECK(damping.weight() == 0.2);
  CHECK(damping.raise());
  CHECK(damping.weight() == 0.8);
  CHECK(damping.raise());
  CHECK(damping.weight() == 3.2);
  CHECK_FALSE(damping.raise());
  CHECK(damping.weight() == 3.2);
  damping.start(0.05, true);
  CHECK(damping.weight() == 1.6);
  for (int frame = 0; frame < 10; ++frame) damping.start(0.05, true);
  CHECK(damping.weight() == 0.05);
}

TEST_CASE("damping stays bounded when every frame asks for more", "[mpc]") {
  for (const double given : {0.0, 1e-6, 0.01, 3.0}) {
    StepDamping<double> damping;
    for (int frame = 0; frame < 100; ++frame) {
      damping.start(given, true);
      while (damping.raise()) CHECK(damping.weight() > 0);
      CHECK(damping.weight() <= 64 * std::max(given, 1e-4));
    }
  }
}

TEST_CASE("without a last plan there is no damping", "[mpc]") {
  StepDamping<double> damping;
  damping.start(0.05, true);
  CHECK(damping.raise());
  damping.start(0.05, false);
  CHECK(damping.weight() == 0);
  damping.start(0.05, true);
  damping.raise();
  damping.reset();
  damping.start(0.0, true);
  CHECK(damping.weight() == 0);
}
