#pragma once

// Two poses of a hand for a grasp: q_g, in which its fingertips touch given points of a sheet, and
// q_p, in which they wait a little away from them. Each is a problem of inverse kinematics with the
// posture of the grasp as a soft wish:
//
//   min Σ |x_i(q) - c_i|² + ℓ² Σ |turn from n_i(q) to N_i|² + w |q - q_shape|²
//
// x_i, n_i: contact point and outward normal of fingertip i; c_i, N_i: where it shall touch, and
// the direction in which it shall press. The contact point of a round fingertip of radius r and
// centre o_i is o_i + r N_i, however it is turned. The fingertips then go all the way: places
// first, and directions and posture as far as places leave them free. Limits of joints are kept.
//
// Reference: [Bai 2016], section 5.

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/grasp/detail/split_mix.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/prioritised_ik.hpp"

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/robot/kinematic_tree_model.hpp"  // what is compiled once
#endif

namespace clothctl::inline CLOTHCTL_ABI {

/// The part of a fingertip that touches.
template <RealScalar Scalar>
struct FingerPad {
  /// Name for messages.
  std::string name;
  /// The frame that carries it; of a KinematicTree, the number of a link.
  int frame = 0;
  /// Its middle, in the frame, m.
  Vector3<Scalar> point = Vector3<Scalar>::Constant(Scalar(0));
  /// The outward unit normal there, in the frame.
  Vector3<Scalar> normal = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-1));
  /// Radius of the round surface there, m; 0 for a flat one. A round fingertip touches where its
  /// surface faces what it touches, a flat one at its middle.
  Scalar radius = Scalar(0);

  /// The centre of the round surface, or the middle of the flat one, in the frame, m.
  Vector3<Scalar> centre() const { return point - radius * normal; }
};

/// Where a finger shall touch.
template <RealScalar Scalar>
struct GraspContact {
  /// The place, world, m.
  Vector3<Scalar> place = Vector3<Scalar>::Constant(Scalar(0));
  /// The direction in which the finger presses there, unit, world: into the sheet.
  Vector3<Scalar> press = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-1));
  /// The direction from the place to where the finger waits, unit, world; zero for -press.
  Vector3<Scalar> away = Vector3<Scalar>::Constant(Scalar(0));
};

/// Settings of `find_grasp_poses`.
template <RealScalar Scalar>
struct GraspPoseSettings {
  /// How far from its place a finger waits, m.
  Scalar distance = Scalar(0.025);
  /// How near to its place a fingertip must come, m.
  Scalar tolerance = Scalar(1e-3);
  /// Weight w of the posture, m²/rad².
  Scalar posture_weight = Scalar(1e-4);
  /// ℓ: the length that a turn of one radian between a fingertip's normal and its direction counts
  /// as, m; 0 if directions do not matter.
  Scalar normal_weight = Scalar(0.03);
  /// Random starts that are tried where the given postures do not lead there.
  int restarts = 8;
  /// The seed of these starts.
  std::uint64_t seed = 1;

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    const auto bad = [](const char* name, const Scalar& value, const char* unit) {
      return std::string(name) + " is " + number_text(value) + unit;
    };
    const auto positive = [](const Scalar& v) { return is_finite(v) && Scalar(0) < v; };
    if (!positive(distance)) return bad("distance", distance, " m, must be finite and positive");
    if (!positive(tolerance)) return bad("tolerance", tolerance, " m, must be finite and positive");
    if (!positive(posture_weight))
      return bad("posture_weight", posture_weight, ", must be finite and positive");
    if (!is_finite(normal_weight) || normal_weight < Scalar(0))
      return bad("normal_weight", normal_weight, " m, must be finite and not negative");
    if (restarts < 0) return "restarts is " + std::to_string(restarts) + ", must not be negative";
    return {};
  }
};

/// How the search for the poses of a grasp ended.
enum class GraspPoseStatus {
  /// Both poses reach their places. Use them.
  Found,
  /// A fingertip does not reach its place on the sheet; `message` says which and by how much. Move
  /// the hand or the places.
  Unreachable,
  /// All reach the sheet, but one does not reach the place where it shall wait. Make `distance`
  /// smaller or choose other directions `away`.
  WaitUnreachable,
  /// `message` says what was refused. Correct it.
  InvalidInput
};

/// Returns the name of a status.
constexpr std::string_view to_string(GraspPoseStatus status) {
  switch (status) {
    case GraspPoseStatus::Found: return "found";
    case GraspPoseStatus::Unreachable: return "unreachable";
    case GraspPoseStatus::WaitUnreachable: return "wait_unreachable";
    case GraspPoseStatus::InvalidInput: return "invalid_input";
  }
  return "unknown";
}

/// The poses of a grasp.
template <RealScalar Scalar>
struct GraspPoses {
  /// How the search ended.
  GraspPoseStatus status = GraspPoseStatus::InvalidInput;
  /// What is wrong, with finger, place and value; empty where the poses were found.
  std::string message;
  /// q_p, q_g (nq): where the hand waits, and where it touches. Where a place is not reached, the
  /// pose that comes closest; empty with InvalidInput.
  VectorX<Scalar> wait, touch;
  /// Distances of the fingertips from their places in these poses (one for each finger), m.
  VectorX<Scalar> wait_errors, touch_errors;
};

namespace detail {

/// Returns an empty string, or what is wrong with the fingers and places of a grasp.
template <class Model, RealScalar Scalar>
std::string find_bad_grasp(const Model& model, std::span<const FingerPad<Scalar>> fingers,
                           std::span<const GraspContact<Scalar>> contacts,
                           const VectorX<Scalar>& pre_shape, const VectorX<Scalar>& grip) {
  if (fingers.empty()) return "the hand has no finger pads";
  if (fingers.size() != contacts.size())
    return std::to_string(contacts.size()) + " places for " + std::to_string(fingers.size()) +
           " fingers";
  for (std::size_t i = 0; i < fingers.size(); ++i) {
    const std::string name = "finger " + std::to_string(i) + " (" + fingers[i].name + ")";
    if (!has_frame(model, fingers[i].frame))
      return name + " is on frame " + std::to_string(fingers[i].frame) + ", which does not exist";
    if (!all_finite(fingers[i].point)) return name + " has a point that is not finite";
    if (!is_finite(fingers[i].radius) || fingers[i].radius < Scalar(0))
      return name + " has the radius " + number_text(fingers[i].radius) +
             " m, must be finite and not negative";
    if (!is_unit(fingers[i].normal)) return name + " has a normal that is not a unit vector";
    if (!all_finite(contacts[i].place)) return name + " has a place that is not finite";
    if (!is_unit(contacts[i].press))
      return name + " has a direction to press that is not a unit vector";
    if (!is_unit(contacts[i].away) && !(contacts[i].away.squaredNorm() == Scalar(0)))
      return name + " has a direction away that is neither zero nor a unit vector";
  }
  const Index nq = articulated_traits<Model>::nq(model);
  const VectorX<Scalar>* const shapes[] = {&pre_shape, &grip};
  for (int k = 0; k < 2; ++k) {
    const char* const name = k == 0 ? "the pre-shape" : "the grip";
    if (shapes[k]->size() != nq)
      return std::string(name) + " has " + std::to_string(shapes[k]->size()) +
             " positions, the hand " + std::to_string(nq);
    for (Index i = 0; i < nq; ++i) {
      if (!is_finite((*shapes[k])[i]))
        return std::string(name) + " is " + number_text((*shapes[k])[i]) + " at position " +
               std::to_string(i);
    }
  }
  return {};
}

/// Finds one pose of a grasp.
template <class Model, RealScalar Scalar>
class GraspPoseSearch {
 public:
  GraspPoseSearch(const Model& model, std::span<const FingerPad<Scalar>> fingers,
                  const GraspPoseSettings<Scalar>& settings)
      : model_(model),
        fingers_(fingers),
        settings_(settings),
        work_(Traits::make_workspace(model)),
        wishing_(model, 2 * static_cast<int>(fingers.size()), wishing(settings)),
        turning_(model, 2 * static_cast<int>(fingers.size()), 2, wishing(settings)),
        reaching_(model, static_cast<int>(fingers.size()), reaching(settings)),
        random_(settings.seed) {}

  /// Moves q from `shape` so that the fingertips are at the places. Returns their distances.
  VectorX<Scalar> find(std::span<const Vector3<Scalar>> places,
                       std::span<const GraspContact<Scalar>> contacts, const VectorX<Scalar>& shape,
                       VectorX<Scalar>& q) {
    list(places, contacts);
    q = shape;
    const std::span<const IkTask<Scalar>> all(tasks_), reach = all.first(places.size());
    const int levels[] = {static_cast<int>(reach.size()),
                          static_cast<int>(all.size() - reach.size())};
    (void)wishing_.solve(model_, all, shape, q);
    if (levels[1] > 0) (void)turning_.solve(model_, all, levels, shape, q);
    (void)reaching_.solve(model_, reach, q, q);
    VectorX<Scalar> best = errors(places, q);
    if (!(settings_.tolerance < best.maxCoeff()) || settings_.restarts == 0) return best;
    VectorX<Scalar> other = shape;
    (void)reaching_.solve(model_, reach, shape, other, settings_.restarts,
                          [this] { return random_.uniform<Scalar>(); });
    const VectorX<Scalar> found = errors(places, other);
    if (!(found.maxCoeff() < best.maxCoeff())) return best;
    q = other;
    return found;
  }

 private:
  using Traits = articulated_traits<Model>;

  static IkSettings<Scalar> wishing(const GraspPoseSettings<Scalar>& s) {
    IkSettings<Scalar> out;
    out.posture_weight = s.posture_weight;
    out.fallbacks = false;  // wishes are never met, and the search below goes on
    return out;
  }
  static IkSettings<Scalar> reaching(const GraspPoseSettings<Scalar>& s) {
    IkSettings<Scalar> out;
    out.tolerance = Scalar(0.1) * s.tolerance;
    return out;
  }
  static Scalar length(const Vector3<Scalar>& v) {
    using std::sqrt;
    return sqrt(v.squaredNorm());
  }
  /// Lists the places of all fingertips, then their directions.
  void list(std::span<const Vector3<Scalar>> places,
            std::span<const GraspContact<Scalar>> contacts) {
    tasks_.clear();
    for (std::size_t i = 0; i < fingers_.size(); ++i)
      tasks_.push_back(
          IkTask<Scalar>::position(fingers_[i].frame, fingers_[i].centre(), places[i]));
    if (!(Scalar(0) < settings_.normal_weight)) return;
    // Tasks take directions that are nearer to unit vectors than what was accepted.
    for (std::size_t i = 0; i < fingers_.size(); ++i)
      tasks_.push_back(IkTask<Scalar>::pointing(
          fingers_[i].frame, fingers_[i].normal / length(fingers_[i].normal),
          contacts[i].press / length(contacts[i].press), settings_.normal_weight));
  }
  VectorX<Scalar> errors(std::span<const Vector3<Scalar>> places, const VectorX<Scalar>& q) {
    Traits::forward_kinematics(model_, q, work_);
    VectorX<Scalar> out = VectorX<Scalar>::Constant(static_cast<Index>(places.size()), Scalar(0));
    Matrix3<Scalar> R;
    Vector3<Scalar> p;
    for (std::size_t i = 0; i < places.size(); ++i) {
      Traits::frame_pose(model_, work_, fingers_[i].frame, R, p);
      const Vector3<Scalar> miss = p + R * fingers_[i].centre() - places[i];
      out[static_cast<Index>(i)] = length(miss);
    }
    return out;
  }
  const Model& model_;
  std::span<const FingerPad<Scalar>> fingers_;
  const GraspPoseSettings<Scalar>& settings_;
  typename Traits::workspace_type work_;
  InverseKinematics<Model, Scalar> wishing_;
  PrioritisedIk<Model, Scalar> turning_;
  InverseKinematics<Model, Scalar> reaching_;
  std::vector<IkTask<Scalar>> tasks_;
  SplitMix random_;
};

}  // namespace detail

/// Finds the poses of a grasp of `fingers` at `contacts` (one for each), near the postures
/// `pre_shape` and `grip` (nq each), which also say where the search starts. A hand whose base has
/// joints comes to the sheet. Allocates. Fails when: see GraspPoseStatus.
template <class Model, RealScalar Scalar = typename articulated_traits<Model>::scalar_type>
requires ArticulatedModel<Model, Scalar> GraspPoses<Scalar> find_grasp_poses(
    const Model& model, std::span<const FingerPad<Scalar>> fingers,
    std::span<const GraspContact<Scalar>> contacts, const VectorX<Scalar>& pre_shape,
    const VectorX<Scalar>& grip, const GraspPoseSettings<Scalar>& settings = {}) {
  GraspPoses<Scalar> out;
  out.message = settings.validate();
  if (out.message.empty())
    out.message = detail::find_bad_grasp<Model, Scalar>(model, fingers, contacts, pre_shape, grip);
  if (!out.message.empty()) return out;
  std::vector<Vector3<Scalar>> places, waits;
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    const GraspContact<Scalar>& c = contacts[i];
    const bool given = Scalar(0) < c.away.squaredNorm();
    const Vector3<Scalar> away = given ? c.away : Vector3<Scalar>(Scalar(-1) * c.press);
    places.push_back(c.place - fingers[i].radius * c.press);
    waits.push_back(places.back() + settings.distance * away);
  }
  detail::GraspPoseSearch<Model, Scalar> search(model, fingers, settings);
  out.touch_errors = search.find(places, contacts, grip, out.touch);
  out.wait_errors = search.find(waits, contacts, pre_shape, out.wait);
  const auto name_worst = [&](const VectorX<Scalar>& errors, const char* place,
                              std::span<const Vector3<Scalar>> list) {
    Index worst = 0;
    (void)errors.maxCoeff(&worst);
    const std::size_t i = static_cast<std::size_t>(worst);
    // The list has centres of fingertips; the caller gave where they touch.
    const Vector3<Scalar> at = list[i] + fingers[i].radius * contacts[i].press;
    out.message = "finger " + std::to_string(i) + " (" + fingers[i].name + ") ends " +
                  rounded_text(errors[worst]) + " m from " + place + " at (" + rounded_text(at[0]) +
                  ", " + rounded_text(at[1]) + ", " + rounded_text(at[2]) + ")";
  };
  if (settings.tolerance < out.touch_errors.maxCoeff()) {
    out.status = GraspPoseStatus::Unreachable;
    name_worst(out.touch_errors, "its place", places);
  } else if (settings.tolerance < out.wait_errors.maxCoeff()) {
    out.status = GraspPoseStatus::WaitUnreachable;
    name_worst(out.wait_errors, "where it waits", waits);
  } else {
    out.status = GraspPoseStatus::Found;
  }
  return out;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class detail::GraspPoseSearch<KinematicTree<double>, double>);
CLOTHCTL_INSTANTIATE(GraspPoses<double> find_grasp_poses<KinematicTree<double>, double>(
    const KinematicTree<double>&, std::span<const FingerPad<double>>,
    std::span<const GraspContact<double>>, const VectorX<double>&, const VectorX<double>&,
    const GraspPoseSettings<double>&));

}  // namespace clothctl::inline CLOTHCTL_ABI
