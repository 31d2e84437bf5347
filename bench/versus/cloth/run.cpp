#include "run.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>

#include "../support/timing.hpp"

namespace versus {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// 0, 1, 2 … in even rounds, in reverse order in odd ones.
std::vector<std::size_t> turns(std::size_t count, int round) {
  std::vector<std::size_t> order(count);
  std::iota(order.begin(), order.end(), std::size_t(0));
  if (round % 2 == 1) std::reverse(order.begin(), order.end());
  return order;
}

/// The figures of one state.
struct Reading {
  double structural = 0, diagonal = 0, stretch = 0, squeeze = 0, speed = 0;
  /// Weight times height, and the same with the kinetic energy (J).
  double potential = 0, energy = 0;
  bool finite = true;
};

/// An engine in the middle of its run.
class Track {
 public:
  Track(const Sheet& sheet, const Lane& lane, const Setting& setting, int number,
        const RunSettings& settings)
      : sheet_(sheet), settings_(settings), engine_(lane.variant->make()) {
    result_.engine = lane.engine;
    result_.variant = lane.variant->name;
    result_.number = number;
    result_.setting = setting;
    result_.refusal = engine_->load(sheet, setting);
    positions_.resize(sheet.positions.size());
    velocities_.resize(sheet.positions.size());
    if (!result_.refusal.empty()) return;
    engine_->read(positions_.data(), velocities_.data());
    energies_.push_back(reading().energy);
  }

  bool done() const {
    return !result_.refusal.empty() || result_.apart ||
           frame_ >= settings_.frames + settings_.rest_frames;
  }

  /// Some frames.
  void turn() {
    for (int k = 0; k < settings_.turn && !done(); ++k) {
      const double start = thread_seconds();
      engine_->frame(settings_.dt);
      const double seconds = thread_seconds() - start;
      engine_->read(positions_.data(), velocities_.data());
      const Reading now = reading();
      if (frame_ < settings_.frames) {
        if (k > 0) times_.push_back(seconds);
        take(now);
      } else {
        take_rest(now);
        engine_->scale_velocities(settings_.rest_factor);
      }
      ++frame_;
    }
  }

  /// Frames without any reading, for the throughput. The first one is not timed.
  void turn_timed_only(int frames) {
    for (int k = 0; k < frames; ++k) {
      const double start = thread_seconds();
      engine_->frame(settings_.dt);
      const double seconds = thread_seconds() - start;
      if (k > 0) times_.push_back(seconds);
    }
  }

  RunResult finish() {
    RunResult& r = result_;
    r.frames = std::min(frame_, settings_.frames);
    r.median = quantile(times_, 0.5);
    r.p99 = quantile(times_, 0.99);
    r.solves = static_cast<double>(sheet_.edges.size()) * r.setting.sweeps_a_frame() / r.median;
    const double count = std::max(1, r.frames) * static_cast<double>(sheet_.edges.size());
    r.mean_stretch = stretch_ / count;
    r.mean_squeeze = squeeze_ / count;
    const double tail = std::max(1, settings_.rest_frames / 6);
    const double rest_energy = rest_energy_ / tail;
    r.rest_speed = std::sqrt(rest_square_speed_ / tail);
    const auto relative = [&](double energy) {
      return (energy - rest_energy) / (energies_.front() - rest_energy);
    };
    const bool rested =
        settings_.rest_frames > 0 && frame_ == settings_.frames + settings_.rest_frames;
    for (std::size_t k = 0; k < std::size(kEnergyFrames); ++k) {
      const std::size_t at = static_cast<std::size_t>(kEnergyFrames[k]);
      r.energy[k] = rested && at < energies_.size() ? relative(energies_[at]) : kNone;
    }
    r.most_energy =
        rested ? relative(*std::max_element(energies_.begin(), energies_.end())) : kNone;
    if (!rested) r.rest_speed = r.rest_stretch = kNone;
    return r;
  }

 private:
  Reading reading() const {
    Reading r;
    double sum = 0;
    for (std::size_t i = 0; i < sheet_.mass.size(); ++i) {
      const double* v = velocities_.data() + 3 * i;
      const double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
      r.potential += sheet_.mass[i] * kGravity * positions_[3 * i + 2];
      r.energy += 0.5 * sheet_.mass[i] * square;
      r.speed += square;
      sum += positions_[3 * i] + positions_[3 * i + 1];
    }
    r.energy += r.potential;
    r.speed = std::sqrt(r.speed / static_cast<double>(sheet_.mass.size()));
    r.finite = std::isfinite(sum) && std::isfinite(r.energy);
    for (const Edge& e : sheet_.edges) {
      const double* a = positions_.data() + 3 * e.a;
      const double* b = positions_.data() + 3 * e.b;
      const double x = b[0] - a[0], y = b[1] - a[1], z = b[2] - a[2];
      const double strain = std::sqrt(x * x + y * y + z * z) / static_cast<double>(e.length) - 1;
      double& worst = e.diagonal ? r.diagonal : r.structural;
      worst = std::max(worst, strain);
      r.stretch += std::max(strain, 0.0);
      r.squeeze += std::max(-strain, 0.0);
    }
    return r;
  }

  void take(const Reading& now) {
    RunResult& r = result_;
    r.structural = std::max(r.structural, now.structural);
    r.diagonal = std::max(r.diagonal, now.diagonal);
    stretch_ += now.stretch;
    squeeze_ += now.squeeze;
    energies_.push_back(now.energy);
    if (!now.finite) ++r.nonfinite;
    r.apart = !now.finite || r.worst() > kApart;
    if (r.apart) r.structural = r.diagonal = std::numeric_limits<double>::infinity();
  }

  /// The last sixth of the damped frames counts.
  void take_rest(const Reading& now) {
    if (!now.finite) ++result_.nonfinite;
    result_.apart = !now.finite;
    const int left = settings_.frames + settings_.rest_frames - frame_;
    if (left > settings_.rest_frames / 6) return;
    rest_energy_ += now.potential;
    rest_square_speed_ += now.speed * now.speed;
    result_.rest_stretch = std::max(result_.rest_stretch, std::max(now.structural, now.diagonal));
  }

  const Sheet& sheet_;
  RunSettings settings_;
  std::unique_ptr<Engine> engine_;
  RunResult result_;
  int frame_ = 0;
  double stretch_ = 0, squeeze_ = 0, rest_energy_ = 0, rest_square_speed_ = 0;
  std::vector<double> positions_, velocities_, times_, energies_;
};

/// The numbers of a lane that were run and that remain.
struct Ladder {
  std::vector<RunResult> runs;
  bool doubling = true;
  int refined = 0;

  const RunResult* find(int number) const {
    for (const RunResult& r : runs) {
      if (r.number == number) return &r;
    }
    return nullptr;
  }

  void add(const RunResult& run) {
    const auto later = std::find_if(runs.begin(), runs.end(),
                                    [&](const RunResult& r) { return r.number > run.number; });
    runs.insert(later, run);
  }

  /// The next number, or 0.
  int next(const RunSettings& settings, int start) {
    if (runs.empty()) return start;
    if (!runs.front().refusal.empty()) return 0;
    if (doubling) {
      const RunResult& last = runs.back();
      const double room = settings.limit / last.median;
      if (last.worst() > settings.targets.back() && room > 1.05)
        return std::max(last.number + 1, static_cast<int>(last.number * std::min(2.0, room)));
      doubling = false;
    }
    while (refined < settings.refinements * static_cast<int>(settings.targets.size())) {
      const double target =
          settings.targets[static_cast<std::size_t>(refined / settings.refinements)];
      ++refined;
      const auto hit = std::find_if(runs.begin(), runs.end(),
                                    [&](const RunResult& r) { return r.worst() <= target; });
      if (hit == runs.begin() || hit == runs.end()) continue;
      const double middle = std::sqrt(static_cast<double>((hit - 1)->number) * hit->number);
      const int number = static_cast<int>(std::lround(middle));
      if (find(number) == nullptr) return number;
    }
    return 0;
  }
};

/// Says on standard error what runs now.
void note(const std::vector<Lane>& lanes, const std::vector<int>& numbers, const Sheet& sheet) {
  std::fprintf(stderr, "%s %d:", sheet.mesh.c_str(), sheet.side);
  for (std::size_t k = 0; k < lanes.size(); ++k)
    std::fprintf(stderr, " %s %s %d", lanes[k].engine.c_str(), lanes[k].variant->name.c_str(),
                 numbers[k]);
  std::fprintf(stderr, "\n");
}

/// Times the cheapest runs that reach the targets once more, all of them in turns: the load of the
/// machine changes while the numbers grow.
void time_again(const std::vector<Lane>& lanes, const Sheet& sheet, const RunSettings& settings,
                std::vector<std::vector<RunResult>>& curves) {
  std::vector<Lane> some;
  std::vector<int> numbers;
  std::vector<RunResult*> runs;
  for (std::size_t k = 0; k < curves.size(); ++k) {
    for (const double target : settings.targets) {
      const RunResult* const best = cheapest(curves[k], target);
      if (best == nullptr) continue;
      RunResult* const run = &curves[k][static_cast<std::size_t>(best - curves[k].data())];
      if (std::find(runs.begin(), runs.end(), run) != runs.end()) continue;
      some.push_back(lanes[k]);
      numbers.push_back(run->number);
      runs.push_back(run);
    }
  }
  if (runs.empty()) return;
  RunSettings timed = settings;
  timed.rest_frames = 0;
  note(some, numbers, sheet);
  const std::vector<RunResult> again = run_together(some, numbers, sheet, timed);
  for (std::size_t i = 0; i < runs.size(); ++i) {
    runs[i]->median = again[i].median;
    runs[i]->p99 = again[i].p99;
    runs[i]->solves = again[i].solves;
  }
}

}  // namespace

std::vector<Lane> lanes_of(const std::vector<Entry>& entries) {
  std::vector<Lane> lanes;
  for (const Entry& entry : entries) {
    for (const Variant& variant : entry.variants) lanes.push_back({entry.name, &variant});
  }
  return lanes;
}

std::vector<RunResult> run_together(const std::vector<Lane>& lanes, const std::vector<int>& numbers,
                                    const Sheet& sheet, const RunSettings& settings) {
  std::vector<Track> tracks;
  for (std::size_t k = 0; k < lanes.size(); ++k)
    tracks.emplace_back(sheet, lanes[k], lanes[k].variant->setting(numbers[k]), numbers[k],
                        settings);
  const auto done = [](const Track& track) { return track.done(); };
  for (int round = 0; !std::all_of(tracks.begin(), tracks.end(), done); ++round) {
    for (const std::size_t k : turns(tracks.size(), round)) tracks[k].turn();
  }
  std::vector<RunResult> results;
  for (Track& track : tracks) results.push_back(track.finish());
  return results;
}

std::vector<std::vector<RunResult>> run_curves(const std::vector<Lane>& lanes, const Sheet& sheet,
                                               const RunSettings& settings) {
  std::vector<Ladder> ladders(lanes.size());
  for (;;) {
    std::vector<std::size_t> who;
    std::vector<Lane> some;
    std::vector<int> numbers;
    for (std::size_t k = 0; k < lanes.size(); ++k) {
      const int number = ladders[k].next(settings, lanes[k].variant->start);
      if (number == 0) continue;
      who.push_back(k);
      some.push_back(lanes[k]);
      numbers.push_back(number);
    }
    if (who.empty()) break;
    note(some, numbers, sheet);
    const std::vector<RunResult> results = run_together(some, numbers, sheet, settings);
    for (std::size_t i = 0; i < who.size(); ++i) ladders[who[i]].add(results[i]);
  }
  std::vector<std::vector<RunResult>> curves;
  for (Ladder& ladder : ladders) curves.push_back(std::move(ladder.runs));
  time_again(lanes, sheet, settings, curves);
  return curves;
}

const RunResult* cheapest(const std::vector<RunResult>& runs, double target) {
  for (const RunResult& r : runs) {
    if (r.refusal.empty() && r.worst() <= target) return &r;
  }
  return nullptr;
}

std::vector<RunResult> run_throughput(const std::vector<Lane>& lanes, const Sheet& sheet,
                                      const RunSettings& settings, int frames) {
  std::vector<Track> tracks;
  for (const Lane& lane : lanes) {
    if (lane.variant->throughput.substeps > 0)
      tracks.emplace_back(sheet, lane, lane.variant->throughput, 0, settings);
  }
  constexpr int kTurn = 6;
  for (int round = 0; round * kTurn < frames; ++round) {
    for (const std::size_t k : turns(tracks.size(), round)) tracks[k].turn_timed_only(kTurn);
  }
  std::vector<RunResult> results;
  for (Track& track : tracks) results.push_back(track.finish());
  return results;
}

}  // namespace versus
