#include "support/scene.hpp"

#include "clothctl/cloth/settle.hpp"
#include "clothctl/network/sheet.hpp"

namespace program {

void check_scene(const Scene& scene) {
  const Index vertices = scene.body.network.vertex_count();
  if (const std::string problem =
          clothctl::validate_features<double>(scene.setup.features, vertices);
      !problem.empty())
    refuse("--features: " + problem);
  if (const std::string problem = clothctl::validate_grips(scene.setup.grips, vertices);
      !problem.empty())
    refuse(problem);
  std::string problem = scene.settings.validate();
  const std::string name = "input_intervals";  // all other settings are checked as options
  if (problem.starts_with(name)) problem.replace(0, name.size(), "--input-intervals");
  if (!problem.empty()) refuse(problem);
}

Body sheet_body(const Options& o, const clothctl::GridMesh<double>& grid,
                const clothctl::Material<double>& material) {
  Body body;
  body.network = must(clothctl::sheet_network(grid, material));
  body.drag = material.drag;
  if (o.model < o.cloth && !o.hands) {  // coarse sheets were not tried with hands
    const auto coarse = must(clothctl::make_grid<double>(o.model, o.model, o.size, o.size));
    body.coarse = CoarseSheet{must(clothctl::sheet_network(coarse, material)),
                              clothctl::sample_grids(grid, coarse)};
  }
  return body;
}

clothctl::PlannerSettings<double> planner_settings(const Options& o, double weight) {
  clothctl::PlannerSettings<double> s = o.profile == "paper"
                                            ? clothctl::PlannerSettings<double>::paper()
                                            : clothctl::PlannerSettings<double>();
  s.horizon = o.horizon;
  s.input = o.grip == "position" || follows_poses(o) ? clothctl::GripInput::Pose
                                                     : clothctl::GripInput::Force;
  s.command = o.grip == "planned-position" ? clothctl::PlantCommand::Position
                                           : clothctl::PlantCommand::Force;
  s.patch = o.patch == "hard" ? clothctl::PatchMode::Hard : clothctl::PatchMode::Soft;
  s.max_step = o.max_step_mm / 1000;
  s.max_acceleration = o.max_acceleration;
  s.input_intervals.assign(o.input_intervals.begin(), o.input_intervals.end());
  s.input_degree = o.input_degree;
  if (o.profile != "paper") s.gravity_load = Vec(0, 0, weight);
  return s;
}

clothctl::ClothState<double> settle(const Options& o, const Body& body,
                                    clothctl::ClothState<double> state,
                                    const std::vector<int>& held, double seconds) {
  // Linearly implicit and Newton steps have the same equilibria. Converged steps find them from any
  // start.
  AnyPlant plant = make_plant(is_implicit(o.plant) ? "newton" : o.plant, body, 3.0);
  plant.set_state(state);
  const clothctl::SettleReport<double> report = clothctl::settle(plant, held, 0.02, seconds);
  if (!report.advanced)
    refuse("the sheet does not settle: " + std::string(to_string(report.status)));
  state.positions = plant.positions();
  state.velocities.setZero();
  return state;
}

}  // namespace program
