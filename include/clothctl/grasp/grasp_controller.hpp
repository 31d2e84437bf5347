#pragma once

// Grasps a sheet with one hand: goes to it, closes, holds, opens. In each step it reads the hand
// and what its fingertips feel, and writes what drives the hand; it knows of no world, so that it
// also runs a robot with tactile sensors.
//
//   Approach  along keyframes of joint positions to where the fingertips touch
//   Close     fingertips go on along their directions to press, until they press as wanted
//   Hold      the grasp moves as one rigid body, as it is told; the force is kept
//   Open      fingertips go back
//
// The target of fingertip i is p_i + δ_i n_i: its place p_i, and the depth δ_i that makes it press
// along n_i. δ integrates the error of the measured normal force F,
//
//   δ' = (F* - F) / (k T)        k: stiffness of fingertip and joints, T: response time
//
// within a largest speed and depth. Fingers that face each other close together: they share one δ
// and the mean of their forces, since the sheet between them passes on what one presses to the
// other. F* is what the caller asks for, and more where the load needs it: at least the margin
// times |F_t| / μ, and more while samples slide, up to a largest force.
//
// Reference: [Bai 2016], section 5.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/grasp/detail/grip_force.hpp"
#include "clothctl/grasp/detail/limited_motion.hpp"
#include "clothctl/grasp/fingertip_tracker.hpp"
#include "clothctl/grasp/grasp_types.hpp"
#include "clothctl/grasp/keyframe_path.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Grasps with one hand.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedDynamics<Model, Scalar>
class GraspController {
 public:
  /// What a finger feels.
  using Touch = PadTouch<Scalar>;

  /// Makes the controller of a hand, which must outlive it and is at rest at positions q (nq).
  /// Allocates. Fails when: q is of another size or not finite, `FingertipTracker::create` does, or
  /// `settings.validate()`.
  static Result<GraspController> create(const Model& model, std::vector<FingerPad<Scalar>> fingers,
                                        const VectorX<Scalar>& q,
                                        const GraspSettings<Scalar>& settings = {});

  /// Begins a grasp from the last targets of the hand. Returns an empty string, or what is wrong;
  /// nothing changes then. It may begin in any phase, and starts from rest: a sheet that is held is
  /// let go, and a hand that moves stops at once. In Hold, a grasp without keyframes goes on with
  /// what is held: its fingers close from where they are, along other directions. Allocates.
  std::string begin(Grasp<Scalar> grasp);
  /// Makes one step of `dt` s: reads the state of the hand and what each finger *of the grasp*
  /// feels, and writes the drive. Never allocates.
  GraspReport<Scalar> update(const Scalar& dt, const HandState<Scalar>& hand,
                             std::span<const Touch> touches, HandDrive<Scalar>& drive);

  /// In Hold: moves the grasp as a rigid body to x → R x + t of where it became firm, at the end of
  /// the next step. Returns false, and changes nothing, when it does not hold or the motion is not
  /// one.
  [[nodiscard]] bool move_to(const Matrix3<Scalar>& R, const Vector3<Scalar>& t) {
    return phase_ == GraspPhase::Hold && motion_.move_to(R, t);
  }
  /// In Hold: moves the grasp by x → R x + t from where it was sent last: the target of `rectify`
  /// from the places of its contact points to the planned ones, with the world as frame.
  [[nodiscard]] bool move_by(const Matrix3<Scalar>& R, const Vector3<Scalar>& t) {
    return phase_ == GraspPhase::Hold && motion_.move_by(R, t);
  }
  /// In Hold: moves finger i of the grasp, besides what the grasp does, by x → R x + t from where
  /// it was sent last. Each finger has the speeds of the grasp. Returns false, and changes nothing,
  /// when it does not hold, there is no such finger or the motion is not one.
  [[nodiscard]] bool move_finger_by(int i, const Matrix3<Scalar>& R, const Vector3<Scalar>& t) {
    if (phase_ != GraspPhase::Hold || i < 0 || tips_.size() <= static_cast<std::size_t>(i))
      return false;
    // The finger moves first and the grasp after it.
    const Matrix3<Scalar> back = motion_.R().transpose();
    const Vector3<Scalar> origin = motion_.at(Vector3<Scalar>::Constant(Scalar(0)));
    return tips_[static_cast<std::size_t>(i)].motion.move_by(back * R * motion_.R(),
                                                             back * (R * origin + t - origin));
  }
  /// Changes the wanted normal force F* (N, positive). Returns false, and changes nothing, when it
  /// is not one.
  [[nodiscard]] bool set_force(const Scalar& force);
  /// Sets the force (N, world) that finger i of the grasp shall exert beside pressing: its share of
  /// the load. It is fed forward. Returns false, and changes nothing, when there is no such finger,
  /// the force is not finite, or the hand opens.
  [[nodiscard]] bool set_load(int i, const Vector3<Scalar>& force);
  /// Opens, whatever it does: fingertips that have begun to close go back, and the hand stays
  /// there.
  void release();
  /// Stops where the hand was sent last, open or closed; `release` opens it later.
  void stop() {
    phase_ = GraspPhase::Free;
    fault_ = GraspFault::Nothing;
    fault_finger_ = -1;
  }

  /// The grasp that was begun last.
  const Grasp<Scalar>& grasp() const { return grasp_; }
  /// What it is doing.
  GraspPhase phase() const { return phase_; }
  /// Says what the report means, with finger and values; empty unless it is a failure. Allocates.
  std::string describe(const GraspReport<Scalar>& report) const {
    std::string who = "the hand";
    if (report.finger >= 0 && static_cast<std::size_t>(report.finger) < grasp_.fingers.size()) {
      const int f = grasp_.fingers[static_cast<std::size_t>(report.finger)].finger;
      who = "finger " + std::to_string(f) + " (" +
            tracker_.fingers()[static_cast<std::size_t>(f)].name + ")";
    }
    return describe_fault(report, who);
  }
  /// What brings the fingertips to their places: set half-spaces or the posture there.
  FingertipTracker<Model, Scalar>& tracker() { return tracker_; }

 private:
  using Traits = articulated_traits<Model>;

  using Tip = detail::GraspTip<Scalar>;

  GraspController(FingertipTracker<Model, Scalar> tracker, const GraspSettings<Scalar>& settings)
      : tracker_(std::move(tracker)), settings_(settings) {
    const std::size_t n = tracker_.fingers().size();
    tips_.reserve(n);
    targets_.reserve(n);
  }

  std::string find_fault(const Grasp<Scalar>& grasp) const;
  /// Plans the way through the keyframes. Returns an empty string, or what is wrong.
  std::string plan_way(const Grasp<Scalar>& grasp);
  void approach(const Scalar& dt, HandDrive<Scalar>& drive);
  void start_closing();
  /// Fails when a fingertip is not where it was sent last, to close from there.
  void judge_arrival(const HandState<Scalar>& hand);
  /// Chooses F* and moves the depths.
  void press(const Scalar& dt, std::span<const Touch> touches, GraspReport<Scalar>& report);
  void judge_closing(const Scalar& dt, const HandState<Scalar>& hand,
                     std::span<const Touch> touches, GraspReport<Scalar>& report);
  void judge_holding(std::span<const Touch> touches);
  void open(const Scalar& dt);
  /// Moves the grasp and its fingers to where they shall be, at most at their largest speeds.
  void move(const Scalar& dt, GraspReport<Scalar>& report) {
    const Scalar way = settings_.hold_speed * dt, turn = settings_.turn_speed * dt;
    Vector3<Scalar> middle = Vector3<Scalar>::Constant(Scalar(0));
    for (Tip& tip : tips_) {
      tip.motion.advance(tip.place, way, turn);
      middle += tip.motion.at(tip.place) / Scalar(static_cast<double>(tips_.size()));
    }
    motion_.advance(middle, way, turn);
    report.way_left = motion_.way_left();
    report.turn_left = motion_.turn_left();
    for (const Tip& tip : tips_) {
      report.way_left = (std::max)(report.way_left, tip.motion.way_left());
      report.turn_left = (std::max)(report.turn_left, tip.motion.turn_left());
    }
  }
  void send(const Scalar& dt, HandDrive<Scalar>& drive, GraspReport<Scalar>& report);
  void refuse(std::string_view bad) {
    if (bad.empty() || phase_ == GraspPhase::Failed) return;
    fail(GraspFault::BadInput, -1);
    bad_input_ = bad;
  }
  void fail(GraspFault fault, int finger) {
    phase_ = GraspPhase::Failed;
    fault_ = fault;
    fault_finger_ = finger;
  }

  FingertipTracker<Model, Scalar> tracker_;
  GraspSettings<Scalar> settings_;
  Grasp<Scalar> grasp_;
  std::vector<KeyframePath<Scalar>> path_;  // one or none
  std::vector<Tip> tips_;
  std::vector<FingertipTarget<Scalar>> targets_;
  VectorX<Scalar> q_, qd_;
  detail::LimitedMotion<Scalar> motion_;  // of the whole grasp since it closed
  detail::GripForce<Scalar> force_;
  GraspPhase phase_ = GraspPhase::Free;
  GraspFault fault_ = GraspFault::Nothing;
  std::string_view bad_input_;
  int fault_finger_ = -1;
  Scalar time_ = Scalar(0), opened_ = Scalar(0);
  int firm_ = 0;
  bool closed_ = false;          // fingertips have begun to close and have not opened
  bool goes_on_ = false;         // they began with what the hand held
  bool arrives_ = false;         // they begin to close where the keyframes ended
  GraspReport<Scalar> failure_;  // of the step that failed
};

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
auto GraspController<Model, Scalar>::create(const Model& model,
                                            std::vector<FingerPad<Scalar>> fingers,
                                            const VectorX<Scalar>& q,
                                            const GraspSettings<Scalar>& settings)
    -> Result<GraspController> {
  if (const std::string bad = settings.validate(); !bad.empty()) return Error{bad};
  auto tracker =
      FingertipTracker<Model, Scalar>::create(model, std::move(fingers), settings.fingertips);
  if (!tracker) return Error{tracker.error()};
  if (!tracker->start(q))
    return Error{"q has " + std::to_string(q.size()) + " entries for " +
                 std::to_string(articulated_traits<Model>::nq(model)) +
                 " positions, or one that is not finite"};
  GraspController out(std::move(tracker).value(), settings);
  out.q_ = q;
  out.qd_ = VectorX<Scalar>::Constant(q.size(), Scalar(0));
  return out;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> std::string GraspController<Model, Scalar>::find_fault(
    const Grasp<Scalar>& grasp)
const {
  const int count = static_cast<int>(tracker_.fingers().size());
  if (std::string bad = grasp.find_bad_finger(count); !bad.empty()) return bad;
  if (!is_finite(grasp.force) || !(Scalar(0) < grasp.force) || settings_.most_force < grasp.force)
    return "the force is " + number_text(grasp.force) + " N, must be positive and at most " +
           number_text(settings_.most_force);
  if (grasp.keyframes.empty() && phase_ != GraspPhase::Hold)
    return "the grasp has no keyframes, and the hand holds nothing to go on with";
  return {};
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> std::string GraspController<Model, Scalar>::begin(
    Grasp<Scalar> grasp) {
  if (std::string bad = find_fault(grasp); !bad.empty()) return bad;
  const bool goes_on = grasp.keyframes.empty();
  if (!goes_on) {
    if (std::string bad = plan_way(grasp); !bad.empty()) return bad;
  }
  std::vector<Tip> tips(grasp.fingers.size());
  for (std::size_t i = 0; goes_on && i < tips.size() * tips_.size(); ++i) {
    const std::size_t from = i / tips.size(), to = i % tips.size();
    if (grasp_.fingers[from].finger == grasp.fingers[to].finger) tips[to].load = tips_[from].load;
  }
  grasp_ = std::move(grasp);
  tips_ = std::move(tips);
  targets_.assign(grasp_.fingers.size(), FingertipTarget<Scalar>());
  phase_ = GraspPhase::Approach;
  closed_ = arrives_ = false;
  fault_ = GraspFault::Nothing;
  fault_finger_ = -1;
  force_.reset(tips_.size(), goes_on);
  time_ = opened_ = Scalar(0);
  firm_ = 0;
  goes_on_ = goes_on;
  if (goes_on) start_closing();
  return {};
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> std::string GraspController<Model, Scalar>::plan_way(
    const Grasp<Scalar>& grasp) {
  if (std::string bad =
          grasp.find_bad_keyframe(Traits::lower(tracker_.model()), Traits::upper(tracker_.model()));
      !bad.empty())
    return bad;
  std::vector<VectorX<Scalar>> keys{tracker_.positions()};
  keys.insert(keys.end(), grasp.keyframes.begin(), grasp.keyframes.end());
  const VectorX<Scalar> limits =
      VectorX<Scalar>::Constant(keys[0].size(), settings_.approach_speed);
  auto timed = time_keyframes<Scalar>(std::move(keys), limits, Scalar(0));
  if (!timed) return timed.error();
  auto path = KeyframePath<Scalar>::create(std::move(timed).value(), grasp.tangents);
  if (!path) return path.error();
  path_.clear();
  path_.push_back(std::move(path).value());
  return {};
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> GraspReport<Scalar>
GraspController<Model, Scalar>::update(const Scalar& dt, const HandState<Scalar>& hand,
                                       std::span<const Touch> touches, HandDrive<Scalar>& drive) {
  GraspReport<Scalar> report;
  const bool failed = phase_ == GraspPhase::Failed, idle = failed || phase_ == GraspPhase::Free;
  refuse(detail::find_bad_reading<Scalar>(dt, hand, q_.size(), Traits::nv(tracker_.model()),
                                          touches, idle ? touches.size() : grasp_.fingers.size()));
  switch (phase_) {
    case GraspPhase::Free:
    case GraspPhase::Failed: break;
    case GraspPhase::Approach: approach(dt, drive); break;
    case GraspPhase::Close:
      if (arrives_) judge_arrival(hand);
      if (phase_ == GraspPhase::Failed) break;
      press(dt, touches, report);
      judge_closing(dt, hand, touches, report);
      send(dt, drive, report);
      break;
    case GraspPhase::Hold:
      press(dt, touches, report);
      judge_holding(touches);
      if (phase_ == GraspPhase::Hold) move(dt, report);
      send(dt, drive, report);
      break;
    case GraspPhase::Open:
      open(dt);
      send(dt, drive, report);
      break;
  }
  if (phase_ == GraspPhase::Free || phase_ == GraspPhase::Failed) tracker_.stop(drive);
  if (phase_ == GraspPhase::Failed) {
    if (!failed) failure_ = report;  // what it saw then
    report = failure_;
  }
  report.phase = phase_;
  report.fault = fault_;
  if (fault_ == GraspFault::BadInput) report.bad_input = bad_input_;
  report.finger = fault_finger_;
  report.slips = force_.slips();
  return report;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::approach(const Scalar& dt, HandDrive<Scalar>& drive) {
  time_ += dt;
  path_.front().sample(time_, q_, qd_);
  if (!tracker_.move_to(q_, dt, drive)) {
    refuse("the drive is not that of this hand");
  } else if (!(time_ < path_.front().end_time())) {
    start_closing();
    arrives_ = true;
    if (!tips_.empty()) return;
    phase_ = GraspPhase::Free;
    closed_ = false;
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::start_closing() {
  phase_ = GraspPhase::Close;
  closed_ = true;
  time_ = Scalar(0);
  motion_.reset();
  (void)tracker_.set_posture(tracker_.positions());
  for (std::size_t i = 0; i < tips_.size(); ++i) {
    tracker_.pose(grasp_.fingers[i].finger, tips_[i].R, tips_[i].place);
    tips_[i].press = grasp_.fingers[i].press;
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::judge_arrival(const HandState<Scalar>& hand) {
  using std::sqrt;
  arrives_ = false;
  Matrix3<Scalar> R;
  Vector3<Scalar> at;
  for (std::size_t i = 0; i < tips_.size(); ++i) {
    tracker_.pose_at(hand.positions, grasp_.fingers[i].finger, R, at);
    const Scalar off = sqrt((at - tips_[i].place).squaredNorm());
    if (settings_.place_tolerance < off) fail(GraspFault::NotThere, static_cast<int>(i));
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::press(const Scalar& dt, std::span<const Touch> touches,
                                           GraspReport<Scalar>& report) {
  const bool holds = phase_ == GraspPhase::Hold || goes_on_;
  force_.update(settings_, grasp_.force, holds, dt, touches, report);
  for (std::size_t i = 0; i < tips_.size(); ++i) {
    const Scalar felt = grasp_.together ? report.mean_force : touches[i].normal_force;
    Scalar& depth = tips_[i].depth;
    depth = detail::GripForce<Scalar>::deepen(settings_, report.wanted_force, felt, dt, depth);
    if (i == 0 || report.depth < depth) report.depth = depth;
    if (touches[i].contacts > 0) tips_[i].touched = true;
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::judge_closing(const Scalar& dt, const HandState<Scalar>& hand,
                                                   std::span<const Touch> touches,
                                                   GraspReport<Scalar>& report) {
  using std::abs;
  time_ += dt;
  bool firm = true;
  int worst = -1;
  for (std::size_t i = 0; i < tips_.size(); ++i) {
    const Touch& t = touches[i];
    const Scalar felt = grasp_.together ? report.mean_force : t.normal_force;
    const bool good =
        settings_.firm_contacts <= t.contacts - t.sliding &&
        abs(felt - report.wanted_force) <= settings_.force_share * report.wanted_force;
    if (!good && worst < 0) {
      worst = static_cast<int>(i);
      report.finger_force = felt;
      report.finger_contacts = t.contacts - t.sliding;
      report.finger_slides = t.contacts < 2 * t.sliding;
    }
    firm = firm && good;
  }
  for (Index i = 0; i < hand.velocities.size(); ++i)
    firm = firm && abs(hand.velocities[i]) < settings_.rest_speed;
  firm_ = firm ? firm_ + 1 : 0;
  if (settings_.firm_steps <= firm_) {
    phase_ = GraspPhase::Hold;
    return;
  }
  if (time_ < settings_.time_out) return;
  for (std::size_t i = 0; i < tips_.size(); ++i) {
    if (tips_[i].touched) continue;
    fail(GraspFault::NoTouch, static_cast<int>(i));
    return;
  }
  const bool lost =
      goes_on_ && touches[static_cast<std::size_t>((std::max)(worst, 0))].contacts == 0;
  fail(lost ? GraspFault::Lost : GraspFault::NotFirm, worst);
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::judge_holding(std::span<const Touch> touches) {
  for (std::size_t i = 0; i < touches.size(); ++i) {
    tips_[i].missed = touches[i].contacts == 0 ? tips_[i].missed + 1 : 0;
    if (settings_.firm_steps <= tips_[i].missed) fail(GraspFault::Lost, static_cast<int>(i));
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::open(const Scalar& dt) {
  const Scalar way = settings_.closing_speed * dt;
  for (Tip& tip : tips_) tip.depth -= way;
  opened_ += way;
  if (opened_ <= settings_.open_distance) return;
  phase_ = GraspPhase::Free;
  closed_ = false;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::send(const Scalar& dt, HandDrive<Scalar>& drive,
                                          GraspReport<Scalar>& report) {
  if (phase_ == GraspPhase::Failed) return;
  for (std::size_t i = 0; i < tips_.size(); ++i) {
    FingertipTarget<Scalar>& target = targets_[i];
    target.finger = grasp_.fingers[i].finger;
    const Tip& tip = tips_[i];
    target.R_world_frame = motion_.R() * tip.motion.R() * tip.R;
    target.place = motion_.at(tip.motion.at(tip.place + tip.depth * tip.press));
    target.force = tip.load;
  }
  const IkReport<Scalar> found = tracker_.track(targets_, dt, drive);
  report.ik_error = found.error;
  if (found.status == IkStatus::InvalidInput) refuse(found.message);
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
bool GraspController<Model, Scalar>::set_force(const Scalar& force) {
  if (!is_finite(force) || !(Scalar(0) < force) || settings_.most_force < force) return false;
  grasp_.force = force;
  return true;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
bool GraspController<Model, Scalar>::set_load(int i, const Vector3<Scalar>& force) {
  if (i < 0 || static_cast<std::size_t>(i) >= tips_.size() || !all_finite(force)) return false;
  if (phase_ == GraspPhase::Open) return false;
  tips_[static_cast<std::size_t>(i)].load = force;
  return true;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::release() {
  fault_ = GraspFault::Nothing;
  fault_finger_ = -1;
  if (phase_ == GraspPhase::Open) return;
  if (!closed_) {
    phase_ = GraspPhase::Free;
    return;
  }
  for (Tip& tip : tips_) tip.load.setConstant(Scalar(0));
  opened_ = Scalar(0);
  phase_ = GraspPhase::Open;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class GraspController<KinematicTree<double>, double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
