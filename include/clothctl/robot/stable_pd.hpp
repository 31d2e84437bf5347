#pragma once

// Stable proportional-derivative (PD) control: the torque of a spring and a damper evaluated at the
// end of the coming step of length h, found together with the acceleration that it causes. With
// target position q̄ and target velocity v̄ at the end of the step:
//
//   Stable      (M + h Kd) q̈ = -C - Kp (q + h q̇ - q̄) - Kd (q̇ - v̄) + τ_ext
//               τ = -Kp (q + h q̇ - q̄) - Kd (q̇ + h q̈ - v̄) + g(q)
//   Implicit    (M + h Kd + h² Kp) q̈ = the same right-hand side
//               τ = -Kp (q + h q̇ + h² q̈ - q̄) - Kd (q̇ + h q̈ - v̄) + g(q)
//
// Without v̄ a target that moves at velocity v is followed with a lag of kd/kp v. Without g(q)
// joint i sags by g_i/kp_i. For one joint of mass m under symplectic Euler, Stable is stable for kd
// > 1.5 kp h - 2 m/h, and Implicit for all gains.
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
  /// Positions, velocities, target or external torques hold NaN or an infinity; nothing was
  /// written.
  /// Correct the input.
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

  /// Returns the velocity coordinates whose damping is too low at positions q (nq), empty when the
  /// gains are stable. With too little damping the motion oscillates and grows. The condition is
  /// that 2 M/h + diag(kd - 1.5 kp h) is positive definite: `least_damping` for every combined
  /// motion of the joints. Allocates. Complexity: O(nv³). Fails when: q or the workspace are not
  /// the robot's.
  Result<std::vector<Index>> unstable_at(const Model& model, const View& q, Workspace& work) const;

  /// Computes torques and accelerations (nv each) of the coming step.
  ///
  /// * `q` (nq), `qd` (nv): positions and velocities now
  /// * `target` (nq), `target_velocity` (nv, or empty for zero): where to be at the end of the step
  /// * `external` (nv, or empty for zero): torques Jᵀ f of known contact forces (N or N m)
  ///
  /// A simulation step of the same model with these torques finds the same accelerations, up to
  /// rounding. Never allocates. Complexity: one forward dynamics, and one more for each round in
  /// which joints reach their limits, at most 9 in all. Fails when: see PdStatus.
  [[nodiscard]] PdReport solve(const Model& model, const View& q, const View& qd,
                               const View& target, const View& target_velocity,
                               const View& external, Workspace& work,
                               Eigen::Ref<VectorX<Scalar>> torques,
                               Eigen::Ref<VectorX<Scalar>> qdd);

 private:
  static constexpr int kRounds = 8;

  PdStatus check_input(const Model& model, const View& q, const View& qd, const View& target,
                       const View& target_velocity, const View& external,
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

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/robot/detail/stable_pd_impl.hpp"
