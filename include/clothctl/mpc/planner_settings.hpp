#pragma once

// Settings of a planner: horizon, weights of the cost, kind of input, limits.
//
//   J = Σ_k  w_f |y_k - ȳ_k|²                 features follow their target    ([Bai 2016], eq. 7)
//         +  w_m |u_k - u_ref|² + w_d |d_k|²   effort; d: coefficients of the contacts  (eq. 8)
//         +  w_s |ċ_k - ċ_{k-1}|² + w_l |L_k - L_{k-1}|²   smooth hands                 (eq. 9)
//         +  w_h |p_k - p̄_k|²                 hands stay where they belong (hand_anchor.hpp)
//         +  w_p |non-affine patch motion|²    soft form of eq. 3 (affine_patch.hpp)
//         +  w_g max(0, n · z_k - most)²       limits of grips and features (window_limits.hpp)
//         +  w_j |ċ_k - 2 ċ_{k-1} + ċ_{k-2}|² + w_r |ċ_k - ċ̄_k|²      damping for rollouts
//
// The sums are over the frames k = 1..K. y: features, ȳ: their targets, u: raw inputs, c and p:
// centroid of a grip, ċ: its velocity, ċ̄: its velocity in the last plan, L: best linear map of a
// patch.
//
// How many frames a window needs: "The window size is selected empirically. We start with the
// minimum window size and gradually increase it until the resulting motion is above the accuracy
// threshold. … A rough guideline to window size selection is based on how energetic the desired
// cloth motion is and the distance between controllable and feature vertices." ([Bai 2016], section
// 6; in its figure 9 the error settles at 12 frames.) `search_horizon` is that procedure,
// `suggest_horizon` a guess that needs no runs.

#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/mpc/hand_anchor.hpp"
#include "clothctl/prediction/window.hpp"
#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// What is sent to the plant when forces are planned.
enum class PlantCommand {
  /// The planned forces.
  Force,
  /// The positions that the held vertices reach under the planned forces, for a robot with a
  /// position controller.
  Position
};

/// How a patch of held vertices is kept from moving in ways that no finger can make ([Bai 2016],
/// eq. 3).
enum class PatchMode {
  /// Non-affine motion is a cost: the QP needs no patch rows. Fast.
  Soft,
  /// Non-affine motion is forbidden by equality rows. Exact; slower.
  Hard
};

/// Weights of the cost, SI units. The defaults suit a 0.5 m sheet, on plants that solve their
/// equations to convergence and on those that do not.
template <RealScalar Scalar>
struct PlannerWeights {
  /// w_f, 1/m².
  Scalar feature = Scalar(40);
  /// w_m for forces, 1/N².
  Scalar force = Scalar(1e-4);
  /// w_d, 1/N². Picks one of the many sets of coefficients that make a force.
  Scalar cone = Scalar(1e-4);
  /// w_m for velocities, s²/m², on the mean over a grip's vertices.
  Scalar velocity = Scalar(1e-5);
  /// w_s, s²/m².
  Scalar smooth = Scalar(0.003);
  /// w_l, dimensionless.
  Scalar shape = Scalar(0.1);
  /// w_h, 1/m².
  Scalar anchor = Scalar(3);
  /// w_p, 1/m².
  Scalar patch = Scalar(1000);
  /// w_g, 1/m².
  Scalar limit = Scalar(1e4);
  /// w_j, s²/m².
  Scalar jerk = Scalar(0);
  /// w_r, s²/m².
  Scalar step = Scalar(0);
};

/// Settings of a Planner.
template <RealScalar Scalar>
struct PlannerSettings {
  /// Frames K in the window.
  Index horizon = 20;
  /// Length of a frame h, s.
  Scalar dt = Scalar(0.02);
  /// What is planned: forces or poses.
  GripInput input = GripInput::Force;
  /// What is sent when forces are planned.
  PlantCommand command = PlantCommand::Force;
  /// How patches are kept together when forces are planned. A commanded pose is rigid anyway.
  PatchMode patch = PatchMode::Soft;
  /// Weights of the cost.
  PlannerWeights<Scalar> weights = {};
  /// Directions in which the hand anchor averages.
  HeavyChainAxes heavy_chain_axes = HeavyChainAxes::SheetNormal;
  /// Size of gravity, m/s² (hand anchor).
  Scalar gravity = Scalar(9.81);
  /// Agreement of predictions over half a window (PlanResult::window_agreement) that feedback
  /// needs, from 0 to below 1. Below it, the weight of the anchor grows, up to 16 times in a
  /// second, so that feedback through a wrong model cannot pump energy into the sheet. It falls
  /// again only with a reset. 0 leaves the weight as it is: better for motions of a few seconds.
  Scalar least_agreement = Scalar(0);
  /// Largest weight of the anchor under `least_agreement`, 1/m².
  Scalar most_anchor = Scalar(3000);
  /// Time in which the anchors take up a constant error of the features, s; 0: never. Use it for
  /// long runs: a sheet that leaves the fold of its start hangs beside its targets for ever. The
  /// anchors move by at most a tenth of the hanging length along each axis, and back at a reset.
  Scalar offset_time = Scalar(0);
  /// Longest step of a commanded grip in a frame along each axis, m; also of positions that planned
  /// forces reach (PlantCommand::Position).
  Scalar max_step = Scalar(0.05);
  /// Largest acceleration of a commanded grip along each axis, m/s², from its measured velocity; 0
  /// means any. What is sent keeps to it. The rest of the plan has it as bounds (poses) and as a
  /// cost (weight `limit`); forces that are sent have no more than the cost.
  Scalar max_acceleration = Scalar(0);
  /// Largest angular velocity of a commanded pose about each axis, rad/s; 0 means what max_step
  /// leaves.
  Scalar max_turn_rate = Scalar(0);
  /// Largest angular acceleration of a commanded pose about each axis, rad/s²; 0 means any.
  Scalar max_turn_acceleration = Scalar(0);
  /// Largest change of the planned velocity of a held vertex from one plan to the next, m/s; 0
  /// means any. Plans of poses are scaled back to it. Plans of forces are made again, up to four
  /// times in a frame, each time with four times the `step` weight (at least 1e-4 s²/m², at most 64
  /// times the given one).
  Scalar max_change = Scalar(0);
  /// Planned poses as splines in time: numbers of frames between the knots of the velocities, which
  /// sum to the horizon; empty means free velocities in every frame.
  std::vector<Index> input_intervals = {};
  /// Degree of those splines, 0 to 3: 0 is move blocking, one input for each interval.
  int input_degree = 0;
  /// Tolerances and budget of the QPs of a frame, for solvers that are made from QpSettings. The
  /// default of 300 iterations is more than a successful plan needs. If a QP reaches the limit, the
  /// plan is Suboptimal. A frame plans again, for `max_change` or limits of the grips, only as long
  /// as its QPs have taken fewer iterations than this together; 0 means no limit.
  QpSettings<Scalar> qp = default_qp();
  /// The upward force that the grips carry together at rest, N: minus the weight of the sheet,
  /// `plant.gravity_load()`. Each held vertex has its share of it as u_ref. Left at zero, the
  /// effort term pulls the sheet down.
  Vector3<Scalar> gravity_load = Vector3<Scalar>::Zero();

  /// Returns the defaults of `qp`.
  static QpSettings<Scalar> default_qp() {
    QpSettings<Scalar> s;
    s.max_iterations = 300;
    return s;
  }

  /// Returns the cost of [Bai 2016]: weights 40, 0.01 and 10 on displacements per frame, total
  /// force as effort, no anchor. Their 10 |Δ(c per frame)|² is 10 h² |Δċ|². It loses the track on
  /// sheets that are not the predictor; for comparison only. `dt` is the length of a frame, s.
  static PlannerSettings paper(Scalar dt = Scalar(0.02)) {
    PlannerSettings s;
    s.dt = dt;
    s.weights.feature = Scalar(40);
    s.weights.force = Scalar(0.01);
    s.weights.cone = Scalar(1e-6);
    s.weights.smooth = Scalar(10) * s.dt * s.dt;
    s.weights.shape = Scalar(10);
    s.weights.anchor = Scalar(0);
    return s;
  }

  /// Returns settings for a RolloutPredictor: small, damped corrections (`smooth` 0.02 and `jerk`
  /// 0.01 s²/m², `max_change` 0.1 m/s). `step`: the weight w_r, s²/m². Where the model derives its
  /// rollouts (MassSpringRollout), a `step` of 0.05 is better, and a `smooth` of 0.2 but for forces
  /// on a plant that is not the model: with less, hands swing if targets are further apart than the
  /// sheet lets them.
  static PlannerSettings rollout(Scalar step = Scalar(0.01)) {
    PlannerSettings s;
    s.weights.smooth = Scalar(0.02);
    s.weights.jerk = Scalar(0.01);
    s.weights.step = step;
    s.max_change = Scalar(0.1);
    return s;
  }

  /// Returns an empty string, or a line that names the first bad setting and its value.
  std::string validate() const {
    const auto bad = [](const Scalar& value) { return !is_finite(value) || value < Scalar(0); };
    if (horizon < 1) return "horizon is " + std::to_string(horizon) + ", must be at least 1";
    const std::array<std::pair<const char*, const Scalar*>, 17> weighed{
        {{"feature", &weights.feature},
         {"force", &weights.force},
         {"cone", &weights.cone},
         {"velocity", &weights.velocity},
         {"smooth", &weights.smooth},
         {"shape", &weights.shape},
         {"anchor", &weights.anchor},
         {"patch", &weights.patch},
         {"limit", &weights.limit},
         {"jerk", &weights.jerk},
         {"step", &weights.step},
         {"most_anchor", &most_anchor},
         {"offset_time", &offset_time},
         {"max_change", &max_change},
         {"max_acceleration", &max_acceleration},
         {"max_turn_rate", &max_turn_rate},
         {"max_turn_acceleration", &max_turn_acceleration}}};
    for (const auto& [name, value] : weighed) {
      if (bad(*value))
        return std::string(name) + " is " + number_text(*value) +
               ", must be finite and not negative";
    }
    const std::array<std::pair<const char*, const Scalar*>, 3> positive{
        {{"dt", &dt}, {"gravity", &gravity}, {"max_step", &max_step}}};
    for (const auto& [name, value] : positive) {
      if (bad(*value) || !(Scalar(0) < *value))
        return std::string(name) + " is " + number_text(*value) + ", must be positive";
    }
    if (bad(least_agreement) || !(least_agreement < Scalar(1)))
      return "least_agreement is " + number_text(least_agreement) + ", must be 0 to below 1";
    if (!all_finite(gravity_load)) return "gravity_load is not finite";
    if (input == GripInput::Pose && command != PlantCommand::Force)
      return "command is Position with pose input; poses are always sent as positions";
    if (const std::string problem(qp.validate()); !problem.empty()) return "qp: " + problem;
    return validate_splines();
  }

 private:
  std::string validate_splines() const {
    if (input_degree < 0 || 3 < input_degree)
      return "input_degree is " + std::to_string(input_degree) + ", must be 0 to 3";
    if (input_intervals.empty()) return {};
    Index sum = 0;
    for (const Index& length : input_intervals) {
      if (length < 1 || horizon < length)
        return "input_intervals holds " + std::to_string(length) + ", must be 1 to " +
               std::to_string(horizon);
      sum += length;
    }
    const std::string frames = " frames, the horizon is " + std::to_string(horizon);
    if (sum != horizon) return "input_intervals sums to " + std::to_string(sum) + frames;
    const Index count = static_cast<Index>(input_intervals.size()) + input_degree;
    if (horizon < count)
      return "splines of degree " + std::to_string(input_degree) + " have " +
             std::to_string(count) + " control points for " + std::to_string(horizon) + " frames";
    if (input == GripInput::Force)
      return "input_intervals is for poses; forces must balance in every frame";
    return {};
  }
};

/// Returns the number of frames of `dt` (s) after which a longer window gains little, for features
/// that hang `hanging_length` (m) below the hands: the time 1.5 √(L/g), three quarters of that in
/// which a swing travels down a hanging chain, 2 √(L/g). Gravity: m/s². 12 frames of 0.02 s for
/// 0.25 m, 17 for 0.5 m, 24 for 1 m, where the error of closed loops settles (docs/planner.md);
/// violent curves gain by more. At least 1. Returns an error when an argument is not positive, or
/// for more than 10⁴ frames.
template <RealScalar Scalar>
Result<Index> suggest_horizon(Scalar hanging_length, Scalar dt, Scalar gravity = Scalar(9.81)) {
  using std::sqrt;
  const auto bad = [](const Scalar& x) { return !is_finite(x) || !(Scalar(0) < x); };
  if (bad(hanging_length))
    return Error{"the hanging length is " + number_text(hanging_length) + " m, must be positive"};
  if (bad(dt)) return Error{"dt is " + number_text(dt) + " s, must be positive"};
  if (bad(gravity)) return Error{"gravity is " + number_text(gravity) + ", must be positive"};
  const Scalar time = Scalar(1.5) * sqrt(hanging_length / gravity);
  Index frames = 1;
  while (Scalar(static_cast<double>(frames)) * dt < time) {
    if (++frames > 10000) return Error{"a window would need over 10000 frames"};
  }
  return frames;
}

/// What a search for a horizon found.
template <RealScalar Scalar>
struct HorizonSearch {
  /// The first horizon that was accurate enough, else the most accurate one; 0 where no run gave a
  /// finite error.
  Index horizon = 0;
  /// Its error, m.
  Scalar error = Scalar(0);
  /// Whether it was accurate enough.
  bool accurate = false;
};

/// Runs `error(horizon)` (m) for horizons from `first` to `last` in steps of `step` until the error
/// is at most `accuracy` (m): the procedure of [Bai 2016]. An error that is not finite counts as a
/// failed run. Allocates what `error` does. Fails when: first or step is below 1, or
/// the accuracy is not finite (nothing is run).
template <RealScalar Scalar, class MeanError>
HorizonSearch<Scalar> search_horizon(Index first, Index last, Index step, Scalar accuracy,
                                     MeanError&& error) {
  HorizonSearch<Scalar> found;
  if (first < 1 || step < 1 || !is_finite(accuracy)) return found;
  for (Index horizon = first; horizon <= last && !found.accurate; horizon += step) {
    const Scalar now = error(horizon);
    if (!is_finite(now) || (found.horizon != 0 && !(now < found.error))) continue;
    found.horizon = horizon;
    found.error = now;
    found.accurate = now <= accuracy;
  }
  return found;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
