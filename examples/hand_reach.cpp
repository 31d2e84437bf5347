// Checks a robot's kinematics and dynamics against another library's figures, and puts all its finger tips to targets at once
// by inverse kinematics.
//
//   hand_reach --model hand.urdf --oracle hand.json              largest differences; exit code 1 where they are too large
//   hand_reach --model hand.urdf --targets 1000 --out folder     share of targets reached, and a page that shows the hand

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

#include "clothctl/bridge/urdf.hpp"
#include "clothctl/io/html_player.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/tree_model.hpp"
#include "support/hand_figures.hpp"
#include "support/hand_oracle.hpp"
#include "support/hand_shape.hpp"
#include "support/options.hpp"
#include "support/timing.hpp"

namespace {

using namespace program;
using clothctl::Index;
using clothctl::Vector3;
using clothctl::VectorX;
using clothctl::robot::Body;
using clothctl::robot::IkReport;
using clothctl::robot::IkStatus;
using clothctl::robot::IkTask;
using clothctl::robot::JointType;
using clothctl::robot::Kinematics;
using clothctl::robot::Tree;

constexpr double kReached = 1e-3;  // m
constexpr int kRestarts = 20;

struct Request {
  std::string model, oracle, out;
  std::vector<std::string> tips;
  int targets = 0;
  std::uint64_t seed = 1;
  bool single = false, json = false;
};

/// Random numbers that are the same with every standard library.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  /// Evenly from [0, 1).
  double operator()() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }

 private:
  std::mt19937_64 engine_;
};

/// Whether a coordinate has limits to draw from.
template <class Scalar>
bool is_limited(const Tree<Scalar>& tree, Index i) {
  return !clothctl::is_unbounded(tree.lower()[i]) && !clothctl::is_unbounded(tree.upper()[i]);
}

template <class Scalar>
VectorX<Scalar> random_pose(const Tree<Scalar>& tree, Random& random) {
  VectorX<Scalar> q = tree.neutral();
  for (Index i = 0; i < q.size(); ++i) {
    if (is_limited(tree, i)) q[i] = tree.lower()[i] + static_cast<Scalar>(random()) * (tree.upper()[i] - tree.lower()[i]);
  }
  return q;
}

/// A pose within a tenth of each joint's range.
template <class Scalar>
VectorX<Scalar> near_pose(const Tree<Scalar>& tree, VectorX<Scalar> q, Random& random) {
  for (Index i = 0; i < q.size(); ++i) {
    if (!is_limited(tree, i)) continue;
    const Scalar share = static_cast<Scalar>(0.1 * (2 * random() - 1));
    q[i] = std::clamp<Scalar>(q[i] + share * (tree.upper()[i] - tree.lower()[i]), tree.lower()[i], tree.upper()[i]);
  }
  return q;
}

/// What a set of solves came to.
struct Tally {
  int solves = 0, reached = 0, local_minimum = 0, iteration_limit = 0, starts = 0;
  double error = 0, worst = 0;  // of those that reached, and of all (m)
  std::vector<double> iterations, microseconds;
};

template <class Scalar>
class Reach {
 public:
  Reach(const Tree<Scalar>& tree, std::vector<int> tips)
      : tree_(tree), tips_(std::move(tips)), kinematics_(tree), ik_(tree, static_cast<int>(tips_.size())) {}

  /// Tasks that put the tips to where they are at q.
  std::vector<IkTask<Scalar>> tasks_at(const VectorX<Scalar>& q) {
    std::vector<IkTask<Scalar>> tasks;
    clothctl::robot::forward_kinematics<Scalar>(tree_, q, kinematics_);
    for (const int tip : tips_) {
      const Vector3<Scalar> place = clothctl::robot::link_pose(tree_, kinematics_, tip).p;
      tasks.push_back(IkTask<Scalar>::position(tip, Vector3<Scalar>::Zero(), place));
    }
    return tasks;
  }

  /// The largest distance of a tip to its target (m).
  double distance(const std::vector<IkTask<Scalar>>& tasks, const VectorX<Scalar>& q) {
    clothctl::robot::forward_kinematics<Scalar>(tree_, q, kinematics_);
    double largest = 0;
    for (const IkTask<Scalar>& task : tasks) {
      const Vector3<Scalar> gap = clothctl::robot::link_pose(tree_, kinematics_, task.frame).p - task.target;
      largest = std::max(largest, static_cast<double>(gap.norm()));
    }
    return largest;
  }

  IkStatus solve(const std::vector<IkTask<Scalar>>& tasks, VectorX<Scalar>& q, int restarts, Random& random, Tally& tally) {
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
  const Tree<Scalar>& tree_;
  std::vector<int> tips_;
  Kinematics<Scalar> kinematics_;
  clothctl::robot::InverseKinematics<Tree<Scalar>, Scalar> ik_;
};

/// Adds what a set of solves came to; `suffix` goes to the end of the keys.
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

/// Figures of targets at random poses, from starts near them and from random ones.
struct Runs {
  Tally random, near, unreachable;
};

template <class Scalar>
Runs run_targets(const Tree<Scalar>& tree, const std::vector<int>& tips, const Request& o) {
  Runs runs;
  Reach<Scalar> reach(tree, tips);
  // All targets and starts are drawn before the restarts, so that they do not depend on how many of those it takes.
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
    (void)reach.solve(tasks, near_starts[k], 0, random, runs.near);
    (void)reach.solve(tasks, starts[k], kRestarts, random, runs.random);
  }
  for (Index i = 0; i < tree.positions(); ++i) {
    if (!is_limited(tree, i)) return runs;  // nothing may be out of its reach
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

/// The links that --tips names, or the ends of all chains.
template <class Scalar>
std::vector<int> find_tips(const Tree<Scalar>& tree, const Request& o) {
  if (o.tips.empty()) return chain_ends(tree);
  std::vector<int> tips;
  for (const std::string& name : o.tips) {
    const int link = tree.find_link(name);
    if (link < 0) refuse("--tips: '" + name + "' is no link of " + o.model);
    if (tree.links()[static_cast<std::size_t>(link)].body < 0) refuse("--tips: '" + name + "' does not move in " + o.model);
    if (std::find(tips.begin(), tips.end(), link) != tips.end()) refuse("--tips: '" + name + "' is there twice");
    tips.push_back(link);
  }
  return tips;
}

/// A pose for the page: not far from the middle of the limits, so that the picture stays in its frame.
VectorX<double> shown_pose(const Tree<double>& tree, Random& random) {
  VectorX<double> q = tree.neutral();
  for (const Body<double>& body : tree.bodies()) {
    const Index i = body.position;
    if (body.type == JointType::Free || body.follows || !is_limited(tree, i)) continue;
    const double reach = std::min(body.type == JointType::Prismatic ? 0.05 : 0.6, 0.5 * (tree.upper()[i] - tree.lower()[i]));
    q[i] = 0.5 * (tree.lower()[i] + tree.upper()[i]) + reach * (2 * random() - 1);
  }
  return q;
}

/// Writes a page on which the hand goes from target to target.
void write_page(const Tree<double>& tree, const std::string& name, const std::vector<int>& tips, const Request& o,
                const nlohmann::ordered_json& figures) {
  constexpr int kTargets = 6, kMove = 36, kRest = 12;
  Random random(o.seed);
  Reach<double> reach(tree, tips);
  Kinematics<double> kinematics(tree);
  VectorX<double> q = shown_pose(tree, random), step(tree.velocities()), now(tree.positions());
  clothctl::robot::forward_kinematics<double>(tree, q, kinematics);
  const HandShape shape = make_hand_shape(tree, kinematics);
  clothctl::PlayerScene scene;
  scene.mesh_name = "Robot";
  scene.title = name + " reaches for targets";
  scene.subtitle = std::to_string(tree.velocities()) + " joints, " + std::to_string(tips.size()) +
                   " tips; all go to their targets at once by inverse kinematics";
  scene.dt = 1.0 / 30;
  scene.triangles = shape.triangles;
  for (const int tip : tips) scene.feature_names.push_back(tree.links()[static_cast<std::size_t>(tip)].name);
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
      clothctl::robot::forward_kinematics<double>(tree, now, kinematics);
      place_hand(shape, kinematics, vertices);
      for (Index k = 0; k < count; ++k)
        actual.col(k) = clothctl::robot::link_pose(tree, kinematics, tips[static_cast<std::size_t>(k)]).p;
      recorder.add_frame(vertices, actual, wanted, none, none);
    }
    q = goal;
  }
  const auto add = [&](const char* text, const std::string& value) { recorder.scene().figures.emplace_back(text, value); };
  add("Targets shown, reached", std::to_string(tally.reached) + " of " + std::to_string(tally.solves));
  add("Largest error", millimetres(tally.error));
  for (const auto& [key, text] :
       {std::pair("reached_share", "Reached, random starts"), std::pair("reached_share_near", "Reached, near starts"),
        std::pair("microseconds_median", "Time, median, µs")}) {
    char number[32];
    if (!figures[key].is_number()) continue;
    std::snprintf(number, sizeof number, "%.4g", figures[key].get<double>());
    add(text, number);
  }
  must(recorder.write(o.out + "/reach.html"));
}

template <class Scalar>
int run(const Request& o) {
  const clothctl::robot::UrdfModel<Scalar> model = must(clothctl::robot::read_urdf<Scalar>(o.model));
  const Tree<Scalar>& tree = model.tree;
  if (tree.velocities() == 0) refuse(o.model + ": has no joint that moves");
  const std::vector<int> tips = find_tips(tree, o);
  if (!o.out.empty()) make_folder(o.out);
  OracleErrors errors;
  const bool compared = !o.oracle.empty();
  if (compared) errors = compare_with_oracle<Scalar>(tree, o.model, o.oracle);
  const Runs runs = run_targets(tree, tips, o);

  const bool right = !compared || errors.within(o.single ? 1e-4 : 1e-9);
  nlohmann::ordered_json j;
  j["status"] = right ? "ok" : "failed";
  j["fk_error"] = known(errors.fk, compared);
  j["jacobian_error"] = known(errors.jacobian, compared);
  j["mass_error"] = known(errors.mass, compared);
  j["bias_error"] = known(errors.bias, compared);
  add_tally(j, runs.random, "");
  j["gravity_error"] = known(errors.gravity, compared);
  j["rnea_error"] = known(errors.rnea, compared);
  j["fd_error"] = known(errors.fd, compared);
  j["spd_qdd_error"] = known(errors.spd_qdd, compared);
  j["spd_tau_error"] = known(errors.spd_tau, compared);
  j["samples"] = known(errors.samples, compared);
  add_more(j, runs.random, "");
  add_tally(j, runs.near, "_near");
  add_more(j, runs.near, "_near");
  const Tally& far = runs.unreachable;
  j["unreachable_local_minima"] = known(far.solves > 0 ? double(far.local_minimum) / far.solves : 0, far.solves > 0);
  j["targets"] = o.targets;
  j["seed"] = o.seed;
  j["scalar"] = o.single ? "float" : "double";
  j["model"] = model.name;
  j["dof"] = tree.velocities();
  j["tips"] = nlohmann::ordered_json::array();
  for (const int tip : tips) j["tips"].push_back(tree.links()[static_cast<std::size_t>(tip)].name);
  if (!o.out.empty()) {
    const auto shown = must(clothctl::robot::read_urdf<double>(o.model));
    write_page(shown.tree, shown.name, tips, o, j);
  }
  print_figures(j, o.json);
  return right ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  Request o;
  CLI::App app{
      "Compares a robot's kinematics and dynamics with an oracle, and puts its finger tips to random targets by inverse "
      "kinematics. Exit code 0: done, and all differences are small; 1: they are not; 2: bad input."};
  app.add_option("--model", o.model, "URDF file")->required();
  app.add_option("--oracle", o.oracle, "JSON file with what another library found")->check([](const std::string& text) {
    return text.empty() ? std::string("is empty") : std::string();
  });
  app.add_option("--targets", o.targets, "Number of random targets")->check(between(0, 1e6))->capture_default_str();
  app.add_option("--seed", o.seed, "Seed of targets and starts")
      ->check(
          [](const std::string& text) { return text.find('-') == std::string::npos ? std::string() : text + " is negative"; })
      ->capture_default_str();
  app.add_option("--tips", o.tips, "Links to put to targets, a,b,c (default: the end of each chain)")->delimiter(',');
  app.add_flag("--float", o.single, "Compute in single precision; differences may be 1e-4");
  app.add_option("--out", o.out, "Folder for reach.html (made if missing)")->check([](const std::string& text) {
    return text.empty() ? std::string("is empty") : std::string();
  });
  app.add_flag("--json", o.json, "Print the figures as one JSON object");
  parse(app, argc, argv);
  return o.single ? run<float>(o) : run<double>(o);
}
