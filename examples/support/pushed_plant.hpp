#pragma once

// A plant that receives finger forces, for a planner of poses.

#include <variant>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mpc/pose_forces.hpp"
#include "support/scene.hpp"

namespace program {

/// Turns the poses that a planner sends into forces, by the inverse dynamics of a model of the
/// plant, which is position-based or implicit.
class PushedPlant {
 public:
  using Scalar = double;
  /// Refers to `plant`, and to the result that the planner fills before it sends.
  PushedPlant(const Scene& scene, const Options& o, AnyPlant& plant,
              const clothctl::PlanResult<double>& result);

  /// The forces of the last frame.
  const std::vector<clothctl::FingerForce<double>>& finger_forces() const {
    return std::visit(
        [](const auto& dynamics) -> const auto& { return dynamics.finger_forces(); }, dynamics_);
  }

  /// Returns whether the last call of `apply` found forces.
  bool found_forces() const { return found_; }

  Index vertex_count() const { return plant_->vertex_count(); }
  const Points& positions() const { return plant_->positions(); }
  const Points& velocities() const { return plant_->velocities(); }
  void apply(const clothctl::ClothInput<double>& input);
  /// Does not advance where no forces were found.
  clothctl::StepReport<double> advance(double dt);

 private:
  using Dynamics = std::variant<clothctl::PoseForces<clothctl::PositionBased<double>>,
                                clothctl::PoseForces<clothctl::MassSpring<double>>>;
  static Dynamics make_dynamics(const Scene& scene, const Options& o);

  AnyPlant* plant_;
  const clothctl::PlanResult<double>* result_;
  double dt_;
  bool found_ = false;
  Dynamics dynamics_;
};

}  // namespace program
