#pragma once

// Plans a path of joint positions that keeps a robot away from obstacles: a chain of straight
// motions in joint space, each *proved* free. The caller gives
//
//   clearance(q)  the distance between robot and obstacles at the posture q (m), or a lower bound
//                 of it; negative where they overlap
//   reach         for each joint, a bound of how far any point of the robot moves per unit of that
//                 joint (m; 1 for a prismatic joint, the longest arm beyond it for a revolute one)
//
// way(a, b) = Σ_i reach_i |a_i - b_i| then bounds how far any point goes on a straight motion, and
// the clearance at q tells about all postures around it. A motion is free when such balls cover it
// (detail/motion_check.hpp); obstacles thinner than any step cannot slip through. The planner first
// tries the straight motion. Else it grows two trees until they meet (RRT-Connect,
// detail/joint_trees.hpp), and then shortens the path (detail/path_shortcuts.hpp).
//
// Failure proves nothing: the planner finds a path with a probability that tends to 1 with its
// iterations where a path with more than the margin's clearance exists.
//
// Reference: Kuffner, LaValle, RRT-Connect: an efficient approach to single-query path planning,
// ICRA 2000. Proof by balls: Schwarzer, Saha, Latombe, Exact collision checking of robot paths,
// WAFR 2002.

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/grasp/detail/joint_path_input.hpp"
#include "clothctl/grasp/detail/joint_trees.hpp"
#include "clothctl/grasp/detail/motion_check.hpp"
#include "clothctl/grasp/detail/path_shortcuts.hpp"
#include "clothctl/grasp/detail/split_mix.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of `plan_joint_path`.
template <RealScalar Scalar>
struct JointPathSettings {
  /// Length of a step of the trees, m of way(a, b). Long steps cross open space quickly, short ones
  /// get through narrow places.
  Scalar step = Scalar(0.1);
  /// Least clearance of each posture that is looked at, m. Between these the clearance is at least
  /// margin - resolution / 2.
  Scalar margin = Scalar(1e-3);
  /// A motion is divided until what is not proved to have the margin's clearance is at most this
  /// long, m of way(a, b). At least 1e-6, and at most twice the margin, so that no motion touches
  /// an obstacle.
  Scalar resolution = Scalar(1e-3);
  /// Largest number of iterations of the trees. At 0 only the straight motion is tried.
  int max_iterations = 5000;
  /// Number of random shortcuts that are tried. At 0 the path stays as the trees left it.
  int shortcuts = 200;
  /// Seed of the random choices.
  std::uint64_t seed = 1;

  /// Returns an empty string, or what is wrong. Allocates.
  std::string validate() const {
    const auto bad = [](const Scalar& x) { return !is_finite(x) || !(Scalar(0) < x); };
    if (bad(step)) return "step is " + number_text(step) + " m, expected a positive number";
    if (bad(margin)) return "margin is " + number_text(margin) + " m, expected a positive number";
    if (bad(resolution) || resolution < Scalar(1e-6))
      return "resolution is " + number_text(resolution) + " m, expected at least 1e-6";
    if (Scalar(2) * margin < resolution) {
      return "resolution is " + number_text(resolution) + " m, expected at most twice the margin " +
             number_text(margin) + " m";
    }
    if (max_iterations < 0)
      return "max_iterations is " + std::to_string(max_iterations) + ", expected at least 0";
    if (shortcuts < 0) return "shortcuts is " + std::to_string(shortcuts) + ", expected at least 0";
    return {};
  }
};

/// How a search for a path ended.
enum class JointPathStatus {
  /// A path was found, and every motion of it is proved free. Use it.
  Found,
  /// A setting, a size or a number is bad, or a clearance is NaN. Correct it; `message` names it.
  InvalidInput,
  /// The start or the goal is beyond a limit. `message` names the joint. Clamp it, or choose
  /// another.
  OutOfLimits,
  /// At the start the clearance is less than the margin. Move away first, or lower the margin.
  StartCollides,
  /// At the goal the clearance is less than the margin. Choose another, or lower the margin.
  GoalCollides,
  /// No path was found within the iterations. There may be one: try another seed, more iterations,
  /// a shorter step, or another goal.
  NotFound
};

/// Returns the name of a status.
constexpr std::string_view to_string(JointPathStatus status) {
  switch (status) {
    case JointPathStatus::Found: return "found";
    case JointPathStatus::InvalidInput: return "invalid_input";
    case JointPathStatus::OutOfLimits: return "out_of_limits";
    case JointPathStatus::StartCollides: return "start_collides";
    case JointPathStatus::GoalCollides: return "goal_collides";
    case JointPathStatus::NotFound: return "not_found";
  }
  return "unknown";
}

/// What `plan_joint_path` found.
template <RealScalar Scalar>
struct JointPath {
  /// How the search ended.
  JointPathStatus status = JointPathStatus::InvalidInput;
  /// What went wrong, in one line; empty where a path was found.
  std::string message;
  /// The corners of the path (m or rad), from start to goal, both included; at least 2. Empty where
  /// none was found.
  std::vector<VectorX<Scalar>> positions;
  /// Sum of way(a, b) over the motions, m.
  Scalar length = Scalar(0);
  /// Iterations of the trees that were spent; 0 where the straight motion is free.
  int iterations = 0;
  /// How often the clearance was asked.
  long queries = 0;
};

namespace detail {

/// Searches a path between two free postures. Returns it, or none.
template <RealScalar Scalar, class Clearance>
std::vector<Posture<Scalar>> search_path(MotionCheck<Scalar, Clearance>& motions,
                                         const JointBox<Scalar>& box, const Posture<Scalar>& from,
                                         const Posture<Scalar>& to,
                                         const JointPathSettings<Scalar>& settings,
                                         int& iterations) {
  if (motions.is_free(from, to)) return {from, to};
  SplitMix random(settings.seed);
  JointTrees<Scalar, Clearance> trees(motions, box, settings.step, from, to);
  std::vector<Posture<Scalar>> found = trees.connect(random, settings.max_iterations, iterations);
  if (found.empty() || settings.shortcuts == 0) return found;
  PathShortcuts<Scalar, Clearance> path(motions, std::move(found));
  for (int k = 0; k < settings.shortcuts; ++k) path.cut(random);
  path.drop_corners();
  return path.path();
}

}  // namespace detail

/// Plans a path from `from` to `to` (n, m or rad) within `lower` and `upper` (n, infinite for
/// none), with `reach` (n, m per unit, ≥ 0) and `clearance` as above. `clearance` must return the
/// same for the same posture. A joint without limits is sampled between start and goal, widened on
/// each side by way(from, to) / reach, the motion of this joint that would be as long as the
/// straight way. The same input gives the same bits. Allocates. Complexity: O(nodes · n) for each
/// iteration, and the queries; these are few in open space, and about way / resolution along an
/// obstacle at the margin. Fails when: see JointPathStatus.
template <RealScalar Scalar, class Clearance>
requires std::is_invocable_r_v < Scalar, Clearance&, const VectorX<Scalar>
& > [[nodiscard]] JointPath<Scalar> plan_joint_path(
        const VectorX<Scalar>& from, const VectorX<Scalar>& to, const VectorX<Scalar>& lower,
        const VectorX<Scalar>& upper, const VectorX<Scalar>& reach, Clearance&& clearance,
        const std::type_identity_t<JointPathSettings<Scalar>>& settings = {}) {
  using Ended = JointPathStatus;
  JointPath<Scalar> result;
  const auto end = [&result](Ended status, const std::string& message) {
    result.status = status;
    result.message = message;
    return result;
  };
  if (const std::string bad = settings.validate(); !bad.empty())
    return end(Ended::InvalidInput, bad);
  if (const std::string bad = detail::bad_joint_input(from, to, lower, upper, reach); !bad.empty())
    return end(Ended::InvalidInput, bad);
  if (const std::string bad = detail::beyond_limit("start", from, lower, upper); !bad.empty())
    return end(Ended::OutOfLimits, bad);
  if (const std::string bad = detail::beyond_limit("goal", to, lower, upper); !bad.empty())
    return end(Ended::OutOfLimits, bad);

  using Check = detail::MotionCheck<Scalar, std::remove_reference_t<Clearance>>;
  Check motions(clearance, reach, settings.margin, settings.resolution);
  std::vector<detail::Posture<Scalar>> path;
  const auto start = motions.posture(from), goal = motions.posture(to);
  if (!motions.collides(start) && !motions.collides(goal)) {
    path = detail::search_path(motions, detail::sampling_box(from, to, lower, upper, reach), start,
                               goal, settings, result.iterations);
  }
  result.queries = motions.queries();
  const auto collides = [&settings](const char* what, const Scalar& clearance_there) {
    return std::string("the ") + what + " has a clearance of " + rounded_text(clearance_there) +
           " m, less than the margin " + number_text(settings.margin) + " m";
  };
  if (motions.broken())
    return end(Ended::InvalidInput, detail::broken_clearance(motions.broken_at()));
  if (motions.collides(start)) return end(Ended::StartCollides, collides("start", start.clearance));
  if (motions.collides(goal)) return end(Ended::GoalCollides, collides("goal", goal.clearance));
  if (path.empty()) {
    return end(Ended::NotFound,
               "no path was found in " + std::to_string(result.iterations) + " iterations");
  }
  for (const detail::Posture<Scalar>& p : path) {
    if (!result.positions.empty()) result.length += motions.way(result.positions.back(), p.q);
    result.positions.push_back(p.q);
  }
  result.status = Ended::Found;
  return result;
}

/// Returns whether the straight motions through `positions` (each n, assert) are proved free: at
/// each posture that is looked at the clearance is at least `margin` (m), and between these at
/// least margin - resolution / 2 (resolution > 0, m; assert). A clearance that is NaN is not free.
/// A path of `plan_joint_path` is free with its settings. Allocates. Complexity: as in
/// `plan_joint_path`.
template <RealScalar Scalar, class Clearance>
requires std::is_invocable_r_v < Scalar, Clearance&, const VectorX<Scalar>
& > [[nodiscard]] bool is_path_free(const std::vector<VectorX<Scalar>>& positions,
                                    const VectorX<Scalar>& reach, Clearance&& clearance,
                                    const std::type_identity_t<Scalar>& margin,
                                    const std::type_identity_t<Scalar>& resolution) {
  assert(Scalar(0) < resolution);
  using Check = detail::MotionCheck<Scalar, std::remove_reference_t<Clearance>>;
  Check motions(clearance, reach, margin, resolution);
  detail::Posture<Scalar> last;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    assert(positions[i].size() == reach.size());
    detail::Posture<Scalar> next = motions.posture(positions[i]);
    if (motions.collides(next) || (i > 0 && !motions.is_free(last, next))) return false;
    last = std::move(next);
  }
  return true;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
