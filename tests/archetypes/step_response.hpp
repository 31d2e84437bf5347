#pragma once

// The least type that satisfies StepResponse: two masses with a dense 6×6 matrix. It has exactly
// what the concept names, returns unusual but allowed types, and can only be moved.

#include <Eigen/Cholesky>
#include <vector>

#include "clothctl/concepts/prediction.hpp"

namespace clothctl_test {

/// Two masses. A linear spring with a damper joins them, another ties the first to a fixed point.
template <class S>
class StepResponseArchetype {
 public:
  using Scalar = S;

  StepResponseArchetype() {
    mass_ << S(0.1), S(0.3);
    force_.setZero(3, 2);
  }
  StepResponseArchetype(StepResponseArchetype&&) = default;
  StepResponseArchetype& operator=(StepResponseArchetype&&) = default;

  int vertex_count() const { return 2; }
  /// The concept only asks for a conversion to bool.
  int linearise(const clothctl::PointsView<S>& x, const clothctl::PointsView<S>&,
                const clothctl::Vector3<S>& wind, S dt, const std::vector<int>& driven) {
    held_.assign(2, 0);
    for (int i : driven) held_[static_cast<std::size_t>(i)] = 1;
    Eigen::Matrix<S, 2, 2> spring;
    spring << S(9), S(-5), S(-5), S(5);
    stiffness_.setZero();
    for (int i = 0; i < 2; ++i) {
      for (int j = 0; j < 2; ++j)
        stiffness_.template block<3, 3>(3 * i, 3 * j).diagonal().array() += spring(i, j);
    }
    force_ = -(x * spring);
    force_.row(2) -= S(9.81) * mass_.transpose();
    force_.colwise() += S(0.02) * wind;  // a wind force without drag: C = 0.02 I is left out of R
    coupling_ = (S(0.01) * dt + dt * dt) * stiffness_;
    Eigen::Matrix<S, 6, 6> a = coupling_;
    for (int i = 0; i < 6; ++i) a(i, i) += (S(1) + dt * drag()) * mass_[i / 3];
    for (int i = 0; i < 6; ++i) {
      if (held_[static_cast<std::size_t>(i / 3)] == 0) continue;
      a.row(i).setZero();
      a.col(i).setZero();
      a(i, i) = S(1);
    }
    factor_.compute(a);
    return factor_.info() == Eigen::Success ? 1 : 0;
  }
  const clothctl::VectorX<S>& mass() const { return mass_; }
  S drag() const { return S(0.2); }
  const clothctl::Points<S>& force() const { return force_; }
  const std::vector<unsigned char>& held() const { return held_; }
  template <int kLanes>
  void multiply(const clothctl::Lanes<S, kLanes>& w, clothctl::Lanes<S, kLanes>& stiffness,
                clothctl::Lanes<S, kLanes>& coupling) const {
    stiffness = w.lazyProduct(stiffness_);
    coupling = w.lazyProduct(coupling_);
  }
  template <int kLanes>
  void solve(clothctl::Lanes<S, kLanes>& w) {
    for (int lane = 0; lane < kLanes; ++lane) {
      const Eigen::Matrix<S, 6, 1> b = w.row(lane).transpose();
      const Eigen::Matrix<S, 6, 1> solved = factor_.solve(b);
      w.row(lane) = solved.transpose();
    }
  }
  void add_wind_force(const clothctl::Vector3<S>& dw, clothctl::Points<S>& out) const {
    out.colwise() += S(0.02) * dw;
  }

 private:
  clothctl::VectorX<S> mass_ = clothctl::VectorX<S>(2);
  clothctl::Points<S> force_;
  std::vector<unsigned char> held_;
  Eigen::Matrix<S, 6, 6> stiffness_, coupling_;
  // Factored at once: moving an Eigen factor that was never computed reads an uninitialised status.
  Eigen::LLT<Eigen::Matrix<S, 6, 6>> factor_ =
      Eigen::LLT<Eigen::Matrix<S, 6, 6>>(Eigen::Matrix<S, 6, 6>::Identity());
};

}  // namespace clothctl_test
