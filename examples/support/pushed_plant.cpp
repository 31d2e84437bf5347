#include "support/pushed_plant.hpp"

namespace program {

PushedPlant::PushedPlant(const Scene& scene, const Options& o, AnyPlant& plant,
                         const clothctl::PlanResult<double>& result)
    : plant_(&plant),
      result_(&result),
      dt_(scene.settings.dt),
      dynamics_(must(clothctl::PoseForces<clothctl::PositionBased<double>, Setup>::create(
          make_position_based(o.plant, scene.body), scene.setup))) {}

void PushedPlant::apply(const clothctl::ClothInput<double>& input) {
  // How the plan goes on after this frame.
  const Index next = result_->plan.cols() > 1 ? 1 : 0;
  const Points velocities = result_->plan.col(next).reshaped(3, result_->plan.rows() / 3);
  found_ = dynamics_.solve(positions(), plant_->velocities(), input, velocities, dt_);
  if (found_) plant_->apply(dynamics_.input());
}

clothctl::StepReport<double> PushedPlant::advance(double dt) {
  if (found_) return plant_->advance(dt);
  return {clothctl::StepStatus::NumericalFailure, false, 0.0, 0};
}

}  // namespace program
