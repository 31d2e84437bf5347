#pragma once

// The inputs of a plan, frame by frame, for a loop whose plan may come late: the frame then gets
// what the last plan meant for it.

#include <utility>

#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/planner_settings.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Keeps the last plan that came in time, and gives its inputs one by one:
///
///   if (in_time) commands.keep(plan);
///   plant.apply(commands.next());
///
/// Beyond the end of the plan, hands stand still where poses are planned, and forces stay those of
/// the last frame. Where forces are planned and positions sent (PlantCommand::Position), a plan
/// holds no positions after the first: hands then stand still from the second frame on.
template <RealScalar Scalar>
class CommandWindow {
 public:
  /// Makes room for the plans of a planner with these settings; `result` is from its
  /// `make_result`, and the first input until `keep` is called. Allocates.
  CommandWindow(const PlannerSettings<Scalar>& settings, const PlanResult<Scalar>& result)
      : dt_(settings.dt),
        poses_(settings.input == GripInput::Pose),
        plan_(result.plan),
        input_(result.input) {}

  /// Takes a plan, of which the next input is the first. Never allocates for results of the same
  /// planner and grips.
  void keep(const PlanResult<Scalar>& result) {
    plan_ = result.plan;
    input_ = result.input;
    frame_ = 0;
  }

  /// Returns how many inputs of the plan have been given: more than one when later plans were late.
  Index given() const { return frame_; }
  /// Returns true when the plan has no further inputs.
  bool exhausted() const { return plan_.cols() <= frame_; }

  /// Returns the input of the next frame. Wind is that of the result. Never allocates.
  const ClothInput<Scalar>& next() {
    if (0 < frame_ && !exhausted()) {
      for (Index j = 0; j < input_.driven_positions.cols() && poses_; ++j)
        input_.driven_positions.col(j) += dt_ * plan_.template block<3, 1>(3 * j, frame_);
      for (Index j = 0; j < input_.forces.cols(); ++j)
        input_.forces.col(j) = plan_.template block<3, 1>(3 * j, frame_);
    }
    if (!exhausted()) ++frame_;
    return input_;
  }

 private:
  Scalar dt_;
  bool poses_;
  MatrixX<Scalar> plan_;
  ClothInput<Scalar> input_;
  Index frame_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
