#pragma once

// Stable proportional-derivative (PD) control: the torque of a spring and a damper evaluated at the
// end of the coming step of length h, found together with the acceleration that it causes. M is the
// mass matrix, C the Coriolis and centrifugal torques, g the torques that hold the robot against
// gravity, τ_ext external torques, Kp and Kd the diagonal matrices of the gains kp and kd. With
// target position q̄ and target velocity v̄ at the end of the step:
//
//   Stable      (M + h Kd) q̈ = -C - Kp (q + h q̇ - q̄) - Kd (q̇ - v̄) + τ_ext
//               τ = -Kp (q + h q̇ - q̄) - Kd (q̇ + h q̈ - v̄) + g(q)
//   Implicit    (M + h Kd + h² Kp) q̈ = the same right-hand side
//               τ = -Kp (q + h q̇ + h² q̈ - q̄) - Kd (q̇ + h q̈ - v̄) + g(q)
//
// Further torques of the motors (`feed`) add to τ, as g(q) does.
//
// Without v̄, a target that moves at velocity v is followed with a lag of (kd/kp) v. Without g(q),
// joint i sags by g_i/kp_i. For one joint of mass m under symplectic Euler, Stable is stable for
// kd > 1.5 kp h - 2 m/h, and Implicit for all gains.
//
// A joint whose torque would exceed its limit is held at the limit, and the other joints are solved
// again with that torque. Clipping the torques after the solve would remove the implicit damping of
// those joints and can diverge.
//
// Reference: [Bai 2016], eq. 12 and 13, corrected (docs/robot.md); Tan, Liu, Turk, Stable
// Proportional-Derivative Controllers, IEEE CG&A 31 (2011).

#include <algorithm>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/concepts/articulated.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/robot/kinematic_tree_model.hpp"  // what is compiled once
#endif

namespace clothctl::inline CLOTHCTL_ABI {

/// Where the spring is evaluated.
enum class PdForm {
  /// Spring at q + h q̇, damper at q̇ + h q̈, as in [Bai 2016].
  Stable,
  /// Both at the end of the step, q + h q̇ + h² q̈: stable for all gains and steps, with a little
  /// more damping.
  Implicit
};

/// Gains and options of a controller.
template <RealScalar Scalar>
struct StablePdSettings {
  /// Stiffness of each coordinate (nv; N/m or N m/rad), ≥ 0.
  VectorX<Scalar> kp;
  /// Damping of each coordinate (nv; N s/m or N m s/rad), ≥ 0.
  VectorX<Scalar> kd;
  /// Time step h of the simulator (s), > 0.
  Scalar dt = Scalar(0.02);
  /// Where the spring is evaluated.
  PdForm form = PdForm::Stable;
  /// True to add g(q) to the torques.
  bool feed_gravity = true;
  /// True to use the target's velocity v̄.
  bool feed_velocity = true;
  /// True to keep torques within the model's effort limits.
  bool limit_torques = true;

  /// Returns settings with the same gains on all n coordinates; the defaults are those of [Bai
  /// 2016]. Allocates.
  static StablePdSettings uniform(Index n, const Scalar& kp = Scalar(800),
                                  const Scalar& kd = Scalar(100)) {
    StablePdSettings settings;
    settings.kp = VectorX<Scalar>::Constant(n, kp);
    settings.kd = VectorX<Scalar>::Constant(n, kd);
    return settings;
  }
  /// Returns settings for [Bai 2016], eq. 13 as printed: no feed-forward, so joints sag and lag.
  /// Allocates.
  static StablePdSettings paper(Index n) {
    StablePdSettings settings = uniform(n);
    settings.feed_gravity = settings.feed_velocity = false;
    return settings;
  }

  /// Returns an empty string when the settings are good for n coordinates, else a line that names
  /// the first bad value. Allocates.
  std::string validate(Index n) const {
    if (!is_finite(dt) || !(dt > Scalar(0))) return "dt is not a positive time: " + number_text(dt);
    const std::pair<const VectorX<Scalar>*, const char*> gains[] = {{&kp, "kp"}, {&kd, "kd"}};
    for (const auto& [gain, name] : gains) {
      if (gain->size() != n) {
        return std::string(name) + " has " + std::to_string(gain->size()) + " entries for " +
               std::to_string(n) + " coordinates";
      }
      for (Index i = 0; i < n; ++i) {
        if (is_finite((*gain)[i]) && !((*gain)[i] < Scalar(0))) continue;
        return std::string(name) + " of coordinate " + std::to_string(i) +
               " is negative or not finite: " + number_text((*gain)[i]);
      }
    }
    return {};
  }
};

/// Returns the least damping that keeps one joint stable with PdForm::Stable: max(0, 1.5 kp h - 2
/// m/h), where h is `dt` (s) and m is `mass`, the inertia that the joint moves (kg or kg m²).
template <RealScalar Scalar>
Scalar least_damping(const Scalar& kp, const Scalar& dt, const Scalar& mass) {
  return (std::max)(Scalar(0), Scalar(Scalar(1.5) * kp * dt - Scalar(2) * mass / dt));
}

/// How a control step ended.
enum class PdStatus {
  /// Torques and accelerations are finite and torques are within the limits. Apply them.
  Solved,
  /// After the last round some joints still exceeded their limits, and their torques were clipped.
  /// Apply the torques; check gains and time step.
  Clipped,
  /// Positions, velocities, target, external or further torques hold NaN or an infinity; nothing
  /// was written. Correct the input.
  InvalidInput,
  /// A vector is not as long as the robot's positions or velocities, or the robot is not the one
  /// that the controller was made for; nothing was written. Correct the call.
  WrongSize,
  /// The workspace was made for another robot; nothing was written. Make one for this robot.
  /// Reported where the model's trait offers `workspace_fits`.
  OtherWorkspace,
  /// No finite acceleration exists: the state has diverged (check gains and time step), or the
  /// coordinate in the report has neither inertia nor damping. Do not use the torques.
  NoInertia
};

/// Returns the name of a status.
constexpr std::string_view to_string(PdStatus status) {
  switch (status) {
    case PdStatus::Solved: return "solved";
    case PdStatus::Clipped: return "clipped";
    case PdStatus::InvalidInput: return "invalid_input";
    case PdStatus::WrongSize: return "wrong_size";
    case PdStatus::OtherWorkspace: return "other_workspace";
    case PdStatus::NoInertia: return "no_inertia";
  }
  return "unknown";
}

/// Result of a control step.
struct PdReport {
  /// How it ended.
  PdStatus status = PdStatus::Solved;
  /// Number of coordinates whose torque is at its limit.
  int saturated = 0;
  /// Number of solves for accelerations.
  int solves = 0;
  /// With NoInertia the velocity coordinate, else -1.
  Index coordinate = -1;
};

/// A stable PD controller of one robot: settings, and memory for a step.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedDynamics<Model, Scalar>
class StablePd {
 public:
  /// The robot's workspace.
  using Workspace = typename articulated_traits<Model>::workspace_type;
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;

  /// Creates a controller. Allocates. Fails when: `settings.validate` names a fault.
  static Result<StablePd> create(const Model& model, StablePdSettings<Scalar> settings);

  /// Creates a controller and checks that its gains are stable at positions q (nq). Allocates.
  /// Fails when: `settings.validate` names a fault, q is not finite or of a wrong size, or
  /// `unstable_at` names a coordinate.
  static Result<StablePd> create(const Model& model, StablePdSettings<Scalar> settings,
                                 const View& q);

  /// Returns the settings.
  const StablePdSettings<Scalar>& settings() const { return settings_; }
  /// Changes the time step (s) of the coming solves. Returns false, and changes nothing, when it is
  /// not finite and positive.
  bool set_time_step(const Scalar& dt) {
    if (!is_finite(dt) || !(Scalar(0) < dt)) return false;
    settings_.dt = dt;
    return true;
  }
  /// The diagonal (nv) that the last solve added to the mass matrix: h kd, or h kd + h² kp with
  /// PdForm::Implicit; 0 where a torque is at its limit. ArticulatedResponse takes it.
  const VectorX<Scalar>& diagonal() const { return diagonal_; }

  /// Returns the velocity coordinates whose damping is too low at positions q (nq), empty when the
  /// gains are stable (with PdForm::Implicit always). With too little damping the motion oscillates
  /// and grows. The condition is that 2 M/h + diag(kd - 1.5 kp h) is positive definite, which
  /// extends `least_damping` to every combined motion of the joints. Allocates. Complexity: O(nv³).
  /// Fails when: q or the workspace do not fit the robot.
  Result<std::vector<Index>> unstable_at(const Model& model, const View& q, Workspace& work) const;

  /// Computes torques and accelerations (nv each) of the coming step.
  ///
  /// * `q` (nq), `qd` (nv): positions and velocities now
  /// * `target` (nq), `target_velocity` (nv, or empty for zero): where to be at the end of the step
  /// * `external` (nv, or empty for zero): torques Jᵀ f of known contact forces (N or N m)
  /// * `feed` (nv, or empty for zero): further torques of the motors. `torques` and their limits
  ///   include them.
  ///
  /// A simulation step of the same model with these torques finds the same accelerations, up to
  /// rounding. Never allocates. Complexity: one forward dynamics, and one more for each round in
  /// which joints reach their limits, at most 9 in all. Fails when: see PdStatus.
  [[nodiscard]] PdReport solve(const Model& model, const View& q, const View& qd,
                               const View& target, const View& target_velocity,
                               const View& external, Workspace& work,
                               Eigen::Ref<VectorX<Scalar>> torques, Eigen::Ref<VectorX<Scalar>> qdd,
                               const View& feed = VectorX<Scalar>());

 private:
  static constexpr int kRounds = 8;

  PdStatus check_input(const Model& model, const View& q, const View& qd, const View& target,
                       const View& target_velocity, const View& external, const View& feed,
                       const Workspace& work) const;

  /// Sets the torques at q̈ = 0 (spring_) and the diagonal that multiplies q̈ (stiff_).
  void prepare(const Model& model, const View& q, const View& qd, const View& target,
               const View& target_velocity, Workspace& work);

  StablePd(const Model& model, StablePdSettings<Scalar> settings);

  StablePdSettings<Scalar> settings_;
  VectorX<Scalar> limits_, spring_, stiff_, push_, diagonal_, gravity_;
  std::vector<char> held_;  // 1 for joints held at their torque limit
  Index n_;
};

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
auto StablePd<Model, Scalar>::create(const Model& model, StablePdSettings<Scalar> settings)
    -> Result<StablePd> {
  if (std::string fault = settings.validate(articulated_traits<Model>::nv(model)); !fault.empty()) {
    return Error{std::move(fault)};
  }
  if (settings.limit_torques) {
    const Index n = articulated_traits<Model>::nv(model);
    const VectorX<Scalar> limits = articulated_traits<Model>::effort_limits(model);
    if (limits.size() != n)
      return Error{"the robot gives " + std::to_string(limits.size()) + " effort limits for " +
                   std::to_string(n) + " velocities"};
  }
  return StablePd(model, std::move(settings));
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
auto StablePd<Model, Scalar>::create(const Model& model, StablePdSettings<Scalar> settings,
                                     const View& q) -> Result<StablePd> {
  if (q.size() != articulated_traits<Model>::nq(model))
    return Error{"q has " + std::to_string(q.size()) + " entries, the robot has " +
                 std::to_string(articulated_traits<Model>::nq(model)) + " positions"};
  if (!all_finite(q)) return Error{"q holds NaN or an infinity"};
  Result<StablePd> made = create(model, std::move(settings));
  if (!made) return made;
  Workspace work = articulated_traits<Model>::make_workspace(model);
  const Result<std::vector<Index>> unstable = made->unstable_at(model, q, work);
  if (!unstable) return Error{unstable.error()};
  if (unstable->empty()) return made;
  const Index first = unstable->front();
  return Error{
      "kd of coordinate " + std::to_string(first) +
      " is too low for its kp and the time step: " + number_text(made->settings().kd[first]) +
      " (coordinates with that fault: " + std::to_string(unstable->size()) + ")"};
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
auto StablePd<Model, Scalar>::unstable_at(const Model& model, const View& q, Workspace& work) const
    -> Result<std::vector<Index>> {
  std::vector<Index> found;
  if (settings_.form == PdForm::Implicit) return found;
  using Traits = articulated_traits<Model>;
  const Index n = Traits::nv(model);
  if (n != n_ || q.size() != Traits::nq(model))
    return Error{"q or the robot is not of the size that the controller was made for"};
  if (!detail::workspace_fits(model, work))
    return Error{"the workspace was made for another robot"};
  const VectorX<Scalar> rest = VectorX<Scalar>::Constant(n, Scalar(0));
  VectorX<Scalar> held = rest, push = rest, one = rest;
  MatrixX<Scalar> S(n, n);
  Traits::forward_kinematics(model, q, work);
  Traits::inverse_dynamics(model, rest, rest, work, held);
  const Scalar h = settings_.dt;
  for (Index i = 0; i < n; ++i) {
    one[i] = Scalar(1);
    Traits::inverse_dynamics(model, rest, one, work, push);
    one[i] = Scalar(0);
    S.col(i) = (Scalar(2) / h) * (push - held);
  }
  S.diagonal() += settings_.kd - Scalar(1.5) * h * settings_.kp;
  // Elimination. A coordinate without a positive pivot is reported and left out.
  for (Index j = 0; j < n; ++j) {
    if (!(S(j, j) > Scalar(0))) {
      found.push_back(j);
      continue;
    }
    for (Index k = j + 1; k < n; ++k) {
      const Scalar share = S(j, k) / S(j, j);
      S.col(k).tail(n - j - 1) -= share * S.col(j).tail(n - j - 1);
    }
  }
  return found;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> PdReport StablePd<Model, Scalar>::solve(
    const Model& model, const View& q, const View& qd, const View& target,
    const View& target_velocity, const View& external, Workspace& work,
    Eigen::Ref<VectorX<Scalar>> torques, Eigen::Ref<VectorX<Scalar>> qdd, const View& feed) {
  using Traits = articulated_traits<Model>;
  PdReport report;
  const bool fits = Traits::nv(model) == n_ && torques.size() == n_ && qdd.size() == n_;
  report.status = fits ? check_input(model, q, qd, target, target_velocity, external, feed, work)
                       : PdStatus::WrongSize;
  if (report.status != PdStatus::Solved) return report;
  prepare(model, q, qd, target, target_velocity, work);
  if (feed.size() > 0) spring_ += feed;
  push_ = spring_;
  if (external.size() > 0) push_ += external;
  for (;;) {
    const Index missing = Traits::forward_dynamics(model, qd, push_, diagonal_, work, qdd);
    ++report.solves;
    if (missing >= 0) {
      report.status = PdStatus::NoInertia;
      report.coordinate = missing;
      return report;
    }
    const bool last = report.solves > kRounds;
    int beyond = 0;
    for (Index i = 0; i < n_; ++i) {
      if (held_[static_cast<std::size_t>(i)] != 0) continue;
      torques[i] = spring_[i] - stiff_[i] * qdd[i];
      const Scalar limit = limits_[i];
      if (!(torques[i] > limit) && !(torques[i] < -limit)) continue;
      ++beyond;
      torques[i] = torques[i] > Scalar(0) ? limit : Scalar(-limit);
      held_[static_cast<std::size_t>(i)] = 1;
      diagonal_[i] = Scalar(0);
      push_[i] = external.size() > 0 ? Scalar(torques[i] + external[i]) : torques[i];
    }
    report.saturated += beyond;
    if (beyond == 0) break;
    if (last) {
      report.status = PdStatus::Clipped;
      return report;
    }
  }
  // Inverse dynamics gives the same torques, and more digits for light joints: the difference of
  // spring and damper above cancels there.
  Traits::inverse_dynamics(model, qd, qdd, work, push_);
  for (Index i = 0; i < n_; ++i) {
    if (held_[static_cast<std::size_t>(i)] != 0) continue;
    torques[i] = external.size() > 0 ? Scalar(push_[i] - external[i]) : push_[i];
  }
  return report;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> PdStatus StablePd<Model, Scalar>::check_input(
    const Model& model, const View& q, const View& qd, const View& target,
    const View& target_velocity, const View& external, const View& feed, const Workspace& work)
const {
  const Index positions = articulated_traits<Model>::nq(model);
  const bool fits = q.size() == positions && target.size() == positions && qd.size() == n_ &&
                    (target_velocity.size() == 0 || target_velocity.size() == n_) &&
                    (external.size() == 0 || external.size() == n_) &&
                    (feed.size() == 0 || feed.size() == n_);
  if (!fits) return PdStatus::WrongSize;
  if (!detail::workspace_fits(model, work)) return PdStatus::OtherWorkspace;
  const bool finite = all_finite(q) && all_finite(qd) && all_finite(target) &&
                      all_finite(target_velocity) && all_finite(external) && all_finite(feed);
  return finite ? PdStatus::Solved : PdStatus::InvalidInput;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void StablePd<Model, Scalar>::prepare(const Model& model, const View& q, const View& qd,
                                      const View& target, const View& target_velocity,
                                      Workspace& work) {
  using Traits = articulated_traits<Model>;
  Traits::forward_kinematics(model, q, work);
  spring_.setConstant(Scalar(0));
  if (settings_.feed_gravity) Traits::inverse_dynamics(model, spring_, spring_, work, gravity_);
  Traits::difference(model, q, target, spring_);
  const Scalar h = settings_.dt;
  spring_ = settings_.kp.cwiseProduct(spring_ - h * qd) - settings_.kd.cwiseProduct(qd) + gravity_;
  if (settings_.feed_velocity && target_velocity.size() > 0)
    spring_ += settings_.kd.cwiseProduct(target_velocity);
  stiff_ = h * settings_.kd;
  if (settings_.form == PdForm::Implicit) stiff_ += (h * h) * settings_.kp;
  diagonal_ = stiff_;
  std::fill(held_.begin(), held_.end(), char(0));
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> StablePd<Model, Scalar>::StablePd(
    const Model& model, StablePdSettings<Scalar> settings)
    : settings_(std::move(settings)), n_(articulated_traits<Model>::nv(model)) {
  for (VectorX<Scalar>* v : {&spring_, &stiff_, &push_, &diagonal_, &gravity_}) v->setZero(n_);
  limits_ = VectorX<Scalar>::Constant(n_, scalar_traits<Scalar>::infinity());
  if (settings_.limit_torques) limits_ = articulated_traits<Model>::effort_limits(model);
  held_.assign(static_cast<std::size_t>(n_), 0);
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class StablePd<KinematicTree<double>, double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
