// What a world is made with.

#include "clothctl/sim/world_setup.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

const double kNan = std::numeric_limits<double>::quiet_NaN();

}  // namespace

TEST_CASE("every bad entry of a sheet's set-up is named, with its value", "[sim]") {
  using Setup = WorldSheetSetup<double>;
  CHECK(Setup().validate().empty());
  const auto wrong = [](auto change) {
    Setup setup;
    change(setup);
    return setup.validate();
  };
  CHECK(wrong([](Setup& s) { s.thickness = kNan; }) ==
        "the thickness nan m, must be from 1e-6 to 1");
  CHECK(wrong([](Setup& s) { s.thickness = 1e-300; }) ==
        "the thickness 1e-300 m, must be from 1e-6 to 1");
  CHECK(wrong([](Setup& s) { s.thickness = 1000; }) ==
        "the thickness 1000 m, must be from 1e-6 to 1");
  CHECK(wrong([](Setup& s) { s.substeps = 1001; }) == "1001 substeps, must be 1 to 1000");
  CHECK(wrong([](Setup& s) { s.contacts = -1; }) == "room for -1 contacts, must be 0 to 1000000");
  CHECK(wrong([](Setup& s) { s.contacts = Index(1) << 30; }) ==
        "room for 1073741824 contacts, must be 0 to 1000000");
}

TEST_CASE("every bad setting of a world is named, with its value", "[sim]") {
  using Settings = WorldSettings<double>;
  CHECK(Settings().validate().empty());
  Settings settings;
  settings.sheet_friction = kNan;
  CHECK(settings.validate() == "the sheet_friction nan, must be finite and not negative");
  settings.sheet_friction = -0.1;
  CHECK(settings.validate() == "the sheet_friction -0.1, must be finite and not negative");
  settings = {};
  settings.bodies.gravity[1] = kNan;
  CHECK(settings.validate() == "the gravity with the coordinate 1 = nan, must be finite");
}
