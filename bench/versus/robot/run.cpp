#include "run.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <random>

#include "../support/timing.hpp"

namespace versus {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double median(std::vector<double> values) {
  if (values.empty()) return kNone;
  const std::size_t middle = (values.size() - 1) / 2;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(middle),
                   values.end());
  return values[middle];
}

/// 0, 1, 2 … in even rounds, in reverse order in odd ones.
std::vector<std::size_t> turns(std::size_t count, int round) {
  std::vector<std::size_t> order(count);
  std::iota(order.begin(), order.end(), std::size_t(0));
  if (round % 2 == 1) std::reverse(order.begin(), order.end());
  return order;
}

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double uniform() { return uniform_(engine_); }
  double normal() { return normal_(engine_); }

 private:
  std::mt19937_64 engine_;
  std::uniform_real_distribution<double> uniform_{0.0, 1.0};
  std::normal_distribution<double> normal_{0.0, 1.0};
};

/// Draws positions within the limits.
std::vector<double> anywhere(const Model& model, Random& random) {
  std::vector<double> q(model.joints.size());
  for (std::size_t i = 0; i < q.size(); ++i)
    q[i] = model.lower[i] + random.uniform() * (model.upper[i] - model.lower[i]);
  return q;
}

std::vector<Sample> draw_samples(const Model& model, const RunSettings& settings) {
  Random random(settings.seed);
  std::vector<Sample> samples(static_cast<std::size_t>(settings.samples));
  for (Sample& s : samples) {
    s.q = anywhere(model, random);
    for (std::vector<double>* v : {&s.qd, &s.qdd, &s.torques}) {
      v->resize(s.q.size());
      for (double& x : *v) x = random.normal();
    }
    s.diagonal.assign(s.q.size(), settings.diagonal);
  }
  return samples;
}

std::size_t size_of(Task task, const Model& model) {
  const std::size_t n = model.joints.size();
  switch (task) {
    case Task::Poses: return 12 * model.links.size();
    case Task::Jacobian: return 6 * n;
    case Task::MassMatrix: return n * n;
    default: return n;
  }
}

/// Returns the answers to all samples in one list.
std::vector<double> answers(Peer& peer, const Model& model, Task task,
                            const std::vector<Sample>& samples) {
  const std::size_t size = size_of(task, model);
  std::vector<double> all(size * samples.size());
  peer.prepare(task, samples);
  for (std::size_t k = 0; k < samples.size(); ++k) {
    peer.run(task, static_cast<int>(k));
    peer.read(task, all.data() + size * k);
  }
  return all;
}

/// Returns the largest difference in a sample divided by the sample's largest entry, or infinity if
/// an answer is not finite.
double difference(const std::vector<double>& own, const std::vector<double>& other,
                  std::size_t size) {
  double worst = 0;
  for (std::size_t from = 0; from < own.size(); from += size) {
    double most = 0, scale = 0;
    for (std::size_t i = from; i < from + size; ++i) {
      const double d = std::abs(own[i] - other[i]);
      most = std::isfinite(d) ? std::max(most, d) : std::numeric_limits<double>::infinity();
      scale = std::max(scale, std::abs(own[i]));
    }
    worst = std::max(worst, most / scale);
  }
  return worst;
}

/// Returns the positions of the tips by our kinematics.
std::vector<double> tip_places(Peer& ours, const Model& model, const std::vector<double>& q) {
  Sample sample;
  sample.q = sample.qd = sample.qdd = sample.torques = sample.diagonal = q;
  const std::vector<double> poses = answers(ours, model, Task::Poses, {sample});
  std::vector<double> places;
  for (const int tip : model.tips) {
    const double* p = poses.data() + 12 * tip + 9;
    places.insert(places.end(), p, p + 3);
  }
  return places;
}

bool is_reached(Peer& ours, const Model& model, const Reach& reach, const std::vector<double>& q) {
  for (std::size_t i = 0; i < q.size(); ++i) {
    if (!(q[i] >= model.lower[i] - 1e-9) || !(q[i] <= model.upper[i] + 1e-9)) return false;
  }
  const std::vector<double> places = tip_places(ours, model, q);
  for (std::size_t k = 0; k < places.size(); k += 3) {
    const double d = std::hypot(places[k] - reach.targets[k], places[k + 1] - reach.targets[k + 1],
                                places[k + 2] - reach.targets[k + 2]);
    if (!(d <= kReachTolerance * (1 + 1e-6))) return false;
  }
  return true;
}

Reach draw_reach(Peer& ours, const Model& model, bool near, int restarts, Random& random) {
  Reach reach;
  const std::vector<double> goal = anywhere(model, random);
  reach.targets = tip_places(ours, model, goal);
  reach.start = anywhere(model, random);
  if (!near) {
    for (std::size_t k = 0; k < static_cast<std::size_t>(restarts) * goal.size(); ++k) {
      reach.uniforms.push_back(random.uniform());
    }
    return reach;
  }
  for (std::size_t i = 0; i < goal.size(); ++i) {
    const double range = model.upper[i] - model.lower[i];
    const double moved = goal[i] + 0.1 * (2 * (reach.start[i] - model.lower[i]) - range);
    reach.start[i] = std::clamp(moved, model.lower[i], model.upper[i]);
  }
  return reach;
}

}  // namespace

int ReachResult::reached_count() const {
  return static_cast<int>(std::count(reached.begin(), reached.end(), true));
}
double ReachResult::median() const { return versus::median(seconds); }
double ReachResult::median_with(const ReachResult& other) const {
  std::vector<double> both;
  for (std::size_t k = 0; k < seconds.size(); ++k) {
    if (reached[k] && other.reached[k]) both.push_back(seconds[k]);
  }
  return versus::median(both);
}

std::vector<Runner> load(const std::vector<Entry>& entries, const Model& model) {
  std::vector<Runner> runners;
  for (const Entry& entry : entries) {
    runners.push_back({entry.name, std::unique_ptr<Peer>(entry.make()), ""});
    runners.back().refusal = runners.back().peer->load(model);
  }
  return runners;
}

std::vector<std::vector<TaskResult>> run_tasks(std::vector<Runner>& runners, const Model& model,
                                               const RunSettings& settings) {
  struct Lane {
    std::size_t task, runner;
    int repeats = 1;
    std::vector<double> times;
  };
  const std::vector<Sample> samples = draw_samples(model, settings);
  std::vector<std::vector<TaskResult>> results(std::size(kTasks),
                                               std::vector<TaskResult>(runners.size()));
  std::vector<Lane> lanes;
  const auto turn = [&](const Lane& lane) {
    Peer& peer = *runners[lane.runner].peer;
    const Task task = kTasks[lane.task];
    peer.prepare(task, samples);
    peer.run(task, 0);
    const double start = thread_seconds();
    for (int repeat = 0; repeat < lane.repeats; ++repeat) {
      for (int k = 0; k < settings.samples; ++k) peer.run(task, k);
    }
    return thread_seconds() - start;
  };
  for (std::size_t t = 0; t < std::size(kTasks); ++t) {
    std::vector<double> own;
    for (std::size_t r = 0; r < runners.size(); ++r) {
      TaskResult& result = results[t][r];
      result.seconds = result.difference = kNone;
      result.offered = runners[r].refusal.empty() && runners[r].peer->offers(kTasks[t]);
      if (!result.offered) continue;
      const std::vector<double> answer = answers(*runners[r].peer, model, kTasks[t], samples);
      if (r == 0) own = answer;
      result.difference = difference(own, answer, size_of(kTasks[t], model));
      if (!result.agrees()) continue;
      lanes.push_back({t, r, 1, {}});
      while (turn(lanes.back()) < settings.turn) lanes.back().repeats *= 2;
    }
  }
  for (int round = 0; round < settings.rounds; ++round) {
    for (const std::size_t k : turns(lanes.size(), round)) {
      Lane& lane = lanes[k];
      lane.times.push_back(turn(lane) / (static_cast<double>(lane.repeats) * settings.samples));
    }
  }
  for (const Lane& lane : lanes) results[lane.task][lane.runner].seconds = median(lane.times);
  return results;
}

std::vector<ReachResult> run_reach(std::vector<Runner>& runners, const Model& model, bool near,
                                   const RunSettings& settings) {
  Random random(settings.seed);
  std::vector<ReachResult> results(runners.size());
  for (std::size_t r = 0; r < runners.size(); ++r) {
    results[r].offered = runners[r].refusal.empty() && runners[r].peer->reaches();
  }
  Peer& ours = *runners[0].peer;
  std::vector<double> q(model.joints.size());
  for (int target = 0; target < settings.targets; ++target) {
    const Reach reach = draw_reach(ours, model, near, settings.restarts, random);
    std::vector<std::vector<double>> times(runners.size());
    for (int pass = 0; pass < settings.passes; ++pass) {
      for (const std::size_t r : turns(runners.size(), target + pass)) {
        if (!results[r].offered || (pass > 0 && times[r].front() > 0.1)) continue;
        Peer& peer = *runners[r].peer;
        peer.prepare(reach);
        const double start = thread_seconds();
        const bool claimed = peer.reach();
        times[r].push_back(thread_seconds() - start);
        if (pass > 0) continue;
        peer.read(q.data());
        const bool reached = is_reached(ours, model, reach, q);
        results[r].reached.push_back(reached);
        results[r].false_claims += claimed && !reached ? 1 : 0;
      }
    }
    for (std::size_t r = 0; r < runners.size(); ++r) {
      if (results[r].offered) results[r].seconds.push_back(median(times[r]));
    }
  }
  return results;
}

}  // namespace versus
