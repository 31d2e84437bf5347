#include "run.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <limits>
#include <numeric>

#include "../support/timing.hpp"
#include "clothctl/io/qpt.hpp"

namespace versus {

namespace {

Vectors vectors(const clothctl::QpSequenceFrame& frame) {
  return {frame.g, frame.lb, frame.ub, frame.rl, frame.ru};
}

/// 0, 1, 2 … in even rounds, in reverse order in odd ones.
std::vector<std::size_t> turns(std::size_t count, int round) {
  std::vector<std::size_t> order(count);
  std::iota(order.begin(), order.end(), std::size_t(0));
  if (round % 2 == 1) std::reverse(order.begin(), order.end());
  return order;
}

/// Solves. A solver that throws counts as stopped.
Verdict attempt(Solver& solver, const Vectors& v, Start start) {
  try {
    return solver.solve(v, start);
  } catch (const std::exception&) {
    return Verdict::Stopped;
  }
}

/// A cold solve with its set-up. An answer after the time limit does not count.
Verdict cold(const Entry& entry, const Problem& problem, double limit, Answer& answer,
             double& seconds) {
  const std::unique_ptr<Solver> solver = entry.make(limit);
  seconds = 0;
  if (!solver->prepare(problem)) return Verdict::Unsupported;
  const double start = thread_seconds();
  solver->setup();
  const Verdict verdict = attempt(*solver, problem.first, Start::Single);
  seconds = thread_seconds() - start;
  if (verdict == Verdict::Solved || verdict == Verdict::Inaccurate) solver->read(answer);
  return seconds > limit ? Verdict::Stopped : verdict;
}

/// One solver's pass through a sequence, kept alive during the turns of the others.
struct Lane {
  const Entry* entry;
  Start start;
  std::unique_ptr<Solver> solver;
  double spent = 0;
  bool gave_up = false;
};

}  // namespace

clothctl::QpProblem load(const std::string& file) {
  clothctl::Result<clothctl::QpProblem> problem = clothctl::read_qpt(file);
  if (!problem) {
    std::fprintf(stderr, "%s\n", problem.error().c_str());
    std::exit(2);
  }
  return std::move(problem).value();
}

int SetResult::right() const {
  return static_cast<int>(std::count_if(problems.begin(), problems.end(),
                                        [](const SingleResult& r) { return r.judgement.right; }));
}

int SetResult::absolute() const {
  return static_cast<int>(
      std::count_if(problems.begin(), problems.end(),
                    [](const SingleResult& r) { return r.judgement.absolute; }));
}

int SetResult::false_statuses() const {
  return static_cast<int>(
      std::count_if(problems.begin(), problems.end(),
                    [](const SingleResult& r) { return r.judgement.false_status; }));
}

double SetResult::mean(bool right_only) const {
  double sum = 0;
  int count = 0;
  for (const SingleResult& r : problems) {
    if (right_only && !r.judgement.right) continue;
    sum += std::log((r.judgement.right ? r.seconds : kFailure) + kShift);
    ++count;
  }
  return count == 0 ? std::numeric_limits<double>::quiet_NaN() : std::exp(sum / count) - kShift;
}

double SetResult::slowest() const {
  double most = 0;
  for (const SingleResult& r : problems)
    most = r.judgement.right ? std::max(most, r.seconds) : most;
  return most;
}

double LaneResult::cold_median() const { return quantile(cold, 0.5); }
double LaneResult::warm_median() const { return quantile(warm, 0.5); }
double LaneResult::warm_p99() const { return quantile(warm, 0.99); }

std::vector<SetResult> run_set(const std::vector<Entry>& entries,
                               const std::vector<std::string>& files, const RunSettings& settings) {
  std::vector<SetResult> results(entries.size());
  for (std::size_t e = 0; e < entries.size(); ++e) results[e].solver = entries[e].name;
  for (const std::string& file : files) {
    const clothctl::QpProblem program = load(file);
    const Problem problem{program.H, program.A, vectors(program)};
    std::vector<SingleResult> row(entries.size());
    for (int pass = 0; pass < settings.passes; ++pass) {
      for (const std::size_t e : turns(entries.size(), pass)) {
        SingleResult& r = row[e];
        if (pass > 0 && (r.verdict == Verdict::Unsupported || r.seconds > 0.2)) continue;
        Answer answer;
        double seconds = 0;
        const Verdict verdict = cold(entries[e], problem, settings.time_limit, answer, seconds);
        if (pass == 0) {
          r = {program.name, verdict, judge(program, program, verdict, answer), seconds};
        } else {
          r.seconds = std::min(r.seconds, seconds);
        }
      }
    }
    for (std::size_t e = 0; e < entries.size(); ++e) results[e].problems.push_back(row[e]);
  }
  return results;
}

std::vector<LaneResult> run_sequence(const std::vector<Entry>& entries,
                                     const clothctl::QpProblem& sequence,
                                     const RunSettings& settings) {
  const Index frames = static_cast<Index>(sequence.frames.size());
  const auto frame = [&](Index t) -> const clothctl::QpSequenceFrame& {
    return sequence.frames[static_cast<std::size_t>(t)];
  };
  Problem problem{sequence.H, sequence.A, vectors(frame(0)), sequence.shift, sequence.row_shift()};
  std::vector<LaneResult> results;
  std::vector<const Entry*> owners;
  for (const Entry& entry : entries) {
    for (const Start start : entry.warm) {
      results.push_back({});
      results.back().solver = entry.name;
      results.back().start = start;
      owners.push_back(&entry);
    }
  }

  // Passes with warm starts.
  const double none = std::numeric_limits<double>::infinity();
  std::vector<std::vector<double>> least(
      results.size(), std::vector<double>(static_cast<std::size_t>(frames), none));
  std::vector<Vectors> data;
  for (Index t = 0; t < frames; ++t) data.push_back(vectors(frame(t)));
  std::vector<bool> slow(results.size(), false);
  for (int pass = 0; pass < settings.passes; ++pass) {
    std::vector<Lane> lanes;
    for (std::size_t k = 0; k < results.size(); ++k) {
      lanes.push_back({owners[k], results[k].start, nullptr});
      lanes[k].gave_up = slow[k];
      if (slow[k]) continue;
      lanes[k].solver = owners[k]->make(settings.time_limit);
      lanes[k].gave_up = !lanes[k].solver->prepare(problem);
    }
    const Index block = settings.block > 0 ? settings.block : frames;
    for (Index from = 0; from < frames; from += block) {
      for (const std::size_t k : turns(lanes.size(), pass + static_cast<int>(from / block))) {
        Lane& lane = lanes[k];
        LaneResult& result = results[k];
        for (Index t = from; t < std::min(from + block, frames) && !lane.gave_up; ++t) {
          const Vectors& v = data[static_cast<std::size_t>(t)];
          const double start = thread_seconds();
          if (t == 0) lane.solver->setup();
          const Verdict verdict = attempt(*lane.solver, v, t == 0 ? Start::First : lane.start);
          const double seconds = thread_seconds() - start;
          least[k][static_cast<std::size_t>(t)] =
              std::min(least[k][static_cast<std::size_t>(t)], seconds);
          lane.spent += seconds;
          if (pass == 0) {
            Answer answer;
            if (verdict == Verdict::Solved) lane.solver->read(answer);
            const Judgement j = judge(sequence, frame(t), verdict, answer);
            const bool right = j.absolute || (j.right && frame(t).reference.status != "optimal");
            ++result.frames;
            result.right += right ? 1 : 0;
            if (!right && result.first_miss.empty()) {
              char text[96];
              std::snprintf(text, sizeof text,
                            "frame %ld %s, relative %.1e, stationarity %.1e, violation %.1e",
                            static_cast<long>(t), std::string(to_string(verdict)).c_str(),
                            j.residuals.worst(), j.residuals.stationarity, j.residuals.feasibility);
              result.first_miss = text;
            }
            result.false_statuses += j.false_status ? 1 : 0;
            result.finished = t + 1 == frames;
          }
          lane.gave_up = lane.spent > settings.time_limit;
          slow[k] = lane.gave_up;
        }
      }
    }
  }
  for (std::size_t k = 0; k < results.size(); ++k) {
    for (Index t = 1; t < frames; ++t) {
      const double seconds = least[k][static_cast<std::size_t>(t)];
      if (seconds < none) results[k].warm.push_back(seconds);
    }
  }

  // Cold solves of every sixth frame.
  std::vector<std::vector<double>> cold_times(entries.size());
  std::vector<double> spent(entries.size(), 0);
  int round = 0;
  for (Index t = 0; t < frames; t += 6) {
    problem.first = data[static_cast<std::size_t>(t)];
    for (const std::size_t e : turns(entries.size(), round++)) {
      if (spent[e] > settings.time_limit) continue;
      Answer answer;
      double seconds = 0;
      if (cold(entries[e], problem, settings.time_limit, answer, seconds) == Verdict::Unsupported)
        continue;
      cold_times[e].push_back(seconds);
      spent[e] += seconds;
    }
  }
  for (std::size_t k = 0; k < results.size(); ++k) {
    results[k].cold = cold_times[static_cast<std::size_t>(owners[k] - entries.data())];
  }
  return results;
}

}  // namespace versus
