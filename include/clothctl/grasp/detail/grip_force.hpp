#pragma once

// With what force fingertips press, and how deep they go for it (grasp_controller.hpp). F* is what
// is asked for, and while the hand holds something, what the load needs: it rises at once to the
// margin times |F_t| / μ, steadily while something slides, and falls with a time constant of 1 s.
// The depth of a fingertip integrates the error of its force, δ' = (F* - F) / (k T).

#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#include "clothctl/grasp/detail/limited_motion.hpp"
#include "clothctl/grasp/grasp_types.hpp"
#include "clothctl/sim/contact_summary.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A finger of a grasp on its way.
template <RealScalar Scalar>
struct GraspTip {
  /// Where it touched, its direction to press and its share of the load, at first (world).
  Vector3<Scalar> place = Vector3<Scalar>::Constant(Scalar(0));
  Vector3<Scalar> press = Vector3<Scalar>::Constant(Scalar(0));
  Vector3<Scalar> load = Vector3<Scalar>::Constant(Scalar(0));
  /// How it was turned.
  Matrix3<Scalar> R = Matrix3<Scalar>::Identity();
  /// Its own motion, before that of the grasp.
  LimitedMotion<Scalar> motion = {};
  /// How deep it is pressed, m.
  Scalar depth = Scalar(0);
  /// Steps without contact, and whether it has had one.
  int missed = 0;
  bool touched = false;
};

/// Returns what is wrong with a step of `dt` s, the state of a hand of `nq` positions and `nv`
/// velocities, and what `fingers` fingers feel; empty if it is good.
template <RealScalar Scalar>
std::string_view find_bad_reading(const Scalar& dt, const HandState<Scalar>& hand, Index nq,
                                  Index nv, std::span<const PadTouch<Scalar>> touches,
                                  std::size_t fingers) {
  if (!is_finite(dt) || !(Scalar(0) < dt)) return "the step length is not positive";
  if (hand.positions.size() != nq || hand.velocities.size() != nv)
    return "the state of the hand has another size";
  if (!all_finite(hand.positions)) return "a position of the hand is not finite";
  if (!all_finite(hand.velocities)) return "a velocity of the hand is not finite";
  if (touches.size() != fingers) return "there is not one touch for each finger of the grasp";
  for (const PadTouch<Scalar>& t : touches) {
    if (!is_finite(t.normal_force) || !is_finite(t.tangential_force))
      return "a force that a finger feels is not finite";
  }
  return {};
}

/// The force of one grasp.
template <RealScalar Scalar>
class GripForce {
 public:
  /// Starts a grasp of `fingers` fingers; `goes_on`: what the load needed before counts still.
  /// Allocates.
  void reset(std::size_t fingers, bool goes_on = false) {
    if (!goes_on) raised_ = Scalar(0);
    slips_ = 0;
    slid_.assign(fingers, 0);
  }
  /// How often a finger began to slide while the hand held.
  int slips() const { return slips_; }

  /// Takes what each finger feels, and writes forces, `slides` and `too_weak` to the report.
  /// `force`: what is asked for, N; `holds`: whether the load counts. Never allocates.
  void update(const GraspSettings<Scalar>& settings, const Scalar& force, bool holds,
              const Scalar& dt, std::span<const PadTouch<Scalar>> touches,
              GraspReport<Scalar>& report) {
    Scalar load(0), sum(0);
    report.least_force = touches[0].normal_force;
    report.slides = false;
    for (std::size_t i = 0; i < touches.size(); ++i) {
      const PadTouch<Scalar>& t = touches[i];
      sum += t.normal_force;
      if (t.normal_force < report.least_force) report.least_force = t.normal_force;
      if (load < t.tangential_force) load = t.tangential_force;
      const bool slides = 0 < t.contacts && t.contacts < 2 * t.sliding;
      if (holds && slides && slid_[i] == 0) ++slips_;
      slid_[i] = slides ? 1 : 0;
      report.slides = report.slides || slides;
    }
    report.mean_force = sum / Scalar(static_cast<double>(touches.size()));
    report.wanted_force = force;
    if (holds) {
      const Scalar room = settings.most_force - force;
      const Scalar needed = settings.margin * load / settings.friction - force;
      raised_ -= raised_ * (dt < Scalar(1) ? dt : Scalar(1));
      if (report.slides) raised_ += Scalar(2) * force * dt;
      if (raised_ < needed) raised_ = needed;
      if (room < raised_) raised_ = room;
      report.wanted_force = raised_ < room ? Scalar(force + raised_) : settings.most_force;
    }
    report.too_weak = report.slides && !(report.wanted_force < settings.most_force);
  }

  /// Returns the depth after `dt` s of a fingertip at `depth` (m) that feels `felt` N.
  static Scalar deepen(const GraspSettings<Scalar>& settings, const Scalar& wanted,
                       const Scalar& felt, const Scalar& dt, const Scalar& depth) {
    const Scalar fastest = settings.closing_speed * dt;
    const Scalar step = dt * (wanted - felt) / (settings.stiffness * settings.response_time);
    return within(Scalar(depth + within(step, fastest)), settings.most_depth);
  }

 private:
  static Scalar within(const Scalar& x, const Scalar& most) {
    if (most < x) return most;
    return x < -most ? Scalar(-most) : x;
  }

  Scalar raised_ = Scalar(0);  // above what is asked for, N
  int slips_ = 0;
  std::vector<char> slid_;  // of each finger: in the last step
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
