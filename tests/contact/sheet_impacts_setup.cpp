// What the pass that keeps layers apart is given.

#include "clothctl/contact/sheet_impacts_setup.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("every bad setting of the pass over layers is named, with its value", "[self_contact]") {
  using Settings = SheetImpactSettings<double>;
  CHECK(Settings().validate().empty());
  const auto wrong = [](auto change) {
    Settings settings;
    change(settings);
    return settings.validate();
  };
  const double inf = std::numeric_limits<double>::infinity();
  CHECK(wrong([&](Settings& s) { s.thickness = inf; }) ==
        "the thickness inf m, must be finite and positive");
  CHECK(wrong([&](Settings& s) { s.friction = -2; }) ==
        "the friction -2, must be finite and not negative");
  CHECK(wrong([&](Settings& s) { s.push_speed = inf; }) ==
        "the push speed inf m/s, must be finite and not negative");
  CHECK(wrong([&](Settings& s) { s.untangle_speed = -1; }) ==
        "the untangle speed -1 m/s, must be finite and not negative");
  CHECK(wrong([&](Settings& s) { s.sweeps = 0; }) == "sweeps 0, must be at least 1");
  CHECK(wrong([&](Settings& s) { s.rounds = -3; }) == "rounds -3, must be at least 1");
}
