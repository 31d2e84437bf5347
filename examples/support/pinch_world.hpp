#pragma once

// A world with a hanging sheet that two soft pads pinch near its upper left corner: pads on given
// paths, pads of a gripper that presses with a given force, or the tips of a hand.

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "clothctl/sim/world.hpp"

namespace program {

/// What pinches, how it moves and presses.
struct PinchMotion {
  std::string pads = "paths";  ///< paths, gripper, hand or none
  double force = 6;            ///< of each pad on the sheet, N; they close within 0.2 s
  double amplitude = 0;        ///< of a shake of 2 Hz along x, m
  double twist = 0;            ///< turn about their normals and back, at 0.5 Hz, rad
};

/// The sheet.
struct PinchSheet {
  int side = 33;
  double size = 0.5;
  std::string model = "mass-spring";  ///< or xpbd
  std::string integration = "linear-implicit";
  int substeps = 1;
  double cap = 0.02;  ///< largest stretch of an edge of a position-based sheet; 0: none
};

/// The world.
class PinchWorld {
 public:
  using Vector = clothctl::Vector3<double>;
  using Points = clothctl::Points<double>;

  static clothctl::Result<std::unique_ptr<PinchWorld>> create(
      const PinchSheet& sheet, const clothctl::Material<double>& material,
      const PinchMotion& motion, const clothctl::PadSettings<double>& pad);

  /// Tells what carries the pads where to be at t + dt, by inverse kinematics for a hand.
  void drive(double t, double dt);
  /// Makes the step to there. Returns whether the world was advanced.
  bool step(double dt);
  const clothctl::WorldReport<double>& report() const { return report_; }
  const clothctl::ClothState<double>& state() const { return world_.state(0); }
  const std::vector<std::array<int, 3>>& triangles() const { return triangles_; }

  /// Remembers the points of the sheet that the samples touch now, for `slip`.
  void mark();
  /// Returns the way of the sheet between the pads from where it was marked: the mean of the
  /// samples' ways on the undeformed sheet, and the change of their mean spring; m. 0 before
  /// `mark`.
  double slip() const;
  /// Returns the largest way of the sheet under a single sample, m.
  double sample_slip() const;
  std::size_t contact_count() const;
  /// Mean normal force of a pad in the last step, N.
  double normal_force(double dt) const;
  /// Share of the friction that is used: sum of tangential impulses / (μ sum of normal ones).
  double friction_use() const;
  /// Largest distance of a fingertip from where it should be, m; 0 without a hand.
  double tip_error() const { return tip_error_; }
  /// Longest edge over its rest length, minus 1.
  double stretch() const;
  /// Number of samples of both pads; their places, and the forces on the sheet there, N.
  static constexpr clothctl::Index kSamples = 8;
  Points places() const;
  Points forces(double dt) const;

 private:
  PinchWorld() = default;

  std::string add_paths();
  std::string add_gripper();
  std::string add_hand();
  std::string add_pads(const std::array<int, 2>& carriers,
                       const std::array<std::vector<clothctl::PadSample<double>>, 2>& samples);
  /// Where pad k has to be at time t.
  clothctl::RigidMotion<double> pose(std::size_t k, double t, double dt) const;
  double way(double t) const;
  double turn(double t) const;
  /// Share of the force with which the pads press.
  static double closed(double t);
  /// Finds where the fingertips touch, and the first positions of the hand.
  void place_tips();
  /// Moves the hand's positions so that its tips are at the poses of time t.
  void reach(double t);
  template <class F>
  void for_each_contact(F visit) const {
    for (int k = 0; k < world_.pad_count(); ++k) {
      for (const auto& contact : world_.pad_contacts(k)) visit(k, contact);
    }
  }
  Vector mean_offset() const;
  Points touched() const;

  PinchMotion motion_;
  clothctl::PadSettings<double> settings_;
  clothctl::World<double> world_;
  clothctl::WorldReport<double> report_;
  clothctl::KinematicTree<double> tree_;
  std::unique_ptr<clothctl::KinematicTreeWorkspace<double>> work_;
  std::unique_ptr<clothctl::InverseKinematics<clothctl::KinematicTree<double>>> ik_;
  clothctl::VectorX<double> q_;
  std::array<Vector, 2> tip_;  // points of the last bones that touch, in their frames
  std::array<clothctl::Matrix3<double>, 2> R_tip_;  // how they are turned at the start
  std::array<clothctl::Matrix3<double>, 2> R_now_;  // and after the last reach
  double tip_error_ = 0;
  std::vector<clothctl::Spring<double>> springs_;
  std::vector<std::array<int, 3>> triangles_;
  Points rest_, marked_;
  Vector marked_offset_ = Vector::Zero(), inside_ = Vector::Zero();
};

}  // namespace program
