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

#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/grasp/fingertip_tracker.hpp"
#include "clothctl/grasp/grasp_types.hpp"
#include "clothctl/grasp/keyframe_path.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/sim/contact_summary.hpp"

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
  /// let go, and a hand that moves stops at once. Allocates.
  std::string begin(Grasp<Scalar> grasp);
  /// Makes one step of `dt` s: reads the state of the hand and what each finger *of the grasp*
  /// feels, and writes the drive. Never allocates.
  GraspReport<Scalar> update(const Scalar& dt, const HandState<Scalar>& hand,
                             std::span<const Touch> touches, HandDrive<Scalar>& drive);

  /// In Hold: moves the grasp as a rigid body to x → R x + t of where it became firm, at the end of
  /// the next step. Returns false, and changes nothing, when it does not hold or the motion is not
  /// one.
  [[nodiscard]] bool move_to(const Matrix3<Scalar>& R, const Vector3<Scalar>& t);
  /// In Hold: moves the grasp by x → R x + t from where it was sent last: the target of `rectify`
  /// from the places of its contact points to the planned ones, with the world as frame.
  [[nodiscard]] bool move_by(const Matrix3<Scalar>& R, const Vector3<Scalar>& t);
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

  /// A finger of the grasp on its way.
  struct Tip {
    Vector3<Scalar> place = Vector3<Scalar>::Constant(Scalar(0));
    Vector3<Scalar> press = Vector3<Scalar>::Constant(Scalar(0));
    Vector3<Scalar> load = Vector3<Scalar>::Constant(Scalar(0));
    Matrix3<Scalar> R = Matrix3<Scalar>::Identity();
    Scalar depth = Scalar(0);
    bool touched = false, slid = false;
  };

  GraspController(FingertipTracker<Model, Scalar> tracker, const GraspSettings<Scalar>& settings)
      : tracker_(std::move(tracker)), settings_(settings) {
    const std::size_t n = tracker_.fingers().size();
    tips_.reserve(n);
    targets_.reserve(n);
  }

  std::string find_fault(const Grasp<Scalar>& grasp) const;
  [[nodiscard]] bool approach(const Scalar& dt, HandDrive<Scalar>& drive);
  void start_closing(const HandState<Scalar>& hand, GraspReport<Scalar>& report);
  /// Chooses F* and moves the depths.
  void press(const Scalar& dt, std::span<const Touch> touches, GraspReport<Scalar>& report);
  void judge_closing(const Scalar& dt, const HandState<Scalar>& hand,
                     std::span<const Touch> touches, GraspReport<Scalar>& report);
  void judge_holding(std::span<const Touch> touches, GraspReport<Scalar>& report);
  /// Moves the grasp to where it shall be, at most at its largest speeds.
  void move(const Scalar& dt);
  void send(const Scalar& dt, HandDrive<Scalar>& drive, GraspReport<Scalar>& report);
  void fail(GraspFault fault, int finger, GraspReport<Scalar>& report) {
    phase_ = GraspPhase::Failed;
    fault_ = fault;
    fault_finger_ = finger;
    report.phase = phase_;
  }
  static bool is_motion(const Matrix3<Scalar>& R, const Vector3<Scalar>& t) {
    if (!all_finite(R) || !all_finite(t)) return false;
    const Matrix3<Scalar> skewed = R.transpose() * R - Matrix3<Scalar>::Identity();
    return skewed.squaredNorm() < Scalar(1e-6) && Scalar(0) < R.determinant();
  }

  FingertipTracker<Model, Scalar> tracker_;
  GraspSettings<Scalar> settings_;
  Grasp<Scalar> grasp_;
  std::vector<KeyframePath<Scalar>> path_;  // one or none
  std::vector<Tip> tips_;
  std::vector<FingertipTarget<Scalar>> targets_;
  VectorX<Scalar> q_, qd_;
  // The motion of the whole grasp since it closed: where it is sent, and where it shall be.
  Matrix3<Scalar> R_ = Matrix3<Scalar>::Identity(), R_wanted_ = R_;
  Vector3<Scalar> t_ = Vector3<Scalar>::Constant(Scalar(0)), t_wanted_ = t_;
  GraspPhase phase_ = GraspPhase::Free;
  GraspFault fault_ = GraspFault::Nothing;
  int fault_finger_ = -1;
  Scalar time_ = Scalar(0), raised_ = Scalar(0), opened_ = Scalar(0);
  int firm_ = 0, slips_ = 0, missed_ = 0;
  bool closed_ = false;          // fingertips have begun to close and have not opened
  GraspReport<Scalar> failure_;  // of the step that failed
  Index speeds_ = 0;             // nv
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
  out.speeds_ = articulated_traits<Model>::nv(model);
  return out;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> std::string GraspController<Model, Scalar>::find_fault(
    const Grasp<Scalar>& grasp)
const {
  if (grasp.fingers.empty()) return "the grasp has no fingers";
  const int count = static_cast<int>(tracker_.fingers().size());
  for (std::size_t i = 0; i < grasp.fingers.size(); ++i) {
    const GraspFinger<Scalar>& f = grasp.fingers[i];
    const std::string name = "finger " + std::to_string(i) + " of the grasp ";
    if (f.finger < 0 || count <= f.finger)
      return name + "is finger " + std::to_string(f.finger) + " of a hand of " +
             std::to_string(count);
    for (std::size_t j = 0; j < i; ++j) {
      if (grasp.fingers[j].finger == f.finger)
        return name + "is finger " + std::to_string(f.finger) + " of the hand, as finger " +
               std::to_string(j) + " is";
    }
    const Scalar square = f.press.squaredNorm();
    if (!(Scalar(0.98) < square && square < Scalar(1.02)))
      return name + "has a direction to press that is not a unit vector";
  }
  if (!is_finite(grasp.force) || !(Scalar(0) < grasp.force) || settings_.most_force < grasp.force)
    return "the force is " + number_text(grasp.force) + " N, must be positive and at most " +
           number_text(settings_.most_force);
  if (grasp.keyframes.empty()) return "the grasp has no keyframes";
  return {};
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> std::string GraspController<Model, Scalar>::begin(
    Grasp<Scalar> grasp) {
  if (std::string bad = find_fault(grasp); !bad.empty()) return bad;
  std::vector<VectorX<Scalar>> keys{tracker_.positions()};
  for (std::size_t i = 0; i < grasp.keyframes.size(); ++i) {
    if (grasp.keyframes[i].size() != keys[0].size() || !all_finite(grasp.keyframes[i]))
      return "keyframe " + std::to_string(i) + " has " + std::to_string(grasp.keyframes[i].size()) +
             " entries for " + std::to_string(keys[0].size()) +
             " positions, or one that is not finite";
    const VectorX<Scalar> low = Traits::lower(tracker_.model()),
                          high = Traits::upper(tracker_.model());
    for (Index k = 0; k < low.size(); ++k) {
      if (!(grasp.keyframes[i][k] < low[k]) && !(high[k] < grasp.keyframes[i][k])) continue;
      return "keyframe " + std::to_string(i) + " is " + number_text(grasp.keyframes[i][k]) +
             " at position " + std::to_string(k) + ", beyond its limits " + number_text(low[k]) +
             " and " + number_text(high[k]);
    }
    keys.push_back(grasp.keyframes[i]);
  }
  const VectorX<Scalar> limits =
      VectorX<Scalar>::Constant(keys[0].size(), settings_.approach_speed);
  auto timed = time_keyframes<Scalar>(std::move(keys), limits, Scalar(0));
  if (!timed) return timed.error();
  auto path = KeyframePath<Scalar>::create(std::move(timed).value(), grasp.tangents);
  if (!path) return path.error();
  path_.clear();
  path_.push_back(std::move(path).value());
  grasp_ = std::move(grasp);
  tips_.assign(grasp_.fingers.size(), Tip());
  targets_.assign(grasp_.fingers.size(), FingertipTarget<Scalar>());
  phase_ = GraspPhase::Approach;
  closed_ = false;
  fault_ = GraspFault::Nothing;
  fault_finger_ = -1;
  time_ = raised_ = opened_ = Scalar(0);
  firm_ = slips_ = missed_ = 0;
  return {};
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> GraspReport<Scalar>
GraspController<Model, Scalar>::update(const Scalar& dt, const HandState<Scalar>& hand,
                                       std::span<const Touch> touches, HandDrive<Scalar>& drive) {
  GraspReport<Scalar> report;
  report.phase = phase_;
  bool good = hand.positions.size() == q_.size() && hand.velocities.size() == speeds_ &&
              all_finite(hand.positions) && all_finite(hand.velocities) && is_finite(dt) &&
              Scalar(0) < dt;
  const bool feels = phase_ != GraspPhase::Free && phase_ != GraspPhase::Failed;
  if (feels) good = good && touches.size() == grasp_.fingers.size();
  for (const Touch& t : touches)
    good = good && is_finite(t.normal_force) && is_finite(t.tangential_force);
  if (!good && phase_ != GraspPhase::Failed) fail(GraspFault::BadInput, -1, report);
  switch (phase_) {
    case GraspPhase::Free:
    case GraspPhase::Failed: tracker_.stop(drive); break;
    case GraspPhase::Approach:
      if (!approach(dt, drive)) fail(GraspFault::BadInput, -1, report);
      if (phase_ == GraspPhase::Approach && !(time_ < path_.front().end_time()))
        start_closing(hand, report);
      if (phase_ == GraspPhase::Failed) tracker_.stop(drive);
      break;
    case GraspPhase::Close:
      press(dt, touches, report);
      judge_closing(dt, hand, touches, report);
      break;
    case GraspPhase::Hold:
      press(dt, touches, report);
      judge_holding(touches, report);
      if (phase_ == GraspPhase::Hold) move(dt);
      break;
    case GraspPhase::Open:
      for (Tip& tip : tips_) tip.depth -= settings_.closing_speed * dt;
      opened_ += settings_.closing_speed * dt;
      if (settings_.open_distance < opened_) {
        phase_ = GraspPhase::Free;
        closed_ = false;
      }
      break;
  }
  if (report.phase == GraspPhase::Close || report.phase == GraspPhase::Hold ||
      report.phase == GraspPhase::Open)
    send(dt, drive, report);
  if (phase_ == GraspPhase::Free) tracker_.stop(drive);
  if (feels && phase_ == GraspPhase::Failed) failure_ = report;  // what it saw then
  if (phase_ == GraspPhase::Failed) {
    const Scalar error = report.ik_error;
    report = failure_;
    report.ik_error = error;
  }
  report.phase = phase_;
  report.fault = fault_;
  report.finger = fault_finger_;
  report.slips = slips_;
  return report;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
bool GraspController<Model, Scalar>::approach(const Scalar& dt, HandDrive<Scalar>& drive) {
  time_ += dt;
  path_.front().sample(time_, q_, qd_);
  return tracker_.move_to(q_, dt, drive);
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::start_closing(const HandState<Scalar>& hand,
                                                   GraspReport<Scalar>& report) {
  using std::sqrt;
  phase_ = GraspPhase::Close;
  closed_ = true;
  time_ = Scalar(0);
  R_ = R_wanted_ = Matrix3<Scalar>::Identity();
  t_.setConstant(Scalar(0));
  t_wanted_ = t_;
  (void)tracker_.set_posture(tracker_.positions());
  for (std::size_t i = 0; i < tips_.size(); ++i) {
    const GraspFinger<Scalar>& f = grasp_.fingers[i];
    Matrix3<Scalar> R;
    Vector3<Scalar> at;
    tracker_.pose_at(hand.positions, f.finger, R, at);
    tracker_.pose(f.finger, tips_[i].R, tips_[i].place);
    tips_[i].press = f.press;
    const Scalar off = sqrt((at - tips_[i].place).squaredNorm());
    if (settings_.place_tolerance < off) fail(GraspFault::NotThere, static_cast<int>(i), report);
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::press(const Scalar& dt, std::span<const Touch> touches,
                                           GraspReport<Scalar>& report) {
  Scalar load(0), sum(0);
  bool sliding = false;
  report.least_force = touches[0].normal_force;
  for (std::size_t i = 0; i < tips_.size(); ++i) {
    const Touch& t = touches[i];
    sum += t.normal_force;
    if (t.normal_force < report.least_force) report.least_force = t.normal_force;
    const bool slides = t.contacts > 0 && t.contacts < 2 * t.sliding;
    if (slides && !tips_[i].slid && phase_ == GraspPhase::Hold) ++slips_;
    tips_[i].slid = slides;
    sliding = sliding || slides;
    if (load < t.tangential_force) load = t.tangential_force;
  }
  const Scalar count(static_cast<double>(tips_.size()));
  report.mean_force = sum / count;
  report.slides = sliding;
  // The force rises at once where the load asks for it, steadily while something slides, and falls
  // within a second.
  Scalar wanted = grasp_.force;
  if (phase_ == GraspPhase::Hold) {
    const Scalar room = settings_.most_force - grasp_.force;
    const Scalar needed = settings_.margin * load / settings_.friction - grasp_.force;
    raised_ -= raised_ * (dt < Scalar(1) ? dt : Scalar(1));
    if (sliding) raised_ += Scalar(2) * grasp_.force * dt;
    if (raised_ < needed) raised_ = needed;
    if (room < raised_) raised_ = room;
    wanted += raised_;
  }
  const bool most = !(wanted < settings_.most_force);
  report.wanted_force = wanted;
  report.too_weak = most && sliding;
  const Scalar fastest = settings_.closing_speed * dt;
  for (std::size_t i = 0; i < tips_.size(); ++i) {
    const Scalar felt = grasp_.together ? report.mean_force : touches[i].normal_force;
    Scalar step = dt * (wanted - felt) / (settings_.stiffness * settings_.response_time);
    if (fastest < step) step = fastest;
    if (step < -fastest) step = -fastest;
    Scalar& depth = tips_[i].depth;
    depth += step;
    if (settings_.most_depth < depth) depth = settings_.most_depth;
    if (depth < -settings_.most_depth) depth = -settings_.most_depth;
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
    if (!good && worst < 0) worst = static_cast<int>(i);
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
    fail(GraspFault::NoTouch, static_cast<int>(i), report);
    return;
  }
  fail(GraspFault::NotFirm, worst, report);
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::judge_holding(std::span<const Touch> touches,
                                                   GraspReport<Scalar>& report) {
  int empty = -1;
  for (std::size_t i = 0; i < touches.size(); ++i) {
    if (touches[i].contacts == 0) empty = static_cast<int>(i);
  }
  missed_ = empty < 0 ? 0 : missed_ + 1;
  if (settings_.firm_steps <= missed_) fail(GraspFault::Lost, empty, report);
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::move(const Scalar& dt) {
  using std::sqrt;
  Vector3<Scalar> middle = Vector3<Scalar>::Constant(Scalar(0));
  for (const Tip& tip : tips_) middle += tip.place / Scalar(static_cast<double>(tips_.size()));
  const Vector3<Scalar> from = R_ * middle + t_;
  Vector3<Scalar> way = R_wanted_ * middle + t_wanted_ - from;
  const Scalar length = sqrt(way.squaredNorm()), most = settings_.hold_speed * dt;
  if (most < length) way *= most / length;
  Vector3<Scalar> turn = rotation_log<Scalar>(R_wanted_ * R_.transpose());
  const Scalar angle = sqrt(turn.squaredNorm()), most_angle = settings_.turn_speed * dt;
  if (most_angle < angle) {
    turn *= most_angle / angle;
    const Eigen::Quaternion<Scalar> next(Matrix3<Scalar>(rotation_exp<Scalar>(turn) * R_));
    R_ = next.normalized().toRotationMatrix();  // products of rotations drift from being one
  } else {
    R_ = R_wanted_;
  }
  t_ = from + way - R_ * middle;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void GraspController<Model, Scalar>::send(const Scalar& dt, HandDrive<Scalar>& drive,
                                          GraspReport<Scalar>& report) {
  if (phase_ == GraspPhase::Failed) {
    tracker_.stop(drive);
    return;
  }
  for (std::size_t i = 0; i < tips_.size(); ++i) {
    FingertipTarget<Scalar>& target = targets_[i];
    target.finger = grasp_.fingers[i].finger;
    target.R_world_frame = R_ * tips_[i].R;
    target.place = R_ * (tips_[i].place + tips_[i].depth * tips_[i].press) + t_;
    target.force = tips_[i].load;
  }
  const IkReport<Scalar> found = tracker_.track(targets_, dt, drive);
  report.ik_error = found.error;
  if (found.status == IkStatus::InvalidInput) {
    tracker_.stop(drive);
    fail(GraspFault::BadInput, -1, report);
  }
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
bool GraspController<Model, Scalar>::move_to(const Matrix3<Scalar>& R, const Vector3<Scalar>& t) {
  if (phase_ != GraspPhase::Hold || !is_motion(R, t)) return false;
  R_wanted_ = R;
  t_wanted_ = t;
  return true;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
bool GraspController<Model, Scalar>::move_by(const Matrix3<Scalar>& R, const Vector3<Scalar>& t) {
  if (phase_ != GraspPhase::Hold || !is_motion(R, t)) return false;
  t_wanted_ = R * t_ + t;
  const Eigen::Quaternion<Scalar> turn(Matrix3<Scalar>(R * R_));
  R_wanted_ = turn.normalized().toRotationMatrix();
  return true;
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

}  // namespace clothctl::inline CLOTHCTL_ABI
