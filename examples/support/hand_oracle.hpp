#pragma once

// Compares a robot's kinematics and dynamics with samples that other libraries computed: JSON with
// joint_order, jacobian_link, gravity, spd {kp, kd, h} and samples of q, qd, qdd, qbar, fk,
// jacobian, mass_matrix, gravity, coriolis, rnea_tau, fd_tau, fd_qdd, spd_qdd, spd_tau. Joints and
// links are matched by name.

#include <array>
#include <string>

#include "clothctl/robot/kinematic_tree.hpp"

namespace program {

/// The largest differences of all samples. Torques, accelerations and the mass matrix count
/// relative to the largest entry of the sample's.
struct OracleErrors {
  /// Places of links (m) and entries of their rotations.
  double fk = 0;
  /// Entries of the Jacobian.
  double jacobian = 0;
  /// Mass matrix.
  double mass = 0;
  /// Torques that velocities and gravity take.
  double bias = 0;
  /// Torques that gravity takes.
  double gravity = 0;
  /// Inverse dynamics.
  double rnea = 0;
  /// Forward dynamics.
  double fd = 0;
  /// Accelerations of a stable PD step.
  double spd_qdd = 0;
  /// Torques of a stable PD step.
  double spd_tau = 0;
  /// Number of samples.
  int samples = 0;

  /// Whether all are within a tolerance; forward dynamics may miss by 1e-6, since they divide by
  /// the mass matrix.
  bool within(double tolerance) const;
};

/// Compares a robot with an oracle's file. Ends the program, naming file, sample and field, where
/// the file is not complete, not finite, or of another robot. `model` stands for the robot in
/// messages.
template <class Scalar>
OracleErrors compare_with_oracle(const clothctl::KinematicTree<Scalar>& tree,
                                 const std::string& model, const std::string& path);

}  // namespace program
