#pragma once

// A plant behind a camera and a slow wire: what the planner sees is an estimate.

#include <deque>

#include "clothctl/cloth/mass_spring_rollout.hpp"
#include "clothctl/estimate/state_estimator.hpp"
#include "support/marker_camera.hpp"
#include "support/scene.hpp"

namespace program {

/// A plant whose markers are measured late and with noise, and which gets commands late, by the
/// options. Positions and velocities are those of an estimate, at the time at which the next
/// command acts. Its model is the mass-spring sheet that the planner predicts.
class MeasuredPlant {
 public:
  using Scalar = double;
  /// Refers to `plant`, at the start of a run, and to a square sheet's scene. Ends the program if
  /// the options do not fit them.
  MeasuredPlant(const Scene& scene, const Options& o, AnyPlant& plant);

  /// Takes a picture and corrects the estimate by what has arrived. Call it before each frame.
  void look();
  /// Returns the time at which the next command acts, s.
  double time() const { return estimator_.time(); }

  Index vertex_count() const { return estimator_.vertex_count(); }
  const Points& positions() const { return estimator_.positions(); }
  const Points& velocities() const { return estimator_.velocities(); }
  void apply(const clothctl::ClothInput<double>& input);
  clothctl::StepReport<double> advance(double dt);

 private:
  using Estimator = clothctl::StateEstimator<clothctl::MassSpringRollout<double>>;

  AnyPlant* plant_;
  MarkerCamera camera_;
  Estimator estimator_;
  clothctl::MarkerMeasurement<double> picture_;
  std::deque<clothctl::ClothInput<double>> sent_;
  Index frame_ = 0;
};

}  // namespace program
