// Makes the sheet and its network.

#include "scene.hpp"

#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"

namespace versus {

template <class Scalar>
clothctl::SpringNetwork<Scalar> cotton_network(int side, double height) {
  auto grid = clothctl::make_grid<Scalar>(side, side, Scalar(1), Scalar(1)).value();
  const clothctl::Points<Scalar> hanging = grid.positions;
  grid.positions.row(0) = hanging.row(0).array() - hanging.row(0).mean();
  grid.positions.row(1) = hanging.row(2).array() - hanging.row(2).mean();
  grid.positions.row(2).setConstant(static_cast<Scalar>(height));
  const auto cotton = clothctl::material_preset<Scalar>("cotton").value();
  return clothctl::sheet_network<Scalar>(grid.positions, grid.triangles, cotton).value();
}

template clothctl::SpringNetwork<double> cotton_network<double>(int, double);
template clothctl::SpringNetwork<float> cotton_network<float>(int, double);

Scene make_scene(int side, const Obstacle& obstacle, bool self, int substeps) {
  const auto network = cotton_network<double>(side, start_height(obstacle));
  Scene scene;
  scene.side = side;
  scene.obstacle = obstacle;
  scene.self = self;
  scene.substeps = substeps;
  const auto& rest = network.rest_positions;
  scene.positions.assign(rest.data(), rest.data() + rest.size());
  scene.mass.assign(network.mass.data(), network.mass.data() + network.mass.size());
  scene.triangles = network.triangles;
  for (const auto& spring : network.springs) scene.edges.push_back({spring.a, spring.b});
  return scene;
}

}  // namespace versus
