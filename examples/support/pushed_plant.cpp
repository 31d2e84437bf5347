#include "support/pushed_plant.hpp"

namespace program {

PushedPlant::PushedPlant(const Scene& scene, const Options& o, AnyPlant& plant,
                         const clothctl::PlanResult<double>& result)
    : plant_(&plant),
      result_(&result),
      dt_(scene.settings.dt),
      dynamics_(make_dynamics(scene, o)) {}

PushedPlant::Dynamics PushedPlant::make_dynamics(const Scene& scene, const Options& o) {
  if (is_position_based(o.plant))
    return must(clothctl::PoseForces<clothctl::PositionBased<double>>::create(
        make_position_based(o.plant, scene.body), scene.setup));
  const clothctl::Integration integration =
      o.plant == "newton" ? clothctl::Integration::Newton : clothctl::Integration::LinearlyImplicit;
  clothctl::PoseForcesSettings settings;
  settings.velocity = 0.3;  // the model steps like the plant
  return must(clothctl::PoseForces<clothctl::MassSpring<double>>::create(
      make_mass_spring(scene.body, scene.body.network, integration), scene.setup, settings));
}

void PushedPlant::apply(const clothctl::ClothInput<double>& input) {
  // How the plan goes on after this frame.
  const Index next = result_->plan.cols() > 1 ? 1 : 0;
  const Points velocities = result_->plan.col(next).reshaped(3, result_->plan.rows() / 3);
  const auto follow = [&](auto& dynamics) {
    found_ = dynamics.solve(positions(), plant_->velocities(), input, velocities, dt_);
    if (found_) plant_->apply(dynamics.input());
  };
  std::visit(follow, dynamics_);
}

clothctl::StepReport<double> PushedPlant::advance(double dt) {
  if (found_) return plant_->advance(dt);
  return {clothctl::StepStatus::NumericalFailure, false, 0.0, 0};
}

}  // namespace program
