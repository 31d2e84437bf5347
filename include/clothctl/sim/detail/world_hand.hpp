#pragma once

// A hand, or any robot, within a world: its state, its controller, and how impulses change it. In a
// step, `predict` finds the velocities at its end that the controller leads to; impulses change
// them through the same matrix M + diag d; `finish` moves the joints with them.

#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/contact/articulated_response.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/robot/stable_pd.hpp"
#include "clothctl/sim/world_setup.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns "" or what is wrong with a vector of a hand that must have `size` finite entries: the
/// end of a message that begins with "hand 0 has".
template <RealScalar Scalar>
std::string find_bad_entry(const char* name, const VectorX<Scalar>& values, Index size) {
  if (values.size() != size)
    return std::string(name) + " of " + std::to_string(values.size()) + " entries, must be " +
           std::to_string(size);
  for (Index i = 0; i < size; ++i) {
    if (!is_finite(values[i]))
      return std::string(name) + " with the entry " + std::to_string(i) + " = " +
             number_text(values[i]) + ", must be finite";
  }
  return {};
}

/// A hand whose model is not known.
template <RealScalar Scalar>
class WorldHand {
 public:
  virtual ~WorldHand() = default;

  /// Finds torques and free velocities of a step of `dt` s that ends `rest` s before the target's
  /// time.
  virtual PdReport predict(const Scalar& dt, const Scalar& rest) = 0;
  /// Whether a frame exists.
  virtual bool has_frame(int frame) const = 0;
  /// Pose of a frame at the start of the step, and its velocity with the present velocities of the
  /// joints.
  virtual RigidMotion<Scalar> frame_motion(int frame) = 0;
  /// Adds an impulse (N s) at a point (m, world) of a frame to those that `take_impulses` takes.
  virtual void add_impulse(int frame, const Vector3<Scalar>& point,
                           const Vector3<Scalar>& impulse) = 0;
  /// Changes the velocities by the impulses that were added.
  virtual void take_impulses() = 0;
  /// Forgets them, after a step that failed.
  virtual void forget_impulses() = 0;
  /// Makes room for points of contact. Allocates.
  virtual void reserve(Index points) = 0;
  /// Prepares `side` for points (3×n, m, world) on frames.
  virtual ArticulatedStatus attach(std::span<const int> frames,
                                   const PointsView<Scalar>& points) = 0;
  /// The answer to impulses at the points.
  virtual ImpulseResponseRef<Scalar> side() = 0;
  /// Takes the velocities of `side`.
  virtual void take_side() = 0;
  /// Moves the joints. Returns false where they are no longer finite, or faster than 1e4 (rad/s or
  /// m/s).
  virtual bool finish(const Scalar& dt) = 0;
  /// Computes the frames at `state.positions`.
  virtual void update_frames() = 0;

  /// Returns "" or what is wrong with a state of this hand, as `find_bad_entry` does.
  std::string check_state(const HandState<Scalar>& other) const {
    std::string bad = find_bad_entry("positions", other.positions, state.positions.size());
    if (bad.empty()) bad = find_bad_entry("velocities", other.velocities, state.velocities.size());
    return bad;
  }
  /// Returns "" or what is wrong with its drive, as `find_bad_entry` does.
  std::string check_drive() const {
    const Index nv = state.velocities.size();
    std::string bad = find_bad_entry("a target", drive.target, state.positions.size());
    if (bad.empty()) bad = find_bad_entry("a target_velocity", drive.target_velocity, nv);
    if (bad.empty() && drive.torque.size() > 0) bad = find_bad_entry("a torque", drive.torque, nv);
    return bad;
  }

  HandState<Scalar> state;
  HandDrive<Scalar> drive;
  VectorX<Scalar> torques;
};

/// A hand of a model.
template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
class WorldHandOf : public WorldHand<Scalar> {
 public:
  using Traits = articulated_traits<Model>;

  WorldHandOf(Model m, StablePd<Model, Scalar> pd, const HandSetup<Scalar>& setup)
      : model_(std::move(m)),
        pd_(std::move(pd)),
        work_(Traits::make_workspace(model_)),
        response_(model_, 0) {
    const Index nv = Traits::nv(model_);
    const VectorX<Scalar> zero = VectorX<Scalar>::Constant(nv, Scalar(0));
    this->state = {setup.positions, setup.velocities.size() > 0 ? setup.velocities : zero};
    this->drive = {setup.positions, zero, zero};
    for (VectorX<Scalar>* v :
         {&this->torques, &qdd_, &sum_, &rest_, &push_, &free_, &step_, &predicted_})
      *v = zero;
    next_ = setup.positions;
    J_.setConstant(6, nv, Scalar(0));
    update_frames();
  }

  PdReport predict(const Scalar& dt, const Scalar& rest) override {
    HandState<Scalar>& s = this->state;
    const HandDrive<Scalar>& d = this->drive;
    PdReport report;
    report.status = PdStatus::InvalidInput;
    if (!pd_.set_time_step(dt)) return report;
    report.status = PdStatus::WrongSize;
    if (d.target.size() != next_.size() || d.target_velocity.size() != step_.size()) return report;
    next_ = d.target;
    if (Scalar(0) < rest) {
      step_ = -rest * d.target_velocity;
      Traits::advance(model_, d.target, step_, next_);
    }
    report = pd_.solve(model_, s.positions, s.velocities, next_, d.target_velocity,
                       VectorX<Scalar>(), work_, this->torques, qdd_, d.torque);
    const bool found = report.status == PdStatus::Solved || report.status == PdStatus::Clipped;
    if (!found) return report;
    s.velocities += dt * qdd_;
    predicted_ = s.velocities;
    return report;
  }
  bool has_frame(int frame) const override { return detail::has_frame(model_, frame); }
  RigidMotion<Scalar> frame_motion(int frame) override {
    RigidMotion<Scalar> out;
    Traits::frame_pose(model_, work_, frame, out.R_world_body, out.position);
    Traits::point_jacobian(model_, work_, frame, out.position, J_);
    const VectorX<Scalar>& qd = this->state.velocities;
    for (Index c = 0; c < 3; ++c) {
      out.velocity[c] = J_.row(c).dot(qd);
      out.angular_velocity[c] = J_.row(c + 3).dot(qd);
    }
    return out;
  }
  void add_impulse(int frame, const Vector3<Scalar>& point,
                   const Vector3<Scalar>& impulse) override {
    Traits::point_jacobian(model_, work_, frame, point, J_);
    for (Index c = 0; c < 3; ++c) sum_ += impulse[c] * J_.row(c).transpose();
    pushed_ = true;
  }
  void take_impulses() override {
    if (!pushed_) return;
    // H⁻¹ of a torque is the difference of two solves, since each has gravity in it.
    const bool found =
        Traits::forward_dynamics(model_, rest_, sum_, pd_.diagonal(), work_, push_) < 0 &&
        Traits::forward_dynamics(model_, rest_, rest_, pd_.diagonal(), work_, free_) < 0;
    if (found) this->state.velocities += push_ - free_;
    forget_impulses();
  }
  void forget_impulses() override {
    sum_.setConstant(Scalar(0));
    pushed_ = false;
  }
  void reserve(Index points) override {
    response_ = ArticulatedResponse<Model, Scalar>(model_, points);
  }
  ArticulatedStatus attach(std::span<const int> frames, const PointsView<Scalar>& points) override {
    return response_.update(model_, work_, this->state.velocities, pd_.diagonal(), frames, points);
  }
  ImpulseResponseRef<Scalar> side() override { return ImpulseResponseRef<Scalar>(response_); }
  void take_side() override { this->state.velocities = response_.joint_velocities(); }
  bool finish(const Scalar& dt) override {
    HandState<Scalar>& s = this->state;
    // What contact changed, spring and damper of the controller answered within the step.
    step_ = s.velocities - predicted_;
    this->torques -= pd_.diagonal().cwiseProduct(step_) / dt;
    step_ = dt * s.velocities;
    Traits::advance(model_, s.positions, step_, next_);
    if (!all_finite(next_) || !all_finite(s.velocities)) return false;
    // Faster is no motion of a hand: forces of velocities then grow without bounds, step by step.
    for (Index i = 0; i < s.velocities.size(); ++i) {
      if (Scalar(1e4) < s.velocities[i] || s.velocities[i] < Scalar(-1e4)) return false;
    }
    s.positions = next_;
    update_frames();
    return true;
  }
  void update_frames() override {
    Traits::forward_kinematics(model_, this->state.positions, work_);
  }

 private:
  Model model_;
  StablePd<Model, Scalar> pd_;
  typename Traits::workspace_type work_;
  ArticulatedResponse<Model, Scalar> response_;
  VectorX<Scalar> qdd_, sum_, rest_, push_, free_, step_, next_, predicted_;
  MatrixX<Scalar> J_;
  bool pushed_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
