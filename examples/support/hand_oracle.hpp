#pragma once

// Compares a robot's kinematics and dynamics with samples that another library computed. The JSON
// file has joint_order, jacobian_link, gravity, spd {kp, kd, h}, and samples of q, qd, qdd, qbar,
// fk, jacobian, mass_matrix, gravity, coriolis, rnea_tau, fd_tau, fd_qdd, spd_qdd, spd_tau. Joints
// and links are matched by name.

#include <array>
#include <string>

#include "clothctl/robot/kinematic_tree.hpp"

namespace program {

/// The largest differences over all samples. Those of torques, accelerations and the mass matrix
/// are relative to the sample's largest entry.
struct OracleErrors {
  /// Positions of links (m) and entries of their rotations.
  double fk = 0;
  /// Entries of the Jacobian.
  double jacobian = 0;
  /// Mass matrix.
  double mass = 0;
  /// Torques for velocities and gravity.
  double bias = 0;
  /// Torques for gravity.
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

  /// Returns whether all differences are within a tolerance. Forward dynamics may differ by 1e-6,
  /// because it divides by the mass matrix.
  bool within(double tolerance) const;
};

/// Compares a robot with the samples of a file. If the file is incomplete, not finite, or for
/// another robot, ends the program with a message that names file, sample and field. `model` is the
/// robot's name in messages.
template <class Scalar>
OracleErrors compare_with_oracle(const clothctl::KinematicTree<Scalar>& tree,
                                 const std::string& model, const std::string& path);

}  // namespace program
