// Recording of a plant whose hands move.

#include "clothctl/prediction/motion_record.hpp"

#include <algorithm>
#include <limits>

#include "clothctl/cloth/model_plant.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"

using namespace clothctl;

namespace {

using Plant = ModelPlant<MassSpring<double>>;

Plant plant_of(const clothctl_test::HangingSheet& sheet) {
  Plant plant(sheet.model(Integration::LinearlyImplicit));
  plant.set_state(sheet.state);
  return plant;
}

}  // namespace

TEST_CASE("a record holds every frame of a motion within its amplitude", "[prediction]") {
  const auto sheet = clothctl_test::hanging_sheet(5, 2, 20);
  const std::vector<std::vector<int>> grips{sheet.corner_patch(0, 2), sheet.corner_patch(1, 2)};
  Plant plant = plant_of(sheet);
  ExcitationSettings<double> settings;
  settings.frames = 30;
  const MotionRecord<double> record = record_motion<Plant, double>(plant, grips, settings).value();
  REQUIRE(record.positions.size() == 31);
  REQUIRE(record.held.size() == 8);
  CHECK(record.positions.front() == sheet.state.positions);
  CHECK(record.positions.back() == plant.positions());
  double largest = 0;
  for (const Points<double>& x : record.positions) {
    const Vector3<double> moved = x.col(grips[0][0]) - sheet.state.positions.col(grips[0][0]);
    largest = std::max(largest, moved.cwiseAbs().maxCoeff());
    const Vector3<double> other = x.col(grips[0][3]) - sheet.state.positions.col(grips[0][3]);
    CHECK((moved - other).norm() < 1e-12);  // a grip stays rigid
  }
  CHECK(largest > 0.3 * settings.amplitude);
  CHECK(largest < 1.75 * settings.amplitude);
}

TEST_CASE("a record that cannot be made says why", "[prediction]") {
  const auto sheet = clothctl_test::hanging_sheet(5, 1, 2);
  const auto message = [&](const std::vector<std::vector<int>>& grips,
                           const ExcitationSettings<double>& settings) {
    Plant plant = plant_of(sheet);
    const auto result = record_motion<Plant, double>(plant, grips, settings);
    return result ? std::string() : result.error();
  };
  const std::vector<std::vector<int>> grips{{sheet.upper_left()}};
  CHECK(message({}, {}) == "the record holds no vertex");
  CHECK(message({{25}}, {}) == "the record holds vertex 25, off a mesh of 25 vertices");
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(message(grips, {nan, 10, 0.02}).find("dt is") == 0);
  CHECK(message(grips, {0.02, 0, 0.02}) == "frames is 0, must be at least 1");
  CHECK(message(grips, {0.02, 10, nan}).find("amplitude is") == 0);
  CHECK(message(grips, {0.02, 2, 0.02}) == "");
}
