#include "support/unknown_gust.hpp"

namespace program {

GustyPlant::GustyPlant(const Scene& scene, const Options& o, AnyPlant& plant)
    : plant_(&plant),
      mass_(scene.body.network.mass),
      share_(o.unknown),
      observer_(must(clothctl::DisturbanceObserver<clothctl::MassSpring<double>>::create(
          make_mass_spring(scene.body, scene.body.network, clothctl::Integration::Newton),
          mass_))) {}

void GustyPlant::apply(const clothctl::ClothInput<double>& input) {
  input_ = input;
  before_ = {plant_->positions(), plant_->velocities()};
  clothctl::ClothInput<double> all = input;
  if (time_ >= 1) {
    const Vec gust = 9.81 * share_ * Vec(0.2, 1, 0).normalized();
    const Index forces = input.forces.cols();
    all.forces.resize(3, forces + mass_.size());
    all.forces.leftCols(forces) = input.forces;
    all.forces.rightCols(mass_.size()) = gust * mass_.transpose();
    for (Index i = 0; i < mass_.size(); ++i) all.force_vertices.push_back(static_cast<int>(i));
  }
  plant_->apply(all);
}

clothctl::StepReport<double> GustyPlant::advance(double dt) {
  dt_ = dt;
  time_ += dt;
  return plant_->advance(dt);
}

const Points& GustyPlant::learn() {
  if (!observer_.observe(before_, input_, dt_, plant_->velocities()))
    refuse("--unknown: the model cannot take the step that the sheet took");
  return observer_.force();
}

}  // namespace program
