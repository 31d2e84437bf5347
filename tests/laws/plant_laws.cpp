// The simulators of this library, used as plants, obey the laws of plants.

#include "laws/plant_laws.hpp"

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/network/sheet.hpp"

using namespace clothctl;

namespace {

template <class Model>
ModelPlant<Model> sheet_plant() {
  using Scalar = typename Model::Scalar;
  const GridMesh<Scalar> grid = make_grid<Scalar>(4, 4, Scalar(0.3), Scalar(0.3)).value();
  const SpringNetwork<Scalar> network = sheet_network(grid, Material<Scalar>{}).value();
  return ModelPlant<Model>(Model::create(network).value());
}

}  // namespace

TEMPLATE_TEST_CASE("the library's models as plants obey the laws of plants", "[laws]",
                   MassSpring<double>, MassSpring<float>, PositionBased<double>) {
  using Scalar = typename TestType::Scalar;
  clothctl_test::check_plant_laws<Scalar>([] { return sheet_plant<TestType>(); }, Scalar(0.02));
}
