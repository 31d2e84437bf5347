#pragma once

// The least type that satisfies ArticulatedDynamics: a gantry of three sliders. It has exactly what
// the concept names, returns unusual but allowed types, and can only be moved.

#include <memory>

#include "clothctl/concepts/articulated.hpp"

namespace clothctl_test {

/// A carriage on x, y and z rails. Frame 0 is the carriage, frame 1 a hook 0.5 m below it.
template <class S>
class GantryArchetype {
 public:
  using scalar_type = S;
  using View = Eigen::Ref<const clothctl::VectorX<S>>;
  using Out = Eigen::Ref<clothctl::VectorX<S>>;
  /// Can be moved but not copied.
  struct workspace_type {
    std::unique_ptr<Eigen::Matrix<S, 3, 1>> place = std::make_unique<Eigen::Matrix<S, 3, 1>>();
  };

  GantryArchetype() = default;
  GantryArchetype(GantryArchetype&&) = default;
  GantryArchetype& operator=(GantryArchetype&&) = default;

  workspace_type make_workspace() const { return {}; }
  int nq() const { return 3; }
  int nv() const { return 3; }
  Eigen::Matrix<S, 3, 1> lower() const { return {S(-1), S(-2), S(0)}; }
  Eigen::Matrix<S, 3, 1> upper() const { return {S(1), S(2), S(1.5)}; }
  Eigen::Matrix<S, 3, 1> effort_limits() const { return {S(60), S(60), S(90)}; }
  void advance(const View& q, const View& step, Out out) const { out = q + step; }
  void difference(const View& from, const View& to, Out out) const { out = to - from; }
  void forward_kinematics(const View& q, workspace_type& work) const { *work.place = q; }
  void frame_pose(const workspace_type& work, int frame, clothctl::Matrix3<S>& R,
                  clothctl::Vector3<S>& p) const {
    R.setIdentity();
    p = *work.place;
    if (frame == 1) p[2] -= S(0.5);
  }
  void point_jacobian(const workspace_type&, int, const clothctl::Vector3<S>&,
                      Eigen::Ref<clothctl::MatrixX<S>> J) const {
    J.setZero();
    for (int k = 0; k < 3; ++k) J(k, k) = S(1);
  }
  void inverse_dynamics(const View&, const View& qdd, workspace_type&, Out torques) const {
    torques = mass().cwiseProduct(qdd);
    torques[2] += S(9.81) * mass()[2];
  }
  int forward_dynamics(const View&, const View& torques, const View& diagonal, workspace_type&,
                       Out qdd) const {
    qdd = torques;
    qdd[2] -= S(9.81) * mass()[2];
    qdd.array() /= (mass() + diagonal).array();
    return -1;
  }

 private:
  static Eigen::Matrix<S, 3, 1> mass() { return {S(6), S(4), S(2)}; }
};

}  // namespace clothctl_test
