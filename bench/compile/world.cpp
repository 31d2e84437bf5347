// A sheet that falls on a ball, in a world.

#include <utility>

#include "clothctl/cloth.hpp"
#include "clothctl/mesh.hpp"
#include "clothctl/network.hpp"
#include "clothctl/sim.hpp"

using namespace clothctl;

int main() {
  const GridMesh<double> grid = make_grid<double>(9, 9, 0.5, 0.5).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  MassSpring<double> model = MassSpring<double>::create(network).value();
  ClothState<double> state = model.rest_state();
  World<double> world;
  const auto ball = SphereCollider<double>::create({0, 0, -1}, 0.3).value();
  if (!world.add_obstacle(ball) || !world.add_sheet(std::move(model), std::move(state))) return 1;
  return world.step(0.02).advanced ? 0 : 1;
}
