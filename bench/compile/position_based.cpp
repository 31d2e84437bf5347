// A sheet, simulated by the position-based scheme.

#include "clothctl/cloth.hpp"
#include "clothctl/mesh.hpp"
#include "clothctl/network.hpp"

using namespace clothctl;

int main() {
  const GridMesh<double> grid = make_grid<double>(9, 9, 0.5, 0.5).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  PositionBased<double> model = PositionBased<double>::create(network).value();
  ModelPlant<PositionBased<double>> plant(model);
  return plant.advance(0.02).advanced ? 0 : 1;
}
