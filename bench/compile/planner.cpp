// A sheet held by two fingers, and the planner of their forces.

#include "clothctl/clothctl.hpp"

using namespace clothctl;

int main() {
  const GridMesh<double> grid = make_grid<double>(9, 9, 0.5, 0.5).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  MassSpring<double> model = MassSpring<double>::create(network).value();
  ModelPlant<MassSpring<double>> plant(model);

  PlannerSetup<double> setup;
  setup.triangles = network.triangles;
  for (int col : {0, 8}) {
    setup.features.add_point(grid.vertex(0, col));
    setup.grips.push_back(make_pinch<double>({grid.vertex(8, col)}, 0.5, 20.0));
  }
  const auto target = [&](Index corner, double t) -> Vector3<double> {
    return grid.positions.col(corner == 0 ? 0 : 8) + Vector3<double>(0.05 * t, 0.0, 0.0);
  };

  LinearisedPredictor<MassSpringResponse<float>> predictor{MassSpringResponse<float>(model)};
  PlannerSettings<double> settings;
  using Sheets = Planner<decltype(predictor)>;
  Sheets planner = Sheets::create(setup, settings, predictor, plant.positions()).value();
  PlanResult<double> plan = planner.make_result();
  if (!can_apply(planner.plan(plant.positions(), plant.velocities(), 0.0, target, plan))) return 1;
  plant.apply(plan.input);
  return plant.advance(0.02).advanced ? 0 : 1;
}
