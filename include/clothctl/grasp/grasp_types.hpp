#pragma once

// What a grasp is, the settings of the controller that makes it (grasp_controller.hpp), and what a
// step of that controller reports.

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/grasp/fingertip_tracker.hpp"
#include "clothctl/grasp/keyframe_path.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of a GraspController.
template <RealScalar Scalar>
struct GraspSettings {
  /// Settings of what brings fingertips to their places.
  FingertipSettings<Scalar> fingertips = {};
  /// Largest speed of a joint on the way to the sheet, m/s or rad/s. (Catmull-Rom tangents may
  /// exceed it.)
  Scalar approach_speed = Scalar(1.5);
  /// Largest speed of fingertips that close or open, m/s.
  Scalar closing_speed = Scalar(0.05);
  /// Largest depth δ, m.
  Scalar most_depth = Scalar(0.015);
  /// How far fingertips go back when they open, m.
  Scalar open_distance = Scalar(0.02);
  /// Stiffness k of a fingertip with the joints behind it, N/m, and the response time T, s.
  Scalar stiffness = Scalar(2000), response_time = Scalar(0.1);
  /// Friction coefficient μ of the fingertips.
  Scalar friction = Scalar(0.6);
  /// How many times the force that friction needs is pressed with.
  Scalar margin = Scalar(1.5);
  /// Largest force F*, N.
  Scalar most_force = Scalar(10);
  /// A grasp is firm when each finger has `firm_contacts` contacts that do not slide, its force is
  /// within `force_share` of F*, and no joint is faster than `rest_speed`, for `firm_steps` steps
  /// on end.
  int firm_contacts = 3, firm_steps = 5;
  /// Largest share of F* by which the force of a firm finger differs from it.
  Scalar force_share = Scalar(0.25);
  /// Largest speed of a joint of a hand that holds firmly, m/s or rad/s.
  Scalar rest_speed = Scalar(0.2);
  /// Largest speeds of the grasp while it holds: of its middle, m/s, and of its turn, rad/s. Where
  /// it is told to be elsewhere at once, it goes there at these speeds.
  Scalar hold_speed = Scalar(3), turn_speed = Scalar(0.5);
  /// Time that a hand may take to close, s.
  Scalar time_out = Scalar(2);
  /// How far from its target a fingertip may be where it begins to close, m.
  Scalar place_tolerance = Scalar(2e-3);

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    const std::pair<const char*, Scalar> positive[] = {{"approach_speed", approach_speed},
                                                       {"closing_speed", closing_speed},
                                                       {"most_depth", most_depth},
                                                       {"open_distance", open_distance},
                                                       {"stiffness", stiffness},
                                                       {"response_time", response_time},
                                                       {"most_force", most_force},
                                                       {"force_share", force_share},
                                                       {"hold_speed", hold_speed},
                                                       {"turn_speed", turn_speed},
                                                       {"rest_speed", rest_speed},
                                                       {"time_out", time_out},
                                                       {"place_tolerance", place_tolerance}};
    for (const auto& [name, value] : positive) {
      if (!is_finite(value) || !(Scalar(0) < value))
        return std::string(name) + " is " + number_text(value) + ", must be finite and positive";
    }
    if (!is_finite(friction) || !(Scalar(0) < friction))
      return "friction is " + number_text(friction) +
             ", must be finite and positive: fingers hold by friction";
    if (!is_finite(margin) || margin < Scalar(0))
      return "margin is " + number_text(margin) + ", must be finite and not negative";
    if (firm_contacts < 1)
      return "firm_contacts is " + std::to_string(firm_contacts) + ", must be at least 1";
    if (firm_steps < 1)
      return "firm_steps is " + std::to_string(firm_steps) + ", must be at least 1";
    if (fingertips.joint_speed < approach_speed)
      return "approach_speed is " + number_text(approach_speed) +
             ", must be at most that of the fingertips, " + number_text(fingertips.joint_speed);
    return fingertips.validate();
  }
};

/// A finger of a grasp.
template <RealScalar Scalar>
struct GraspFinger {
  /// Which finger of the hand.
  int finger = 0;
  /// The direction in which it presses where it touches, unit, world.
  Vector3<Scalar> press = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-1));
};

/// One grasp.
template <RealScalar Scalar>
struct Grasp {
  /// Its fingers. None: the hand only goes through the keyframes and is free again, to retreat
  /// after it has opened.
  std::vector<GraspFinger<Scalar>> fingers;
  /// Joint positions (nq each) to go through; the fingertips touch at the last of them, which is
  /// the posture of the fingers from then on. Empty: goes on with what the hand holds.
  std::vector<VectorX<Scalar>> keyframes;
  /// How they are gone through. A path that was planned around obstacles wants Standstill.
  KeyframeTangents tangents = KeyframeTangents::Monotone;
  /// Normal force F* of each finger, N.
  Scalar force = Scalar(3);
  /// Whether fingers close together, as they do around a sheet. On a table each closes by itself.
  bool together = true;

  /// Returns an empty string, or what is wrong with the fingers for a hand of `count` fingers.
  std::string find_bad_finger(int count) const {
    if (fingers.empty() && keyframes.empty()) return "the grasp has neither fingers nor keyframes";
    for (std::size_t i = 0; i < fingers.size(); ++i) {
      const GraspFinger<Scalar>& f = fingers[i];
      const std::string name = "finger " + std::to_string(i) + " of the grasp ";
      if (f.finger < 0 || count <= f.finger)
        return name + "is finger " + std::to_string(f.finger) + " of a hand of " +
               std::to_string(count);
      for (std::size_t j = 0; j < i; ++j) {
        if (fingers[j].finger == f.finger)
          return name + "is finger " + std::to_string(f.finger) + " of the hand, as finger " +
                 std::to_string(j) + " is";
      }
      if (!is_unit(f.press)) return name + "has a direction to press that is not a unit vector";
    }
    return {};
  }
  /// Returns an empty string, or which keyframe is of another size than `lower` and `upper` (nq),
  /// not finite, or beyond them, and where.
  std::string find_bad_keyframe(const VectorX<Scalar>& lower, const VectorX<Scalar>& upper) const {
    for (std::size_t i = 0; i < keyframes.size(); ++i) {
      const VectorX<Scalar>& q = keyframes[i];
      const std::string name = "keyframe " + std::to_string(i);
      if (q.size() != lower.size() || !all_finite(q))
        return name + " has " + std::to_string(q.size()) + " entries for " +
               std::to_string(lower.size()) + " positions, or one that is not finite";
      for (Index k = 0; k < q.size(); ++k) {
        if (!(q[k] < lower[k]) && !(upper[k] < q[k])) continue;
        return name + " is " + number_text(q[k]) + " at position " + std::to_string(k) +
               ", beyond its limits " + number_text(lower[k]) + " and " + number_text(upper[k]);
      }
    }
    return {};
  }
};

/// What a grasp controller is doing.
enum class GraspPhase {
  /// It holds nothing and rests.
  Free,
  /// It goes to the sheet.
  Approach,
  /// It closes.
  Close,
  /// It holds the sheet firmly.
  Hold,
  /// It opens.
  Open,
  /// It has failed and rests, open or closed as it was; `GraspReport::fault` says why.
  Failed
};

/// Returns the name of a phase.
constexpr std::string_view to_string(GraspPhase phase) {
  switch (phase) {
    case GraspPhase::Free: return "free";
    case GraspPhase::Approach: return "approach";
    case GraspPhase::Close: return "close";
    case GraspPhase::Hold: return "hold";
    case GraspPhase::Open: return "open";
    case GraspPhase::Failed: return "failed";
  }
  return "unknown";
}

/// Why a grasp failed.
enum class GraspFault {
  /// It did not.
  Nothing,
  /// A fingertip was not where it shall touch at the end of the way: the hand is blocked or weak.
  NotThere,
  /// A finger closed until the time was out without touching the sheet: it is elsewhere.
  NoTouch,
  /// All fingers touch, but the grasp was not firm in time: a finger does not reach its force, has
  /// too few contacts, or slides, or the hand still moves.
  NotFirm,
  /// A finger lost the sheet.
  Lost,
  /// What was measured is not finite or of another size.
  BadInput
};

/// Returns the name of a fault.
constexpr std::string_view to_string(GraspFault fault) {
  switch (fault) {
    case GraspFault::Nothing: return "nothing";
    case GraspFault::NotThere: return "not_there";
    case GraspFault::NoTouch: return "no_touch";
    case GraspFault::NotFirm: return "not_firm";
    case GraspFault::Lost: return "lost";
    case GraspFault::BadInput: return "bad_input";
  }
  return "unknown";
}

/// What a step of a grasp controller did.
template <RealScalar Scalar>
struct GraspReport {
  /// What it is doing now.
  GraspPhase phase = GraspPhase::Free;
  /// With Failed: why.
  GraspFault fault = GraspFault::Nothing;
  /// With Failed: the finger of the grasp that it is about, or -1.
  int finger = -1;
  /// While a grasp closes and with NotFirm, of the first finger that is not firm: the force by
  /// which it is judged, N (the mean of fingers that close together).
  Scalar finger_force = Scalar(0);
  /// How many contacts of that finger stick.
  int finger_contacts = 0;
  /// Whether it slides: more than half of its contacts do.
  bool finger_slides = false;
  /// With BadInput: what is wrong.
  std::string_view bad_input = {};
  /// The wanted normal force F*, N, and the measured ones: mean and least.
  Scalar wanted_force = Scalar(0), mean_force = Scalar(0), least_force = Scalar(0);
  /// Depth δ of the fingertips, m: the largest.
  Scalar depth = Scalar(0);
  /// Whether a finger slides: more than half of its contacts do.
  bool slides = false;
  /// How often it has begun to slide since the grasp was firm.
  int slips = 0;
  /// Whether it slides although the force is the largest.
  bool too_weak = false;
  /// While a grasp holds: how far it is behind the motion asked for, m and rad, because that is
  /// faster than `hold_speed` and `turn_speed`.
  Scalar way_left = Scalar(0), turn_left = Scalar(0);
  /// Distance of the fingertips from their targets in inverse kinematics, m: the largest.
  Scalar ik_error = Scalar(0);
};

/// Says why a grasp failed, in words; empty where it did not. `who`: the finger of the report.
/// Allocates.
template <RealScalar Scalar>
std::string describe_fault(const GraspReport<Scalar>& report, const std::string& who) {
  if (report.phase != GraspPhase::Failed) return {};
  switch (report.fault) {
    case GraspFault::NotThere: return who + " is not where it shall touch the sheet";
    case GraspFault::NoTouch:
      return who + " closed by " + rounded_text(report.depth) + " m and touched nothing";
    case GraspFault::NotFirm:
      if (report.finger < 0)
        return who + " was not firm and at rest for long enough, at " +
               rounded_text(report.mean_force) + " N of " + rounded_text(report.wanted_force) +
               " N";
      return who + " did not hold firmly in time: " + rounded_text(report.finger_force) + " N of " +
             rounded_text(report.wanted_force) + " N, " + std::to_string(report.finger_contacts) +
             " contacts stick" + (report.finger_slides ? ", and it slides" : "");
    case GraspFault::Lost: return who + " lost the sheet";
    case GraspFault::BadInput: return std::string(report.bad_input);
    case GraspFault::Nothing: break;
  }
  return {};
}

}  // namespace clothctl::inline CLOTHCTL_ABI
