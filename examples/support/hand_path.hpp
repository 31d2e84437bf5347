#pragma once

// A motion for a hand: the base moves along a rounded rectangle while wrist and fingers open and
// close. Positions, velocities and accelerations are continuous and exact. Between keys the base's
// velocity changes smoothly, and at keys its acceleration is zero,
//
//   x(t) = x0 + v0 t + (v1 - v0) T (s³ - s⁴/2),   s = t/T,   x1 = x0 + (v0 + v1) T/2
//
// which for equal velocities is a straight line at constant speed.

#include <vector>

#include "clothctl/robot/forward_kinematics.hpp"

namespace program {

/// Commanded positions and velocities of a tree's coordinates over time.
class HandPath {
 public:
  /// Makes the path around `home`. With `hold` it stays at `home`.
  HandPath(const clothctl::KinematicTree<double>& tree, const Eigen::VectorXd& home, bool hold);

  /// Writes positions and velocities at time t (s).
  void at(double t, Eigen::VectorXd& q, Eigen::VectorXd& qd) const;
  /// Returns whether the base moves straight at full speed from t0 to t1 (s).
  bool is_straight(double t0, double t1) const;
  /// Returns whether the robot's base slides.
  bool slides() const { return slides_; }

  /// Largest speed of the base (m/s).
  static constexpr double kSpeed = 0.3;

 private:
  struct Key {
    double time;
    Eigen::Vector3d place, velocity;
  };
  struct Oscillation {
    clothctl::Index position, velocity;
    double amount, period;
  };

  double wrapped(double t) const;

  const clothctl::KinematicTree<double>& tree_;
  Eigen::VectorXd home_;
  std::vector<Key> keys_;
  std::vector<Eigen::Vector3d> axes_;  // of each body that slides with the base, else zero
  std::vector<Oscillation> oscillations_;
  bool hold_ = false, slides_ = false;
};

}  // namespace program
