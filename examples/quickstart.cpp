#include <cstdio>

#include "clothctl/clothctl.hpp"

using namespace clothctl;

int main() {
  // A 0.5 m handkerchief of 17 × 17 vertices, simulated with one linear solve a step.
  const GridMesh<double> grid = make_grid<double>(17, 17, 0.5, 0.5).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  MassSpring<double> model = MassSpring<double>::create(network).value();
  ModelPlant<MassSpring<double>> plant(model);

  // Two fingers pinch each upper corner; the lower corners shall follow a drawn curve.
  PlannerSetup<double> setup;
  setup.triangles = network.triangles;
  for (int col : {0, 16}) {
    setup.features.add_point(grid.vertex(0, col));
    setup.grips.push_back(make_pinch<double>({grid.vertex(16, col)}, 0.5, 20.0));
  }
  PlannerSettings<double> settings;
  settings.gravity_load = plant.gravity_load();
  const auto target = [&](Index corner, double t) -> Vector3<double> {
    return grid.positions.col(corner == 0 ? 0 : 16) +
           Vector3<double>(0.05 * t, 0.05 * std::sin(2 * t), 0);
  };

  // 100 times: plan the forces of the next 20 frames, apply those of the first, move the sheet.
  LinearisedPredictor<MassSpringResponse<float>> predictor{MassSpringResponse<float>(model)};
  auto planner =
      Planner<decltype(predictor)>::create(setup, settings, predictor, plant.positions()).value();
  PlanResult<double> plan = planner.make_result();
  for (int frame = 0; frame < 100; ++frame) {
    if (!run_frame(planner, plant, 0.02 * frame, target, plan).advanced()) return 1;
  }
  const double error = (plant.positions().col(0) - target(0, 2.0)).norm();
  std::printf("after 2 s the left corner is %.1f mm from its target\n", 1000 * error);
}
