#pragma once

// A gust that the planner is not told of, and what it learns of it.

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/estimate/disturbance_observer.hpp"
#include "support/scene.hpp"

namespace program {

/// A plant that accelerates across the sheet from 1 s on by the share `--unknown` of gravity. A
/// DisturbanceObserver learns from its steps.
class GustyPlant {
 public:
  using Scalar = double;
  /// Refers to `plant`, at the start of a run.
  GustyPlant(const Scene& scene, const Options& o, AnyPlant& plant);

  /// Learns from the last step. Returns the forces that the planner should know of, 3×n, N.
  const Points& learn();

  Index vertex_count() const { return plant_->vertex_count(); }
  const Points& positions() const { return plant_->positions(); }
  const Points& velocities() const { return plant_->velocities(); }
  void apply(const clothctl::ClothInput<double>& input);
  clothctl::StepReport<double> advance(double dt);

 private:
  AnyPlant* plant_;
  clothctl::VectorX<double> mass_;
  double share_, dt_ = 0, time_ = 0;
  clothctl::DisturbanceObserver<clothctl::MassSpring<double>> observer_;
  clothctl::ClothState<double> before_;
  clothctl::ClothInput<double> input_;
};

}  // namespace program
