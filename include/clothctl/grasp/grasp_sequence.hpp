#pragma once

// A task as a list of contact phases: grasp, manipulate, grasp again ([Bai 2016], section 4.1.1).
// Each phase is a grasp and what comes after it is firm: the caller moves the grasp (by hand, or as
// a planner says) for as long as the phase lasts, then the hand opens, or goes on with what it
// holds. What is planned goes on, too: `Planner::set_grips` takes what the new grasp holds and
// keeps the rest of its state.

#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/grasp/grasp_controller.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A contact phase.
template <RealScalar Scalar>
struct ContactPhase {
  /// How the hand takes hold. Without keyframes it goes on with what the phase before holds.
  Grasp<Scalar> grasp;
  /// How long it holds after the grip is firm, s; infinity: until `GraspSequence::end_phase`.
  Scalar seconds = scalar_traits<Scalar>::infinity();
  /// Whether the hand opens at the end.
  bool release = true;
};

/// Leads a grasp controller through contact phases.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedDynamics<Model, Scalar>
class GraspSequence {
 public:
  /// The controller that it leads.
  using Controller = GraspController<Model, Scalar>;
  /// What a finger feels.
  using Touch = PadTouch<Scalar>;

  /// Makes the sequence. The controller must outlive it. Allocates. Fails when: there is no phase,
  /// a grasp names a finger that the hand does not have, a time is negative or NaN, or a phase
  /// goes on with what the one before has let go.
  static Result<GraspSequence> create(Controller& controller,
                                      std::vector<ContactPhase<Scalar>> phases) {
    if (phases.empty()) return Error{"there are no contact phases"};
    const int count = static_cast<int>(controller.tracker().fingers().size());
    for (std::size_t i = 0; i < phases.size(); ++i) {
      const std::string name = "contact phase " + std::to_string(i) + ": ";
      const ContactPhase<Scalar>& phase = phases[i];
      if (std::string bad = phase.grasp.find_bad_finger(count); !bad.empty())
        return Error{name + bad};
      if (!is_finite(phase.seconds) ? !is_unbounded(phase.seconds) : phase.seconds < Scalar(0))
        return Error{name + "lasts " + number_text(phase.seconds) + " s, must not be negative"};
      if (!phase.grasp.keyframes.empty()) continue;
      if (i == 0 ? controller.phase() != GraspPhase::Hold : phases[i - 1].release)
        return Error{name + "has no keyframes, and the hand holds nothing to go on with"};
    }
    return GraspSequence(controller, std::move(phases), static_cast<std::size_t>(count));
  }

  /// Makes one step of `dt` s, as the controller does, but with what *every* finger of the hand
  /// feels, in their order. Where a phase is over it begins the next one, which allocates; nothing
  /// else does. After a failure the hand rests: `begin_phase` tries again.
  GraspReport<Scalar> update(const Scalar& dt, const HandState<Scalar>& hand,
                             std::span<const Touch> touches, HandDrive<Scalar>& drive) {
    // Where a grasp has no fingers, the phase is over when the hand has come to its last keyframe.
    if (phase_ >= 0 && now().grasp.fingers.empty() && controller_->phase() == GraspPhase::Free)
      ended_ = true;
    const bool next = phase_ < 0 || (opens() && controller_->phase() == GraspPhase::Free);
    if (next && fault_.empty() && !done()) (void)begin_phase(phase_ + 1);
    felt_.clear();
    for (const GraspFinger<Scalar>& f : controller_->grasp().fingers) {
      if (static_cast<std::size_t>(f.finger) < touches.size())
        felt_.push_back(touches[static_cast<std::size_t>(f.finger)]);
    }
    const GraspReport<Scalar> report = controller_->update(dt, hand, felt_, drive);
    if (report.phase == GraspPhase::Hold && phase_ >= 0 && !ended_) {
      held_ += dt;
      if (!(held_ < now().seconds)) end_phase();
    }
    began_ = std::exchange(begins_, false);
    return report;
  }

  /// Ends the phase that holds now: the hand opens, or goes on with the next one. Returns false
  /// where it does not hold, or the phase is over. Allocates where the next phase begins.
  bool end_phase() {
    if (controller_->phase() != GraspPhase::Hold || phase_ < 0 || ended_) return false;
    ended_ = true;
    if (now().release) {
      controller_->release();
    } else if (phase_ + 1 < phase_count()) {
      (void)begin_phase(phase_ + 1);
    }
    return true;
  }
  /// Begins a phase. Returns an empty string, or what is wrong: then the hand goes on with what it
  /// does, and `fault` keeps the words. Allocates.
  std::string begin_phase(int number) {
    if (number < 0 || phase_count() <= number)
      return fault_ = "there is no contact phase " + std::to_string(number);
    fault_ = controller_->begin(phases_[static_cast<std::size_t>(number)].grasp);
    if (!fault_.empty()) return fault_ = "contact phase " + std::to_string(number) + ": " + fault_;
    phase_ = number;
    held_ = Scalar(0);
    ended_ = false;
    begins_ = true;
    return {};
  }

  /// The number of the phase, -1 before the first update.
  int phase() const { return phase_; }
  /// The number of phases.
  int phase_count() const { return static_cast<int>(phases_.size()); }
  /// Whether a phase began in the last update, or between it and the update before.
  bool began() const { return began_; }
  /// How long this phase has held, s.
  const Scalar& held() const { return held_; }
  /// Whether the last phase is over and, where it opens the hand, the hand is open.
  bool done() const {
    return ended_ && phase_ + 1 == phase_count() &&
           (!opens() || controller_->phase() == GraspPhase::Free);
  }
  /// Why a phase could not begin; empty if all is well. No other begins by itself then, until
  /// `begin_phase` has begun one. What fails within a phase is in the report.
  const std::string& fault() const { return fault_; }

 private:
  GraspSequence(Controller& controller, std::vector<ContactPhase<Scalar>> phases,
                std::size_t fingers)
      : controller_(&controller), phases_(std::move(phases)) {
    felt_.reserve(fingers);
  }
  /// Whether the phase is over and the hand opens, or has opened.
  bool opens() const { return ended_ && (now().release || now().grasp.fingers.empty()); }
  const ContactPhase<Scalar>& now() const { return phases_[static_cast<std::size_t>(phase_)]; }

  Controller* controller_;
  std::vector<ContactPhase<Scalar>> phases_;
  std::vector<Touch> felt_;
  std::string fault_;
  int phase_ = -1;
  Scalar held_ = Scalar(0);
  bool ended_ = false, began_ = false;  // the phase; in the last update
  bool begins_ = false;                 // since the last update
};

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class GraspSequence<KinematicTree<double>, double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
