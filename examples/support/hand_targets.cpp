#include "support/hand_targets.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>

#include "clothctl/io/html_player.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "support/hand_figures.hpp"
#include "support/hand_shape.hpp"
#include "support/options.hpp"
#include "support/timing.hpp"

namespace program {

namespace {

using clothctl::Body;
using clothctl::BodyPoses;
using clothctl::IkReport;
using clothctl::IkStatus;
using clothctl::IkTask;
using clothctl::Index;
using clothctl::JointType;
using clothctl::KinematicTree;
using clothctl::Vector3;
using clothctl::VectorX;

constexpr double kReached = 1e-3;  // m
constexpr int kRestarts = 20;

/// Random numbers that are the same with every standard library.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  /// Uniform in [0, 1).
  double operator()() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }

 private:
  std::mt19937_64 engine_;
};

/// Returns whether a coordinate has limits to draw between.
template <class Scalar>
bool is_limited(const KinematicTree<Scalar>& tree, Index i) {
  return !clothctl::is_unbounded(tree.lower()[i]) && !clothctl::is_unbounded(tree.upper()[i]);
}

template <class Scalar>
VectorX<Scalar> random_pose(const KinematicTree<Scalar>& tree, Random& random) {
  VectorX<Scalar> q = tree.neutral();
  for (Index i = 0; i < q.size(); ++i) {
    if (is_limited(tree, i))
      q[i] = tree.lower()[i] + static_cast<Scalar>(random()) * (tree.upper()[i] - tree.lower()[i]);
  }
  return q;
}

/// Draws a pose within a tenth of each joint's range.
template <class Scalar>
VectorX<Scalar> near_pose(const KinematicTree<Scalar>& tree, VectorX<Scalar> q, Random& random) {
  for (Index i = 0; i < q.size(); ++i) {
    if (!is_limited(tree, i)) continue;
    const Scalar share = static_cast<Scalar>(0.1 * (2 * random() - 1));
    q[i] = std::clamp<Scalar>(q[i] + share * (tree.upper()[i] - tree.lower()[i]), tree.lower()[i],
                              tree.upper()[i]);
  }
  return q;
}

template <class Scalar>
class Reach {
 public:
  Reach(const KinematicTree<Scalar>& tree, std::vector<int> tips)
      : tree_(tree),
        tips_(std::move(tips)),
        body_poses_(tree),
        ik_(tree, static_cast<int>(tips_.size())) {}

  /// Returns tasks that put the tips where they are at q.
  std::vector<IkTask<Scalar>> tasks_at(const VectorX<Scalar>& q) {
    std::vector<IkTask<Scalar>> tasks;
    clothctl::forward_kinematics<Scalar>(tree_, q, body_poses_);
    for (const int tip : tips_) {
      const Vector3<Scalar> place = clothctl::link_pose(tree_, body_poses_, tip).p;
      tasks.push_back(IkTask<Scalar>::position(tip, Vector3<Scalar>::Zero(), place));
    }
    return tasks;
  }

  /// Returns the largest distance of a tip from its target (m).
  double distance(const std::vector<IkTask<Scalar>>& tasks, const VectorX<Scalar>& q) {
    clothctl::forward_kinematics<Scalar>(tree_, q, body_poses_);
    double largest = 0;
    for (const IkTask<Scalar>& task : tasks) {
      const Vector3<Scalar> gap =
          clothctl::link_pose(tree_, body_poses_, task.frame).p - task.target;
      largest = std::max(largest, static_cast<double>(gap.norm()));
    }
    return largest;
  }

  IkStatus solve(const std::vector<IkTask<Scalar>>& tasks, VectorX<Scalar>& q, int restarts,
                 Random& random, Tally& tally) {
    const double before = thread_seconds();
    const IkReport<Scalar> report = ik_.solve(tree_, tasks, VectorX<Scalar>(), q, restarts, random);
    tally.microseconds.push_back(1e6 * (thread_seconds() - before));
    tally.iterations.push_back(report.iterations);
    const double error = distance(tasks, q);
    const bool reached = error <= kReached;
    ++tally.solves;
    tally.starts += report.starts;
    tally.reached += reached ? 1 : 0;
    tally.local_minimum += report.status == IkStatus::LocalMinimum ? 1 : 0;
    tally.iteration_limit += report.status == IkStatus::IterationLimit ? 1 : 0;
    if (reached) tally.error = std::max(tally.error, error);
    tally.worst = std::max(tally.worst, error);
    return report.status;
  }

 private:
  const KinematicTree<Scalar>& tree_;
  std::vector<int> tips_;
  BodyPoses<Scalar> body_poses_;
  clothctl::InverseKinematics<KinematicTree<Scalar>, Scalar> ik_;
};

/// Draws a pose for the page, near the middle of the limits, so that the hand stays in view.
VectorX<double> shown_pose(const KinematicTree<double>& tree, Random& random) {
  VectorX<double> q = tree.neutral();
  for (const Body<double>& body : tree.bodies()) {
    const Index i = body.position;
    if (body.type == JointType::Free || body.follows || !is_limited(tree, i)) continue;
    const double reach = std::min(body.type == JointType::Prismatic ? 0.05 : 0.6,
                                  0.5 * (tree.upper()[i] - tree.lower()[i]));
    q[i] = 0.5 * (tree.lower()[i] + tree.upper()[i]) + reach * (2 * random() - 1);
  }
  return q;
}

}  // namespace

/// Adds the figures of several solves; `suffix` is appended to the keys.
void add_tally(nlohmann::ordered_json& j, const Tally& t, const std::string& suffix) {
  const bool ran = t.solves > 0;
  j["reached_share" + suffix] = known(ran ? double(t.reached) / t.solves : 0, ran);
  j["error_m" + suffix] = known(t.error, t.reached > 0);
  j["iterations_median" + suffix] = known(quantile(t.iterations, 0.5), ran);
  j["microseconds_median" + suffix] = known(quantile(t.microseconds, 0.5), ran);
}

void add_more(nlohmann::ordered_json& j, const Tally& t, const std::string& suffix) {
  const bool ran = t.solves > 0;
  j["microseconds_p99" + suffix] = known(quantile(t.microseconds, 0.99), ran);
  j["starts_mean" + suffix] = known(ran ? double(t.starts) / t.solves : 0, ran);
  j["worst_error_m" + suffix] = known(t.worst, ran);
  j["local_minimum" + suffix] = known(t.local_minimum, ran);
  j["iteration_limit" + suffix] = known(t.iteration_limit, ran);
}

template <class Scalar>
ReachRuns run_targets(const KinematicTree<Scalar>& tree, const std::vector<int>& tips,
                      const ReachRequest& o) {
  ReachRuns runs;
  Reach<Scalar> reach(tree, tips);
  // All targets and starts are drawn before the restarts, so that they do not depend on the number
  // of restarts.
  Random random(o.seed);
  std::vector<VectorX<Scalar>> goals, near_starts, starts;
  for (int k = 0; k < o.targets; ++k) {
    goals.push_back(random_pose(tree, random));
    near_starts.push_back(near_pose(tree, goals.back(), random));
    starts.push_back(random_pose(tree, random));
  }
  Progress progress;
  for (std::size_t k = 0; k < goals.size(); ++k) {
    progress.show(static_cast<long>(k), o.targets);
    const std::vector<IkTask<Scalar>> tasks = reach.tasks_at(goals[k]);
    (void)reach.solve(tasks, near_starts[k], 0, random, runs.near_starts);
    (void)reach.solve(tasks, starts[k], kRestarts, random, runs.random);
  }
  for (Index i = 0; i < tree.nq(); ++i) {
    if (!is_limited(tree, i)) return runs;  // no target can be out of reach
  }
  for (std::size_t k = 0; k < std::min<std::size_t>(goals.size(), 100); ++k) {
    std::vector<IkTask<Scalar>> tasks = reach.tasks_at(goals[k]);
    Vector3<Scalar> away;
    do {
      for (int c = 0; c < 3; ++c) away[c] = static_cast<Scalar>(2 * random() - 1);
    } while (!(away.norm() > Scalar(0.1) && away.norm() < Scalar(1)));
    tasks[k % tasks.size()].target += Scalar(10) * away.normalized();
    (void)reach.solve(tasks, starts[k], 0, random, runs.unreachable);
  }
  return runs;
}

template <class Scalar>
std::vector<int> find_tips(const KinematicTree<Scalar>& tree, const ReachRequest& o) {
  if (o.tips.empty()) return chain_ends(tree);
  std::vector<int> tips;
  for (const std::string& name : o.tips) {
    const int link = tree.find_link(name);
    if (link < 0) refuse("--tips: '" + name + "' is not a link of " + o.model);
    if (tree.links()[static_cast<std::size_t>(link)].body < 0)
      refuse("--tips: '" + name + "' does not move in " + o.model);
    if (std::find(tips.begin(), tips.end(), link) != tips.end())
      refuse("--tips: '" + name + "' occurs twice");
    tips.push_back(link);
  }
  return tips;
}

void write_reach_page(const KinematicTree<double>& tree, const std::string& name,
                      const std::vector<int>& tips, const ReachRequest& o,
                      const nlohmann::ordered_json& figures) {
  constexpr int kTargets = 6, kMove = 36, kRest = 12;
  Random random(o.seed);
  Reach<double> reach(tree, tips);
  BodyPoses<double> body_poses(tree);
  VectorX<double> q = shown_pose(tree, random), step(tree.nv()), now(tree.nq());
  clothctl::forward_kinematics<double>(tree, q, body_poses);
  const HandShape shape = make_hand_shape(tree, body_poses);
  clothctl::PlayerScene scene;
  scene.mesh_name = "Robot";
  scene.title = name + " reaches for targets";
  scene.subtitle = std::to_string(tree.nv()) + " joints, " + std::to_string(tips.size()) +
                   " tips; all go to their targets at once by inverse kinematics";
  scene.dt = 1.0 / 30;
  scene.triangles = shape.triangles;
  for (const int tip : tips)
    scene.feature_names.push_back(tree.links()[static_cast<std::size_t>(tip)].name);
  const Index count = static_cast<Index>(tips.size());
  clothctl::PlayerRecorder recorder(scene, shape.vertices.cols(), count, 0);
  Eigen::Matrix3Xd vertices, actual(3, count), wanted(3, count);
  const Eigen::Matrix3Xd none(3, 0);
  Tally tally;
  for (int target = 0; target < kTargets; ++target) {
    const std::vector<IkTask<double>> tasks = reach.tasks_at(shown_pose(tree, random));
    VectorX<double> goal = q;
    (void)reach.solve(tasks, goal, kRestarts, random, tally);
    tree.difference(q, goal, step);
    for (Index k = 0; k < count; ++k) wanted.col(k) = tasks[static_cast<std::size_t>(k)].target;
    for (int frame = 0; frame < kMove + kRest; ++frame) {
      tree.advance(q, smooth_share(double(frame) / kMove) * step, now);
      clothctl::forward_kinematics<double>(tree, now, body_poses);
      place_hand(shape, body_poses, vertices);
      for (Index k = 0; k < count; ++k)
        actual.col(k) = clothctl::link_pose(tree, body_poses, tips[static_cast<std::size_t>(k)]).p;
      recorder.add_frame(vertices, actual, wanted, none, none);
    }
    q = goal;
  }
  const auto add = [&](const char* text, const std::string& value) {
    recorder.scene().figures.emplace_back(text, value);
  };
  add("Targets shown, reached",
      std::to_string(tally.reached) + " of " + std::to_string(tally.solves));
  add("Largest error", millimetres(tally.error));
  for (const auto& [key, text] : {std::pair("reached_share", "Reached, random starts"),
                                  std::pair("reached_share_near", "Reached, near starts"),
                                  std::pair("microseconds_median", "Time, median, µs")}) {
    char number[32];
    if (!figures[key].is_number()) continue;
    std::snprintf(number, sizeof number, "%.4g", figures[key].get<double>());
    add(text, number);
  }
  must(recorder.write(o.out + "/player.html"));
}

template std::vector<int> find_tips(const KinematicTree<float>&, const ReachRequest&);
template std::vector<int> find_tips(const KinematicTree<double>&, const ReachRequest&);
template ReachRuns run_targets(const KinematicTree<float>&, const std::vector<int>&,
                               const ReachRequest&);
template ReachRuns run_targets(const KinematicTree<double>&, const std::vector<int>&,
                               const ReachRequest&);

}  // namespace program
