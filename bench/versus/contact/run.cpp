// Steps the engines, and measures after each frame.

#include "run.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "../support/timing.hpp"
#include "judge.hpp"

namespace versus {

namespace {

void raise(double& most, double value) { most = std::max(most, value); }

/// Figures of motion over the last seconds, from the places of all vertices in them.
class Rest {
 public:
  Rest(const Scene& scene, double gap) : scene_(scene), gap_(gap) {}

  void take(const std::vector<double>& positions) { places_.push_back(positions); }

  void report(double dt, RunResult& r) const {
    if (places_.size() < 2) return;
    const double seconds = dt * static_cast<double>(places_.size() - 1);
    double creep = 0, tremble = 0;
    for (int v = 0; v < scene_.n(); ++v) {
      if (!touches(places_.front(), v) || !touches(places_.back(), v)) continue;
      ++r.touching;
      const double speed = way(places_.front(), places_.back(), v) / seconds;
      creep += speed * speed;
      raise(r.most_creep, speed);
      for (std::size_t k = 1; k < places_.size(); ++k) {
        const double step = way(places_[k - 1], places_[k], v) / dt;
        tremble += step * step / static_cast<double>(places_.size() - 1);
      }
    }
    const double count = std::max(1, r.touching);
    r.creep = std::sqrt(creep / count);
    r.tremble = std::sqrt(tremble / count);
  }

 private:
  bool touches(const std::vector<double>& at, int v) const {
    return distance(scene_.obstacle, at.data() + 3 * v) < gap_ + kTouch;
  }

  static double way(const std::vector<double>& a, const std::vector<double>& b, int v) {
    const double* p = a.data() + 3 * v;
    const double* q = b.data() + 3 * v;
    return std::hypot(q[0] - p[0], q[1] - p[1], q[2] - p[2]);
  }

  const Scene& scene_;
  double gap_;
  std::vector<std::vector<double>> places_;
};

/// The times of a run.
struct Times {
  double median = 0, p99 = 0, most = 0, sum = 0;
};

Times times_of(const std::vector<double>& seconds) {
  Times t{quantile(seconds, 0.5), quantile(seconds, 0.99), quantile(seconds, 1), 0};
  for (const double s : seconds) t.sum += s;
  return t;
}

/// One setting, with its figures and the times of its runs.
class Lane {
 public:
  Lane(const Entry& entry, const Variant& variant, const Scene& scene, const RunSettings& settings)
      : variant_(variant), scene_(scene), settings_(settings) {
    result_.engine = entry.name;
    result_.variant = variant.name;
    result_.gap = variant.gap;
  }

  /// A whole run. The first one is measured.
  void run() {
    if (!result_.refusal.empty() || !result_.finite) return;
    const bool measured = times_.empty();
    const std::unique_ptr<Engine> engine = variant_.make();
    result_.refusal = engine->load(scene_);
    if (!result_.refusal.empty()) return;
    std::vector<double> seconds, positions(scene_.positions.size());
    Rest rest(scene_, variant_.gap);
    const int resting = settings_.frames - static_cast<int>(kRestSeconds / settings_.dt + 0.5);
    for (int i = 0; i < settings_.frames && result_.finite; ++i) {
      const double start = thread_seconds();
      engine->frame(settings_.dt);
      if (i > 0) seconds.push_back(thread_seconds() - start);
      if (!measured) continue;
      engine->read(positions.data());
      measure(positions, i, i >= resting);
      if (i >= resting) rest.take(positions);
    }
    times_.push_back(times_of(seconds));
    if (!measured || !result_.finite) return;
    if (result_.off < 0) rest.report(settings_.dt, result_);
    result_.crossings = crossings(scene_, positions);
    const std::size_t middle = 3 * static_cast<std::size_t>(scene_.n() / 2);
    result_.drift = std::hypot(positions[middle] - scene_.positions[middle],
                               positions[middle + 1] - scene_.positions[middle + 1]);
  }

  RunResult finish() {
    const auto over_runs = [&](double Times::*member) {
      std::vector<double> values;
      for (const Times& t : times_) values.push_back(t.*member);
      return quantile(values, 0.5);
    };
    result_.median = over_runs(&Times::median);
    result_.p99 = over_runs(&Times::p99);
    result_.most = over_runs(&Times::most);
    result_.real_time = settings_.dt * (settings_.frames - 1) / over_runs(&Times::sum);
    return result_;
  }

 private:
  void measure(const std::vector<double>& positions, int frame, bool resting) {
    RunResult& r = result_;
    if (!std::all_of(positions.begin(), positions.end(), [](double x) { return std::isfinite(x); }))
      r.finite = false;
    if (!r.finite) return;
    const Clearance now = clearance(scene_, positions);
    const double length = stretch(scene_, positions);
    raise(r.depth_vertices, -now.vertices);
    raise(r.depth_points, -now.points);
    raise(r.below_gap, variant_.gap - now.vertices);
    raise(r.stretch, length);
    touched_ = touched_ || now.vertices < variant_.gap + kTouch;
    if (r.off < 0 && touched_ && now.points > kOff) r.off = settings_.dt * (frame + 1);
    if (!resting) return;
    raise(r.rest_depth_vertices, -now.vertices);
    raise(r.rest_depth_points, -now.points);
    raise(r.rest_below_gap, variant_.gap - now.vertices);
    raise(r.rest_stretch, length);
  }

  Variant variant_;
  const Scene& scene_;
  RunSettings settings_;
  RunResult result_;
  bool touched_ = false;
  std::vector<Times> times_;
};

bool takes_part(const Variant& v, const std::vector<std::string>& chosen, bool self) {
  if (v.use == Use::OnlySelf && !self) return false;
  if (chosen.empty()) return !v.extra;
  return std::find(chosen.begin(), chosen.end(), v.name) != chosen.end();
}

}  // namespace

std::vector<RunResult> run_all(const std::vector<Entry>& entries,
                               const std::vector<std::string>& variants, const Scene& scene,
                               const RunSettings& settings) {
  std::vector<Lane> lanes;
  for (const Entry& entry : entries) {
    for (const Variant& v : entry.variants) {
      if (takes_part(v, variants, scene.self)) lanes.emplace_back(entry, v, scene, settings);
    }
  }
  for (int repeat = 0; repeat < settings.repeats; ++repeat) {
    std::fprintf(stderr, "%d x %d, run %d of %d\n", scene.side, scene.side, repeat + 1,
                 settings.repeats);
    for (std::size_t k = 0; k < lanes.size(); ++k)
      lanes[repeat % 2 == 0 ? k : lanes.size() - 1 - k].run();
  }
  std::vector<RunResult> results;
  for (Lane& lane : lanes) results.push_back(lane.finish());
  return results;
}

}  // namespace versus
