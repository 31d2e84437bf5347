#pragma once

// Stable proportional-derivative control: the torque of a spring and a damper at the end of the step, found together with the
// acceleration that it causes.
//
//   τ = -Kp (q + h q̇ - q̄) - Kd (q̇ + h q̈ - v̄) + g(q)
//   (M + h Kd) q̈ = -C - Kp (q + h q̇ - q̄) - Kd (q̇ - v̄) + τ_ext                                                  Stable
//   (M + h Kd + h² Kp) q̈ = the same,   τ = -Kp (q + h q̇ + h² q̈ - q̄) - Kd (q̇ + h q̈ - v̄) + g(q)               Implicit
//
// q̄, v̄ are the target at the end of the step. Without v̄ a target moving at v is followed kd/kp v behind; without
// g(q) joint i sags by g_i/kp_i. One joint of mass m under symplectic Euler is stable for kd > 1.5 kp h - 2 m/h; Implicit for
// all gains. A torque beyond its limit is held there, and the others are solved again with it: clipping afterwards would take
// the implicit damping away, and can diverge. Reference: Bai, Yu, Liu (2016) eq. 12, 13, corrected (docs/robot.md); Tan, Liu,
// Turk (2011).

#include <algorithm>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/concepts/articulated.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"

namespace clothctl::robot {

/// How the spring is taken.
enum class PdForm {
  /// Spring at q + h q̇, damper at q̇ + h q̈: the paper's.
  Stable,
  /// Both at the end of the step: no limit on gains and step, a little more damping.
  Implicit
};

/// Gains and choices of a controller.
template <RealScalar Scalar>
struct StablePdSettings {
  /// Stiffness of each coordinate (N/m or N m/rad), ≥ 0.
  VectorX<Scalar> kp;
  /// Damping of each coordinate (N s/m or N m s/rad), ≥ 0.
  VectorX<Scalar> kd;
  /// Time step of the simulator (s), > 0.
  Scalar step = Scalar(0.02);
  /// How the spring is taken.
  PdForm form = PdForm::Stable;
  /// Whether gravity is fed forward.
  bool feed_gravity = true;
  /// Whether the target's velocity is fed forward.
  bool feed_velocity = true;
  /// Whether torques keep the model's limits.
  bool limit_torques = true;

  /// The paper's gains, Kp = 800 and Kd = 100 on every of n coordinates. Allocates.
  static StablePdSettings uniform(Index n, const Scalar& kp = Scalar(800), const Scalar& kd = Scalar(100)) {
    StablePdSettings settings;
    settings.kp = VectorX<Scalar>::Constant(n, kp);
    settings.kd = VectorX<Scalar>::Constant(n, kd);
    return settings;
  }
  /// The paper's equation 13 as printed, without feed-forward: it sags and lags. Allocates.
  static StablePdSettings paper(Index n) {
    StablePdSettings settings = uniform(n);
    settings.feed_gravity = settings.feed_velocity = false;
    return settings;
  }

  /// Names what is wrong for n coordinates, or "". Allocates.
  std::string check(Index n) const {
    if (!is_finite(step) || !(step > Scalar(0))) return "step is not a positive time: " + number_text(step);
    const std::pair<const VectorX<Scalar>*, const char*> gains[] = {{&kp, "kp"}, {&kd, "kd"}};
    for (const auto& [gain, name] : gains) {
      if (gain->size() != n) {
        return std::string(name) + " has " + std::to_string(gain->size()) + " entries for " + std::to_string(n) +
               " coordinates";
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

/// The least damping that keeps one joint stable: 1.5 kp h - 2 m/h, at least 0. `mass` is the inertia that the joint feels.
template <RealScalar Scalar>
Scalar least_damping(const Scalar& kp, const Scalar& step, const Scalar& mass) {
  return (std::max)(Scalar(0), Scalar(Scalar(1.5) * kp * step - Scalar(2) * mass / step));
}

/// How a control step ended.
enum class PdStatus {
  /// Torques and accelerations are finite and keep the limits. Apply them.
  Solved,
  /// Joints still went beyond their limits after all rounds and were clipped. Apply the torques; look at gains and step.
  Clipped,
  /// Positions, velocities, target or external torques hold NaN or an infinity; nothing was written. Mend the input.
  InvalidInput,
  /// A vector is not as long as the robot's positions or velocities; nothing was written. Mend the call.
  WrongSize,
  /// No finite acceleration exists: the state has grown beyond numbers (look at gains and step), or the coordinate in the
  /// report has neither inertia nor damping. Torques are not to be used.
  NoInertia
};

/// Names a status.
constexpr std::string_view to_string(PdStatus status) {
  switch (status) {
    case PdStatus::Solved: return "solved";
    case PdStatus::Clipped: return "clipped";
    case PdStatus::InvalidInput: return "invalid_input";
    case PdStatus::WrongSize: return "wrong_size";
    case PdStatus::NoInertia: return "no_inertia";
  }
  return "unknown";
}

/// What a control step answers.
struct PdReport {
  /// How it ended.
  PdStatus status = PdStatus::Solved;
  /// Coordinates whose torque is at its limit.
  int saturated = 0;
  /// Solves for accelerations.
  int solves = 0;
  /// With NoInertia the coordinate, else -1.
  Index coordinate = -1;
};

/// A controller of one robot: gains, and memory.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedDynamics<Model, Scalar>
class StablePd {
 public:
  /// What is known of the robot at a position.
  using Workspace = typename articulated_traits<Model>::workspace_type;
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;

  /// Makes a controller. Allocates. Fails when: `settings.check` does.
  static Result<StablePd> make(const Model& model, StablePdSettings<Scalar> settings) {
    if (std::string fault = settings.check(articulated_traits<Model>::velocities(model)); !fault.empty()) {
      return Error{std::move(fault)};
    }
    return StablePd(model, std::move(settings));
  }

  /// The same, and looks whether the gains hold at positions q. Allocates. Fails when: `settings.check` does, q is not finite
  /// or of a wrong size, or `unstable_at` names a coordinate.
  static Result<StablePd> make(const Model& model, StablePdSettings<Scalar> settings, const View& q) {
    if (q.size() != articulated_traits<Model>::positions(model)) return Error{"q is not of the robot's size"};
    if (!all_finite(q)) return Error{"q holds NaN or an infinity"};
    Result<StablePd> made = make(model, std::move(settings));
    if (!made) return made;
    Workspace work = articulated_traits<Model>::make_workspace(model);
    const std::vector<Index> weak = made->unstable_at(model, q, work);
    if (weak.empty()) return made;
    return Error{"kd of coordinate " + std::to_string(weak.front()) + " is too low for its kp and the step: " +
                 number_text(made->settings().kd[weak.front()]) + " (" + std::to_string(weak.size()) + " in all)"};
  }

  /// The settings.
  const StablePdSettings<Scalar>& settings() const { return settings_; }

  /// The coordinates whose damping is too low at q: where 2 M/h + diag(kd - 1.5 kp h), which holds `least_damping` for every
  /// way in which joints can move together, is not positive definite. There the control oscillates and grows. Empty when the
  /// gains hold. Allocates. Complexity: O(n³).
  std::vector<Index> unstable_at(const Model& model, const View& q, Workspace& work) const {
    std::vector<Index> found;
    if (settings_.form == PdForm::Implicit) return found;
    using Traits = articulated_traits<Model>;
    const Index n = Traits::velocities(model);
    const VectorX<Scalar> rest = VectorX<Scalar>::Constant(n, Scalar(0));
    VectorX<Scalar> held = rest, push = rest, one = rest;
    MatrixX<Scalar> S(n, n);
    Traits::place(model, q, work);
    Traits::inverse_dynamics(model, rest, rest, work, held);
    const Scalar h = settings_.step;
    for (Index i = 0; i < n; ++i) {
      one[i] = Scalar(1);
      Traits::inverse_dynamics(model, rest, one, work, push);
      one[i] = Scalar(0);
      S.col(i) = (Scalar(2) / h) * (push - held);
    }
    S.diagonal() += settings_.kd - Scalar(1.5) * h * settings_.kp;
    for (Index j = 0; j < n; ++j) {  // elimination; what has no positive pivot is named and left out
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

  /// Finds torques and accelerations of the coming step at positions q and velocities qd. `target`, `target_velocity` (may be
  /// empty: at rest): where to be at its end. `external` (may be empty): torques of known contact that act too, Jᵀ f. The
  /// model's simulator, given the torques, finds the accelerations again but for rounding. Never allocates. Complexity: a
  /// solve, and one more each time that joints meet their limits, at most 8.
  [[nodiscard]] PdReport solve(const Model& model, const View& q, const View& qd, const View& target,
                               const View& target_velocity, const View& external, Workspace& work,
                               Eigen::Ref<VectorX<Scalar>> torques, Eigen::Ref<VectorX<Scalar>> qdd) {
    using Traits = articulated_traits<Model>;
    PdReport report;
    const Index positions = Traits::positions(model);
    const bool fits = q.size() == positions && target.size() == positions && qd.size() == n_ && torques.size() == n_ &&
                      qdd.size() == n_ && (target_velocity.size() == 0 || target_velocity.size() == n_) &&
                      (external.size() == 0 || external.size() == n_);
    if (!fits) {
      report.status = PdStatus::WrongSize;
      return report;
    }
    if (!all_finite(q) || !all_finite(qd) || !all_finite(target) || !all_finite(target_velocity) || !all_finite(external)) {
      report.status = PdStatus::InvalidInput;
      return report;
    }
    Traits::place(model, q, work);
    spring_.setConstant(Scalar(0));
    if (settings_.feed_gravity) Traits::inverse_dynamics(model, spring_, spring_, work, gravity_);
    Traits::difference(model, q, target, spring_);
    spring_ = settings_.kp.cwiseProduct(spring_ - settings_.step * qd) - settings_.kd.cwiseProduct(qd) + gravity_;
    if (settings_.feed_velocity && target_velocity.size() > 0) spring_ += settings_.kd.cwiseProduct(target_velocity);
    const Scalar h = settings_.step;
    stiff_ = h * settings_.kd;
    if (settings_.form == PdForm::Implicit) stiff_ += (h * h) * settings_.kp;
    push_ = spring_;
    diagonal_ = stiff_;
    std::fill(held_.begin(), held_.end(), char(0));
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
    // The same torques from the other side of the equation: light joints would lose their digits in the difference above.
    Traits::inverse_dynamics(model, qd, qdd, work, push_);
    for (Index i = 0; i < n_; ++i) {
      if (held_[static_cast<std::size_t>(i)] != 0) continue;
      torques[i] = external.size() > 0 ? Scalar(push_[i] - external[i]) : push_[i];
    }
    return report;
  }

 private:
  static constexpr int kRounds = 8;

  StablePd(const Model& model, StablePdSettings<Scalar> settings)
      : settings_(std::move(settings)), n_(articulated_traits<Model>::velocities(model)) {
    for (VectorX<Scalar>* v : {&spring_, &stiff_, &push_, &diagonal_, &gravity_}) v->setZero(n_);
    limits_ = VectorX<Scalar>::Constant(n_, scalar_traits<Scalar>::infinity());
    if (settings_.limit_torques) limits_ = articulated_traits<Model>::effort_limits(model);
    held_.assign(static_cast<std::size_t>(n_), 0);
  }

  StablePdSettings<Scalar> settings_;
  VectorX<Scalar> limits_, spring_, stiff_, push_, diagonal_, gravity_;
  std::vector<char> held_;  // torques at their limits
  Index n_;
};

}  // namespace clothctl::robot
