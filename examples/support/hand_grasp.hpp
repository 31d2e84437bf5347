#pragma once

// A hand in a world that grasps a sheet, and the figures of its run.

#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/sheet_collider.hpp"
#include "clothctl/grasp/grasp_controller.hpp"
#include "clothctl/grasp/hand_geometry.hpp"
#include "clothctl/grasp/held_grips.hpp"
#include "clothctl/grasp/robot_clearance.hpp"
#include "clothctl/grasp/static_contacts.hpp"
#include "support/hand_model.hpp"
#include "support/hand_momentum.hpp"
#include "support/hand_view.hpp"
#include "support/pad_ways.hpp"

namespace program {

/// How it grasps.
struct GraspOptions {
  double force = 3, most_force = 10;  ///< N
  double friction = 0.6;
  bool implicit = false;   ///< PdForm::Implicit instead of Stable
  std::uint64_t seed = 0;  ///< of a random start; 0: where it waits
};

/// The figures of a hand.
struct GraspFigures {
  clothctl::GraspReport<double> last;
  std::string fault;
  double firm_s = -1;  ///< when it held firmly; negative: never
  double force_sum = 0, ik_error_max_m = 0, torque_max_share = 0;
  double momentum_residual = NAN;  ///< NaN: the base does not slide, or all steps were divided
  double penetration_max_m = 0;    ///< of links without pads into the sheet and what is in the way
  long held_steps = 0;
  bool too_weak = false;   ///< it slid at the largest force
  std::vector<double> ms;  ///< processor time of each step of the controller
};

/// The hand.
class GraspingHand {
 public:
  using World = clothctl::World<double>;
  using Hand = clothctl::KinematicTree<double>;
  using Points = clothctl::Points<double>;

  /// Adds a hand, made for `place`, to the world, and plans its way there around the sheet as it is
  /// now, which has these triangles, and `obstacles`.
  static clothctl::Result<std::unique_ptr<GraspingHand>> create(
      World& world, HandModel model, const std::vector<std::array<int, 3>>& triangles,
      std::vector<clothctl::ColliderRef<double>> obstacles, const GraspPlace& place,
      const GraspOptions& options);

  /// Drives the hand in the coming step.
  void drive(double t, double dt);
  /// Measures after the step, which ended with this report.
  void measure(const clothctl::WorldReport<double>& report, double dt);

  clothctl::GraspController<Hand>& controller() { return *controller_; }
  const clothctl::HandInWorld& parts() const { return parts_; }
  const GraspFigures& figures() const { return figures_; }
  bool holds() const { return controller_->phase() == clothctl::GraspPhase::Hold; }
  /// The fingers, as a planner wants them; their segments are 2 k and 2 k + 1 of StaticContacts.
  std::vector<clothctl::HoldingFinger<double>> holding(int k);

  /// Samples of a pad.
  static constexpr clothctl::Index kSamples = 13;
  /// Remembers the points of the sheet that the pads touch, for `slip`.
  void mark(const Points& rest) {
    marked_ = touched_at_rest(world_, {parts_.pads.data(), 2}, kSamples, rest);
  }
  /// Mean way of the sheet under the samples that touch now and did then, on the sheet at rest, m.
  double slip(const Points& rest) const {
    return marked_.cols() == 0
               ? 0
               : mean_way(touched_at_rest(world_, {parts_.pads.data(), 2}, kSamples, rest) -
                          marked_);
  }

  /// Whether it has no arm: its base slides freely.
  bool floats() const { return base_slides(model_.tree); }
  /// The hand as a page shows it.
  const HandView& view() const { return *view_; }

 private:
  GraspingHand(World& world, HandModel model) : world_(world), model_(std::move(model)) {}
  std::string add(const std::vector<std::array<int, 3>>& triangles,
                  std::vector<clothctl::ColliderRef<double>> obstacles, const GraspPlace& place,
                  const GraspOptions& options);
  /// Adds the hand at these positions, its surface and its controller.
  std::string put_into_world(const clothctl::VectorX<double>& start);
  /// Finds poses, and a way between them, that keep clear of what is beside the sheet.
  std::string find_poses(const GraspPlace& place,
                         const std::vector<clothctl::FingerPad<double>>& fingers,
                         clothctl::GraspPoses<double>& poses);
  /// Finds a way from a random start to the first waiting pose.
  std::string plan_way(clothctl::RobotClearance<Hand>& whole, const clothctl::VectorX<double>& wait,
                       std::uint64_t seed, std::vector<clothctl::VectorX<double>>& keys);
  std::array<clothctl::PadTouch<double>, 2> touches(double dt) const;

  World& world_;
  HandModel model_;
  clothctl::HandInWorld parts_;
  GraspOptions options_;
  std::array<clothctl::Vector3<double>, 2> press_;
  std::unique_ptr<clothctl::GraspController<Hand>> controller_;
  std::unique_ptr<clothctl::SheetCollider<double>> sheet_;
  std::unique_ptr<clothctl::RobotClearance<Hand>> links_;  // without the fingertips that press
  std::vector<clothctl::ColliderRef<double>> beside_;      // obstacles beside the sheet
  clothctl::HandState<double> before_;
  GraspFigures figures_;
  std::unique_ptr<HandView> view_;
  Points marked_;
};

}  // namespace program
