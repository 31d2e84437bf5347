#include "clothctl/cloth/model_plant.hpp"

#include <cstring>
#include <string>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

static_assert(ClothPlant<ModelPlant<MassSpring<double>>, double> &&
              ClothPlant<ModelPlant<MassSpring<float>>, float>);
static_assert(ClothPlant<ModelPlant<PositionBased<double>>>);
static_assert(!ClothPlant<ModelPlant<MassSpring<float>>, double>);

namespace {

template <class S>
bool same_bits(const Points<S>& a, const Points<S>& b) {
  return a.cols() == b.cols() &&
         std::memcmp(a.data(), b.data(), sizeof(S) * static_cast<std::size_t>(a.size())) == 0;
}

template <class S>
MassSpring<S> small_sheet() {
  const GridMesh<S> grid = make_grid<S>(5, 5, S(0.2), S(0.2)).value();
  MassSpringSettings<S> settings;
  settings.pinned = {20};
  return MassSpring<S>::create(sheet_network<S>(grid, Material<S>()).value(), settings).value();
}

}  // namespace

TEMPLATE_TEST_CASE("a plant gives the same bits as its model in each step", "[cloth]", float,
                   double) {
  using S = TestType;
  const MassSpring<S> model = small_sheet<S>();
  ModelPlant<MassSpring<S>> plant(model);
  auto workspace = model.make_workspace();
  ClothState<S> state = model.rest_state();
  CHECK(plant.vertex_count() == model.vertex_count());
  CHECK(plant.state() == state);
  ClothInput<S> input;
  for (int k = 0; k < 12; ++k) {
    if (k == 4) {
      input.force_vertices = {0, 7};
      input.forces = Points<S>::Constant(3, 2, S(0.003));
      plant.apply(input);
    }
    if (k == 8) {
      input.clear();
      input.driven_vertices = {24};
      input.driven_positions.resize(3, 1);
      input.driven_positions.col(0) = state.positions.col(24) + Vector3<S>(S(0), S(0.01), S(0));
      plant.apply(input);
    }
    const StepReport<S> bare = model.step(state, input, S(0.02), workspace);
    const long before = clothctl_test::allocations();
    const StepReport<S> report = plant.advance(S(0.02));
    const long during = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(during == 0);
    CHECK(report.status == bare.status);
    CHECK(report.advanced);
    CHECK(same_bits<S>(plant.positions(), state.positions));
    CHECK(same_bits<S>(plant.velocities(), state.velocities));
  }
}

TEMPLATE_TEST_CASE("a plant accepts a state and another integration", "[cloth]", float, double) {
  using S = TestType;
  ModelPlant<MassSpring<S>> plant(small_sheet<S>());
  ClothState<S> state = plant.state();
  state.velocities.setConstant(S(0.1));
  plant.set_state(state);
  CHECK(plant.state() == state);
  plant.model().set_integration(Integration::Newton);
  CHECK(plant.model().settings().integration == Integration::Newton);
  CHECK(plant.advance(S(0.02)).advanced);
  // A state of another size is refused by the step, not by set_state.
  const ClothState<S> small{Points<S>::Zero(3, 2), Points<S>::Zero(3, 2)};
  plant.set_state(small);
  const StepReport<S> report = plant.advance(S(0.02));
  CHECK(report.status == StepStatus::InvalidState);
  CHECK_FALSE(report.advanced);
  CHECK(plant.state() == small);
}

TEMPLATE_TEST_CASE("a plant knows the force that balances its weight", "[cloth]", float, double) {
  using S = TestType;
  const MassSpring<S> model = small_sheet<S>();
  const ModelPlant<MassSpring<S>> plant(model);
  const S weight = S(9.81) * model.network().mass.sum();
  CHECK((plant.gravity_load() - Vector3<S>(S(0), S(0), weight)).norm() <= S(1e-6) * weight);
  PositionBasedSettings<S> settings;
  settings.gravity = {S(0), S(-2), S(0)};
  const auto other = PositionBased<S>::create(model.network(), settings).value();
  const ModelPlant<PositionBased<S>> light(other);
  CHECK(light.gravity_load()[1] == Approx(2 * model.network().mass.sum()).epsilon(1e-6));
  CHECK(light.gravity_load()[0] == S(0));
}

TEST_CASE("check_input says why a plant refuses a step", "[cloth]") {
  ModelPlant<MassSpring<double>> plant(small_sheet<double>());
  CHECK(plant.check_input(0.02).empty());
  CHECK(plant.check_input(-1.0) == "step length dt must be positive and finite, got -1 s");
  CHECK(plant.advance(-1.0).status == StepStatus::InvalidInput);
  ClothInput<double> input;
  input.driven_vertices = {3, 25};
  input.driven_positions.setZero(3, 2);
  plant.apply(input);
  CHECK(plant.check_input(0.02) == "driven vertex 1: vertex 25 is off the mesh of 25 vertices");
  CHECK(plant.advance(0.02).status == StepStatus::InvalidInput);
  plant.apply({});
  CHECK(plant.advance(0.02).advanced);
  // Another model, swapped in, does not fit the workspace.
  const GridMesh<double> grid = make_grid<double>(7, 7, 0.2, 0.2).value();
  plant.model() =
      MassSpring<double>::create(sheet_network<double>(grid, Material<double>()).value()).value();
  CHECK(plant.advance(0.02).status == StepStatus::InvalidWorkspace);
  CHECK(plant.check_input(0.02).find("workspace") != std::string::npos);
}
