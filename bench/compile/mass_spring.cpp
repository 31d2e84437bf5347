// A sheet, simulated with one linear solve per step.

#include "clothctl/cloth.hpp"
#include "clothctl/mesh.hpp"
#include "clothctl/network.hpp"

using namespace clothctl;

int main() {
  const GridMesh<double> grid = make_grid<double>(9, 9, 0.5, 0.5).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  MassSpring<double> model = MassSpring<double>::create(network).value();
  ModelPlant<MassSpring<double>> plant(model);
  return plant.advance(0.02).advanced ? 0 : 1;
}
