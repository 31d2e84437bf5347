#pragma once

// From where fingertips shall be to what drives a hand (sim/hand_setup.hpp): positions by inverse
// kinematics, their velocities, and torques. The fingertips are the first task, the posture of the
// fingers the second:
//
//   dq = J⁺ e + N (q_posture - q)        J⁺: damped pseudo-inverse, N: what the tips leave free
//
// within the limits of the joints. Joints that carry all fingers, as an arm or a floating base,
// have no posture: they go where the fingers go. With half-spaces, ConstrainedIk takes its place.
//
// The torques fed forward are those of the motion of the targets, and of the forces that the
// fingers shall exert:
//
//   τ = M(q) a + C(q, v) v + Σ Jᵀ f        v, a: of the targets
//
// So a hand of stable PD control (robot/stable_pd.hpp) follows a moving target without lag, and
// does not yield to a load that was planned.
//
// Reference: [Bai 2016], section 4.3.

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/contact/grip.hpp"
#include "clothctl/grasp/grasp_poses.hpp"
#include "clothctl/qp/active_set.hpp"
#include "clothctl/robot/constrained_ik.hpp"
#include "clothctl/robot/prioritised_ik.hpp"
#include "clothctl/sim/hand_setup.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Where a fingertip shall be.
template <RealScalar Scalar>
struct FingertipTarget {
  /// Which finger.
  int finger = 0;
  /// Where the centre of its tip shall be (FingerPad::centre), world, m.
  Vector3<Scalar> place = Vector3<Scalar>::Constant(Scalar(0));
  /// How its frame shall be turned: from the frame to the world.
  Matrix3<Scalar> R_world_frame = Matrix3<Scalar>::Identity();
  /// The force that it shall exert there, N (world): fed forward.
  Vector3<Scalar> force = Vector3<Scalar>::Constant(Scalar(0));
};

/// Settings of FingertipTracker.
template <RealScalar Scalar>
struct FingertipSettings {
  /// The length that a turn of a fingertip by one radian counts as, m; 0: turns do not matter.
  Scalar turn_length = Scalar(2e-3);
  /// How near to its target a fingertip must come, m.
  Scalar tolerance = Scalar(2e-5);
  /// Largest speed of a joint, m/s or rad/s.
  Scalar joint_speed = Scalar(10);
  /// Iterations of inverse kinematics in a call.
  int max_iterations = 4;
  /// Whether the torques of the motion and of the forces are fed forward.
  bool feed_motion = true, feed_forces = true;

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    const auto positive = [](const Scalar& v) { return is_finite(v) && Scalar(0) < v; };
    if (!is_finite(turn_length) || turn_length < Scalar(0))
      return "turn_length is " + number_text(turn_length) + " m, must be finite and not negative";
    if (!positive(tolerance))
      return "tolerance is " + number_text(tolerance) + " m, must be finite and positive";
    if (!positive(joint_speed))
      return "joint_speed is " + number_text(joint_speed) + ", must be finite and positive";
    if (max_iterations < 1)
      return "max_iterations is " + std::to_string(max_iterations) + ", must be at least 1";
    return {};
  }
};

/// Brings the fingertips of one hand to targets, from step to step.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedDynamics<Model, Scalar>
class FingertipTracker {
 public:
  /// Makes the tracker of a hand, which must outlive it. Allocates. Fails when: there are no
  /// fingers, a finger is not valid, or `settings.validate()` does.
  static Result<FingertipTracker> create(const Model& model, std::vector<FingerPad<Scalar>> fingers,
                                         const FingertipSettings<Scalar>& settings = {});

  /// Starts at rest at positions q (nq), which are also the posture. Returns false, and changes
  /// nothing, when q is of another size or not finite.
  [[nodiscard]] bool start(const VectorX<Scalar>& q);
  /// Sets the posture (nq) that joints go to where the fingertips leave them free. Returns false,
  /// and changes nothing, when it is of another size or not finite.
  [[nodiscard]] bool set_posture(const VectorX<Scalar>& q);
  /// Sets the half-spaces that points of the hand shall stay in, at most 64. Returns an empty
  /// string, or what is wrong, with the number of the half-space; nothing changes then. Allocates.
  [[nodiscard]] std::string set_half_spaces(std::span<const HalfSpace<Scalar>> planes);

  /// Moves the positions so that the fingertips are at their targets (at most one for a finger),
  /// and writes what drives the hand there within `dt` (s). Never allocates, but with half-spaces
  /// in the first call. Where targets are not reached, the hand goes as near as it can. With
  /// InvalidInput nothing is changed.
  IkReport<Scalar> track(std::span<const FingertipTarget<Scalar>> targets, const Scalar& dt,
                         HandDrive<Scalar>& drive);
  /// Moves to positions q (nq) within `dt` (s). Returns false, and changes nothing, when sizes
  /// differ, q is not finite or dt not positive. Never allocates.
  [[nodiscard]] bool move_to(const VectorX<Scalar>& q, const Scalar& dt, HandDrive<Scalar>& drive);
  /// Stops where the targets are now.
  void stop(HandDrive<Scalar>& drive);

  /// Positions (nq) of the last targets.
  const VectorX<Scalar>& positions() const { return q_; }
  /// Writes how a finger's frame is turned and where the centre of its tip is at these positions.
  /// The finger must exist (assert).
  void pose(int finger, Matrix3<Scalar>& R_world_frame, Vector3<Scalar>& centre);
  /// The same at positions q (nq).
  void pose_at(const VectorX<Scalar>& q, int finger, Matrix3<Scalar>& R_world_frame,
               Vector3<Scalar>& centre);
  /// Largest force along `direction` (unit, world) that a finger can exert at the last targets
  /// beside holding the hand up, N: where the first joint reaches its effort limit. 0 where there
  /// is no such finger or direction. Never allocates.
  Scalar largest_force(int finger, const Vector3<Scalar>& direction);

  /// Writes to `out` limits for grip `grip`, whose centroid is at `place` (world, m): half-spaces
  /// in which the joints that carry all fingers stay within their limits while the hand moves
  /// without turning, to first order about the last targets. Returns their number; the nearest come
  /// first. Without such joints, or where they cannot move it like this, there are none. A joint at
  /// its limit blocks a direction, though a redundant arm might go round it. In float, an arm that
  /// is stretched to within 0.1 rad counts as one that cannot move along itself. Never allocates.
  std::size_t reach(int grip, const Vector3<Scalar>& place, std::span<GripLimit<Scalar>> out);

  /// The fingers.
  std::span<const FingerPad<Scalar>> fingers() const { return fingers_; }
  /// The hand.
  const Model& model() const { return *model_; }

 private:
  using Traits = articulated_traits<Model>;

  FingertipTracker(const Model& model, std::vector<FingerPad<Scalar>> fingers,
                   const FingertipSettings<Scalar>& settings);

  static IkSettings<Scalar> ik_settings(const FingertipSettings<Scalar>& settings) {
    IkSettings<Scalar> out;
    out.tolerance = settings.tolerance;
    out.max_iterations = settings.max_iterations;
    out.fallbacks = false;
    out.refine_posture = false;
    return out;
  }
  void find_carriers(const VectorX<Scalar>& q);
  /// Writes to the first three rows of `jacobian_`, where forward kinematics was last, the least
  /// velocities of the joints that carry all fingers for a unit velocity of the hand along each
  /// axis, and zero for other joints.
  void find_carrying_rates();
  /// Writes the Jacobian of the centre of a tip to `jacobian_`, where forward kinematics was last.
  void linearise(const FingerPad<Scalar>& finger);
  /// The part of column i of that Jacobian along a direction.
  Scalar along(Index i, const Vector3<Scalar>& direction) const {
    return Vector3<Scalar>(jacobian_.col(i).template head<3>()).dot(direction);
  }
  /// Writes the drive to `found_`, which is dt away.
  void write(std::span<const FingertipTarget<Scalar>> targets, const Scalar& dt,
             HandDrive<Scalar>& drive);
  bool fits(const HandDrive<Scalar>& drive) const {
    return drive.target.size() == q_.size() && drive.target_velocity.size() == qd_.size() &&
           drive.torque.size() == qd_.size();
  }

  const Model* model_;
  std::vector<FingerPad<Scalar>> fingers_;
  FingertipSettings<Scalar> settings_;
  typename Traits::workspace_type work_;
  PrioritisedIk<Model, Scalar> ik_;
  ConstrainedIk<Model, ActiveSet<Scalar>, Scalar> constrained_;
  std::vector<IkTask<Scalar>> tasks_;
  static constexpr int kMostPlanes = 64;
  std::vector<HalfSpace<Scalar>> planes_;
  std::vector<bool> carries_;  // of each velocity coordinate: moves all fingers as one body
  VectorX<Scalar> q_, found_, posture_, reference_, qd_, next_, step_, still_, torque_, effort_;
  MatrixX<Scalar> jacobian_;
};

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> FingertipTracker<Model, Scalar>::FingertipTracker(
    const Model& model, std::vector<FingerPad<Scalar>> fingers,
    const FingertipSettings<Scalar>& settings)
    : model_(&model),
      fingers_(std::move(fingers)),
      settings_(settings),
      work_(Traits::make_workspace(model)),
      ik_(model, 2 * static_cast<int>(fingers_.size()), 1, ik_settings(settings)),
      constrained_(model, 2 * static_cast<int>(fingers_.size()), kMostPlanes,
                   ik_settings(settings)) {
  const Index nq = Traits::nq(model), nv = Traits::nv(model);
  q_ = found_ = posture_ = reference_ = VectorX<Scalar>::Constant(nq, Scalar(0));
  qd_ = next_ = step_ = still_ = torque_ = effort_ = VectorX<Scalar>::Constant(nv, Scalar(0));
  jacobian_ = MatrixX<Scalar>::Constant(6, nv, Scalar(0));
  carries_.assign(static_cast<std::size_t>(nv), true);
  tasks_.reserve(2 * fingers_.size());
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
auto FingertipTracker<Model, Scalar>::create(const Model& model,
                                             std::vector<FingerPad<Scalar>> fingers,
                                             const FingertipSettings<Scalar>& settings)
    -> Result<FingertipTracker> {
  if (const std::string bad = settings.validate(); !bad.empty()) return Error{bad};
  if (fingers.empty()) return Error{"the hand has no finger pads"};
  for (std::size_t i = 0; i < fingers.size(); ++i) {
    const std::string name = "finger " + std::to_string(i) + " (" + fingers[i].name + ")";
    if (!detail::has_frame(model, fingers[i].frame))
      return Error{name + " is on frame " + std::to_string(fingers[i].frame) +
                   ", which does not exist"};
    if (!all_finite(fingers[i].centre())) return Error{name + " has a point that is not finite"};
  }
  return FingertipTracker(model, std::move(fingers), settings);
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void FingertipTracker<Model, Scalar>::find_carriers(const VectorX<Scalar>& q) {
  Traits::forward_kinematics(*model_, q, work_);
  linearise(fingers_.front());
  const MatrixX<Scalar> first = jacobian_;
  Matrix3<Scalar> R;
  Vector3<Scalar> p;
  Traits::frame_pose(*model_, work_, fingers_.front().frame, R, p);
  const Vector3<Scalar> middle = p + R * fingers_.front().centre();
  for (Index i = 0; i < first.cols(); ++i)
    carries_[static_cast<std::size_t>(i)] = Scalar(0) < first.col(i).squaredNorm();
  // Coupled joints of several fingers move them, too, but not as one body.
  const Scalar close = Scalar(1e4) * scalar_traits<Scalar>::epsilon();
  for (const FingerPad<Scalar>& f : fingers_) {
    Traits::point_jacobian(*model_, work_, f.frame, middle, jacobian_);
    for (Index i = 0; i < first.cols(); ++i) {
      const Scalar apart = (jacobian_.col(i) - first.col(i)).squaredNorm();
      if (!(apart <= close * close * first.col(i).squaredNorm()))
        carries_[static_cast<std::size_t>(i)] = false;
    }
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void FingertipTracker<Model, Scalar>::linearise(const FingerPad<Scalar>& finger) {
  Matrix3<Scalar> R;
  Vector3<Scalar> p;
  Traits::frame_pose(*model_, work_, finger.frame, R, p);
  Traits::point_jacobian(*model_, work_, finger.frame, Vector3<Scalar>(p + R * finger.centre()),
                         jacobian_);
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
bool FingertipTracker<Model, Scalar>::start(const VectorX<Scalar>& q) {
  if (!set_posture(q)) return false;
  find_carriers(q);
  q_ = q;
  qd_.setConstant(Scalar(0));
  return true;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
bool FingertipTracker<Model, Scalar>::set_posture(const VectorX<Scalar>& q) {
  if (q.size() != q_.size() || !all_finite(q)) return false;
  posture_ = q;
  return true;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> std::string
FingertipTracker<Model, Scalar>::set_half_spaces(std::span<const HalfSpace<Scalar>> planes) {
  if (planes.size() > kMostPlanes)
    return std::to_string(planes.size()) + " half-spaces, at most " + std::to_string(kMostPlanes);
  for (std::size_t i = 0; i < planes.size(); ++i) {
    if (const auto bad = detail::find_bad_plane(*model_, planes[i]); !bad.empty())
      return "half-space " + std::to_string(i) + ": " + std::string(bad);
  }
  planes_.assign(planes.begin(), planes.end());
  return {};
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> IkReport<Scalar> FingertipTracker<Model, Scalar>::track(
    std::span<const FingertipTarget<Scalar>> targets, const Scalar& dt, HandDrive<Scalar>& drive) {
  IkReport<Scalar> report;
  report.status = IkStatus::InvalidInput;
  if (!is_finite(dt) || !(Scalar(0) < dt)) report.message = "the step length is not positive";
  if (!fits(drive)) report.message = "the drive is not that of this hand";
  if (targets.size() > fingers_.size()) report.message = "there are more targets than fingers";
  tasks_.clear();
  for (const FingertipTarget<Scalar>& t : targets) {
    if (t.finger < 0 || static_cast<std::size_t>(t.finger) >= fingers_.size())
      report.message = "a target is for a finger that does not exist";
    else if (!all_finite(t.force))
      report.message = "a force holds NaN or an infinity";
    if (!report.message.empty()) break;
    const FingerPad<Scalar>& f = fingers_[static_cast<std::size_t>(t.finger)];
    tasks_.push_back(IkTask<Scalar>::position(f.frame, f.centre(), t.place));
    if (Scalar(0) < settings_.turn_length)
      tasks_.push_back(
          IkTask<Scalar>::orientation(f.frame, t.R_world_frame, settings_.turn_length));
  }
  if (!report.message.empty()) return report;
  // Where a joint carries all fingers, its reference is where it is.
  Traits::difference(*model_, q_, posture_, step_);
  for (Index i = 0; i < step_.size(); ++i) {
    if (carries_[static_cast<std::size_t>(i)]) step_[i] = Scalar(0);
  }
  Traits::advance(*model_, q_, step_, reference_);
  found_ = q_;
  const int level[] = {static_cast<int>(tasks_.size())};
  report = planes_.empty() ? ik_.solve(*model_, tasks_, level, reference_, found_)
                           : constrained_.solve(*model_, tasks_, planes_, reference_, found_);
  if (report.status == IkStatus::InvalidInput) return report;
  write(targets, dt, drive);
  return report;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
bool FingertipTracker<Model, Scalar>::move_to(const VectorX<Scalar>& q, const Scalar& dt,
                                              HandDrive<Scalar>& drive) {
  if (q.size() != q_.size() || !all_finite(q) || !fits(drive)) return false;
  if (!is_finite(dt) || !(Scalar(0) < dt)) return false;
  found_ = q;
  write({}, dt, drive);
  return true;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void FingertipTracker<Model, Scalar>::write(std::span<const FingertipTarget<Scalar>> targets,
                                            const Scalar& dt, HandDrive<Scalar>& drive) {
  Traits::difference(*model_, q_, found_, step_);
  const Scalar most = settings_.joint_speed * dt;
  bool limited = false;
  for (Index i = 0; i < step_.size(); ++i) {
    limited = limited || most < step_[i] || step_[i] < -most;
    if (most < step_[i]) step_[i] = most;
    if (step_[i] < -most) step_[i] = -most;
  }
  if (limited) Traits::advance(*model_, q_, step_, found_);
  drive.target = q_ = found_;
  next_ = step_ / dt;
  drive.target_velocity = next_;
  drive.torque.setConstant(Scalar(0));
  Traits::forward_kinematics(*model_, q_, work_);
  if (settings_.feed_motion) {
    step_ = (next_ - qd_) / dt;
    Traits::inverse_dynamics(*model_, next_, step_, work_, drive.torque);
    Traits::inverse_dynamics(*model_, still_, still_, work_, torque_);
    drive.torque -= torque_;  // stable PD adds what gravity needs
  }
  qd_ = next_;
  if (!settings_.feed_forces) return;
  for (const FingertipTarget<Scalar>& t : targets) {
    if (!(Scalar(0) < t.force.squaredNorm())) continue;
    linearise(fingers_[static_cast<std::size_t>(t.finger)]);
    for (Index i = 0; i < jacobian_.cols(); ++i) drive.torque[i] += along(i, t.force);
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void FingertipTracker<Model, Scalar>::stop(HandDrive<Scalar>& drive) {
  if (!fits(drive)) return;
  qd_.setConstant(Scalar(0));
  drive.target = q_;
  drive.target_velocity.setConstant(Scalar(0));
  drive.torque.setConstant(Scalar(0));
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void FingertipTracker<Model, Scalar>::pose(int finger, Matrix3<Scalar>& R_world_frame,
                                           Vector3<Scalar>& centre) {
  pose_at(q_, finger, R_world_frame, centre);
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void FingertipTracker<Model, Scalar>::pose_at(const VectorX<Scalar>& q, int finger,
                                              Matrix3<Scalar>& R_world_frame,
                                              Vector3<Scalar>& centre) {
  assert(finger >= 0 && static_cast<std::size_t>(finger) < fingers_.size());
  const FingerPad<Scalar>& f = fingers_[static_cast<std::size_t>(finger)];
  Traits::forward_kinematics(*model_, q, work_);
  Traits::frame_pose(*model_, work_, f.frame, R_world_frame, centre);
  centre += R_world_frame * f.centre();
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> Scalar
FingertipTracker<Model, Scalar>::largest_force(int finger, const Vector3<Scalar>& direction) {
  using std::abs;
  if (finger < 0 || static_cast<std::size_t>(finger) >= fingers_.size()) return Scalar(0);
  if (!all_finite(direction) || !(Scalar(0) < direction.squaredNorm())) return Scalar(0);
  Traits::forward_kinematics(*model_, q_, work_);
  Traits::inverse_dynamics(*model_, still_, still_, work_, torque_);
  linearise(fingers_[static_cast<std::size_t>(finger)]);
  effort_ = Traits::effort_limits(*model_);
  Scalar most = scalar_traits<Scalar>::infinity();
  for (Index i = 0; i < effort_.size(); ++i) {
    const Scalar arm = along(i, direction);
    if (!(Scalar(0) < abs(arm)) || !is_finite(effort_[i])) continue;
    const Scalar room =
        Scalar(0) < arm ? Scalar(effort_[i] - torque_[i]) : Scalar(effort_[i] + torque_[i]);
    const Scalar force = room < Scalar(0) ? Scalar(0) : Scalar(room / abs(arm));
    if (force < most) most = force;
  }
  return most;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void FingertipTracker<Model, Scalar>::find_carrying_rates() {
  MatrixX<Scalar>& J = jacobian_;
  linearise(fingers_.front());
  for (Index i = 0; i < J.cols(); ++i) {
    if (!carries_[static_cast<std::size_t>(i)]) J.col(i).setConstant(Scalar(0));
  }
  // Jᵀ (J Jᵀ)⁻¹, a column for each axis; the tiny ridge is for directions that no joint moves.
  using Square = Eigen::Matrix<Scalar, 6, 6>;
  Square normal;
  for (Index c = 0; c < 6; ++c) {
    for (Index r = 0; r < 6; ++r) normal(r, c) = J.row(r).dot(J.row(c));
  }
  const Scalar ridge =
      Scalar(1e-9) + Scalar(16) * scalar_traits<Scalar>::epsilon() * normal.trace();
  normal.diagonal().array() += ridge;
  const Square one = Square::Identity();
  Eigen::Matrix<Scalar, 6, 3> share = normal.ldlt().solve(one.template leftCols<3>());
  // ridge · share is by how much the motion is missed. Directions in which more than a tenth is
  // missed are left out, the others stay: K starts with eigenvalues 1/(1 + 100 m²), m: the share
  // that is missed, and K²(3 - 2 K) brings each to the nearer of 0 and 1.
  const Matrix3<Scalar> one3 = Matrix3<Scalar>::Identity();
  Matrix3<Scalar> K = one3 + (Scalar(100) * ridge * ridge) * (share.transpose() * share);
  K = Matrix3<Scalar>(K.ldlt().solve(one3));
  for (int i = 0; i < 5; ++i)
    K = Matrix3<Scalar>(Matrix3<Scalar>(K * K) * Matrix3<Scalar>(Scalar(3) * one3 - Scalar(2) * K));
  share = share * K;
  for (Index i = 0; i < J.cols(); ++i) {
    const Eigen::Matrix<Scalar, 6, 1> column = J.col(i);
    for (Index axis = 0; axis < 3; ++axis) J(axis, i) = column.dot(share.col(axis));
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> std::size_t FingertipTracker<Model, Scalar>::reach(
    int grip, const Vector3<Scalar>& place, std::span<GripLimit<Scalar>> out) {
  using std::sqrt;
  if (out.empty() || !all_finite(place)) return 0;
  Traits::forward_kinematics(*model_, q_, work_);
  find_carrying_rates();
  std::size_t count = 0;
  for (const int side : {1, -1}) {
    const Scalar sign = side > 0 ? Scalar(1) : Scalar(-1);
    if (side > 0) reference_ = Traits::upper(*model_);
    if (side < 0) reference_ = Traits::lower(*model_);
    detail::way_to_limits<Model, Scalar>(*model_, q_, reference_, sign, found_, step_);
    for (Index i = 0; i < step_.size(); ++i) {
      const Vector3<Scalar> rate = sign * jacobian_.col(i).template head<3>();
      const Scalar size = sqrt(rate.squaredNorm());
      // Rates below are rounding.
      if (is_unbounded(step_[i]) || !(Scalar(1e-3) < size)) continue;
      const Scalar room = sign * step_[i];
      const Scalar way = (room < Scalar(0) ? Scalar(0) : room) / size;
      if (count == out.size() && !(way < out[count - 1].most)) continue;
      std::size_t k = count < out.size() ? count++ : count - 1;
      for (; k > 0 && way < out[k - 1].most; --k) out[k] = out[k - 1];
      out[k] = {grip, -1, rate / size, way};
    }
  }
  for (GripLimit<Scalar>& limit : out.first(count)) limit.most += limit.normal.dot(place);
  return count;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class ConstrainedIk<KinematicTree<double>, ActiveSet<double>, double>);
CLOTHCTL_INSTANTIATE(class FingertipTracker<KinematicTree<double>, double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
