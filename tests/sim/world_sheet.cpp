// A sheet of any model within a world.

#include "clothctl/sim/detail/world_sheet.hpp"

#include <utility>
#include <vector>

#include "support/sheet_on_obstacles.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Model = MassSpring<double>;

detail::WorldSheetOf<Model, double> make_sheet() {
  MassSpringSettings<double> settings;
  settings.pinned = {2};
  Model model = Model::create(level_sheet<double>(3), settings).value();
  const SpringNetwork<double>& network = model.network();
  auto finder =
      SheetContactFinder<double>::create(network.rest_positions, network.triangles).value();
  auto contacts = ObstacleContacts<double>::create(50).value();
  auto mesh = detail::SheetMesh<double>::of(model);
  ClothState<double> state = model.rest_state();
  return {std::move(model),  std::move(mesh),     std::move(state),
          std::move(finder), std::move(contacts), 50};
}

}  // namespace

TEST_CASE("inverse masses are zero where the motion is prescribed", "[sim]") {
  auto sheet = make_sheet();
  sheet.input.driven_vertices = {4};
  VectorX<double> w(9);
  sheet.write_inverse_masses(w);
  for (Index v = 0; v < 9; ++v) CHECK(w[v] == (v == 2 || v == 4 ? 0.0 : 1 / sheet.mesh.mass[v]));
}

TEST_CASE("supports are where a contact touches at the end of the step", "[sim]") {
  auto sheet = make_sheet();
  sheet.first = 100;
  const auto floor = slope<double>(0, 0.5);
  sheet.obstacles.emplace_back(floor);
  REQUIRE(sheet.find_contacts(0.01) == QueryStatus::Answered);
  std::vector<SheetSupport<double>> supports;
  supports.reserve(5);
  sheet.add_supports(0.01, supports);
  REQUIRE(supports.size() == 5);  // no more than there is room for
  CHECK(supports[0].vertex[0] == 100 + sheet.contacts.contacts()[0].point.vertex[0]);
  CHECK(supports[0].vertex[1] == -1);
  CHECK(supports[0].level == sheet.contacts.settings().thickness);
  const StepReport<double> report = sheet.step(0.01, sheet.input);
  CHECK(report.advanced);
  CHECK(sheet.contacts.report().closed > 0);
}
