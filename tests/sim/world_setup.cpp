// What a world is made with.

#include "clothctl/sim/world_setup.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("every bad entry of a sheet's set-up is named, with its value", "[sim]") {
  using Setup = WorldSheetSetup<double>;
  CHECK(Setup().validate().empty());
  const auto wrong = [](auto change) {
    Setup setup;
    change(setup);
    return setup.validate();
  };
  CHECK(wrong([](Setup& s) { s.thickness = std::numeric_limits<double>::quiet_NaN(); }) ==
        "the thickness nan m, must be finite and positive");
  CHECK(wrong([](Setup& s) { s.substeps = 1001; }) == "1001 substeps, must be 1 to 1000");
  CHECK(wrong([](Setup& s) { s.contacts = -1; }) == "room for -1 contacts");
}
