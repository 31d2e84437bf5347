#include "clothctl/cloth/detail/limited_sweeps.hpp"

#include <algorithm>
#include <string>
#include <vector>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

/// A sheet of one vertex that records what is done to it. Each sweep moves the vertex by 1 m and
/// reports the next of `worst`.
struct RecordingSheet {
  static constexpr int kLanes = 1;
  static constexpr std::size_t kStride = 1;
  using Pack = Simd<double, 1>;
  struct Scratch {
    VectorX<double> points = VectorX<double>::Zero(4), start = VectorX<double>::Zero(4);
    std::string calls;
    std::vector<double> worst;
    std::size_t sweeps = 0;
    double slack = -1;          // of the last sweep for the limit alone
    std::vector<double> omega;  // of the sweeps for the limit alone
    double still = -1;
  };
  int vertex_count() const { return 1; }
  std::size_t offset(int) const { return 0; }
  void correct_levels(int, int, double, const PassiveFrame<double>&, Scratch& memory) const {
    memory.calls += 'L';
  }
  void sweep_unlimited(Scratch& memory) const { memory.calls += 'u'; }
  template <bool, bool>
  void bend(SweepOrder order, Scratch& memory) const {
    memory.calls += order == SweepOrder::Forward ? 'b' : '<';
  }
  LimitRule<double, 1> sweep(LimitRule<double, 1> rule, SweepOrder order, Scratch& memory) const {
    memory.calls += order == SweepOrder::Forward ? 's' : '<';
    return swept(rule, memory);
  }
  TensionRule<double, 1> sweep(TensionRule<double, 1> rule, SweepOrder order,
                               Scratch& memory) const {
    memory.calls += order == SweepOrder::Forward ? 't' : '<';
    memory.slack = rule.slack.largest();
    memory.omega.push_back(rule.omega.largest());
    return swept(rule, memory);
  }
  template <class Rule>
  static Rule swept(Rule rule, Scratch& memory) {
    memory.points[0] += 1.0;
    rule.worst = Pack::all(memory.worst.at(memory.sweeps++));
    return rule;
  }
};

StepReport<double> sweep(RecordingSheet::Scratch& memory, int part,
                         const PositionBasedSettings<double>& settings) {
  StepReport<double> report;
  report.status = StepStatus::Converged;
  correct_on_levels(RecordingSheet{}, memory, settings, part, true, {});
  memory.still = sweep_within_limit(
      RecordingSheet{}, memory, settings, part,
      [&](SweepOrder order) { memory.calls += order == SweepOrder::Forward ? 'e' : '<'; },
      [&] { memory.calls += 'a'; }, [&](double) { memory.calls += 'l'; }, report);
  return report;
}

PositionBasedSettings<double> limit_of_five_percent() {
  PositionBasedSettings<double> settings;
  settings.stretch_limit = 0.05;
  settings.substeps = 4;
  settings.iterations = 2;
  settings.extra_sweeps = 3;
  return settings;
}

double as_part(double stretch) { return stretch / (1.0 + stretch); }

}  // namespace

TEST_CASE("limited sweeps: levels, then bends, then the springs last", "[limited_sweeps]") {
  RecordingSheet::Scratch memory;
  memory.worst = {0.2, 0.1};
  const auto report = sweep(memory, 1, limit_of_five_percent());
  CHECK(memory.calls == "Lubeaseas");
  CHECK(report.iterations == 2);
  CHECK(report.residual == 0.0);
  CHECK(report.status == StepStatus::Converged);
  CHECK(memory.start[0] == 0.0);
}

TEST_CASE("limited sweeps: the last substep sweeps until the limit is kept with room",
          "[limited_sweeps]") {
  RecordingSheet::Scratch memory;
  memory.worst = {0.2, 0.1, as_part(0.0451), as_part(0.0449)};
  const auto report = sweep(memory, 4, limit_of_five_percent());
  CHECK(memory.calls == "Lubeaseasltlt");
  CHECK(report.iterations == 4);
  CHECK(report.residual == Approx(0.0449));
  CHECK(report.status == StepStatus::Converged);
  // The two extra sweeps moved the vertex by 2 m; a quarter of that is left as velocity.
  CHECK(memory.points[0] - memory.start[0] == Approx(2.0 + 2.0 / 4.0));
  CHECK(memory.still == 0.75);
  // Without extra sweeps everything has its effect on velocities, and in substeps before the last.
  RecordingSheet::Scratch other;
  other.worst = {0.2, 0.01};
  (void)sweep(other, 4, limit_of_five_percent());
  CHECK(other.still == 0.0);
  RecordingSheet::Scratch before;
  before.worst = {0.2, 0.1};
  (void)sweep(before, 3, limit_of_five_percent());
  CHECK(before.still == 0.0);
}

TEST_CASE("limited sweeps: a limit that is not kept is reported", "[limited_sweeps]") {
  RecordingSheet::Scratch memory;
  memory.worst = {0.2, 0.1, 0.1, 0.1, as_part(0.08)};
  const auto report = sweep(memory, 4, limit_of_five_percent());
  CHECK(memory.calls == "Lubeaseasltltlt");
  CHECK(report.residual == Approx(0.08));
  CHECK(report.status == StepStatus::IterationLimit);
}

TEST_CASE("limited sweeps: extra sweeps are over-relaxed, and plain at the end of each cycle",
          "[limited_sweeps]") {
  for (const int most : {0, 1, 3, 4, 10, 25, 60, 100}) {
    CAPTURE(most);
    RecordingSheet::Scratch memory;
    memory.worst.assign(static_cast<std::size_t>(most), 0.1);
    PositionBasedSettings<double> settings = limit_of_five_percent();
    settings.extra_sweeps = most;
    StepReport<double> report;
    CHECK(sweep_until(
              0.05, 0.2, 1.0, RecordingSheet{}, memory, settings, [](double) {}, report) ==
          (most == 0 ? 0.2 : 0.1));
    CHECK(report.iterations == most);
    std::vector<double> expected(static_cast<std::size_t>(most), 1.7);
    for (const int end : {10, 30, 60, 100, most}) {
      for (int i = std::max(0, end - 3); i < std::min(end, most); ++i)
        expected[static_cast<std::size_t>(i)] = 1.0;
    }
    CHECK(memory.omega == expected);
  }
}

TEST_CASE("limited sweeps: what an over-relaxed sweep met is not the end", "[limited_sweeps]") {
  RecordingSheet::Scratch memory;
  memory.worst = {0.1, 0.04, 0.06, 0.05, 0.03};
  PositionBasedSettings<double> settings = limit_of_five_percent();
  settings.extra_sweeps = 60;
  StepReport<double> report;
  CHECK(sweep_until(
            0.05, 0.2, 1.0, RecordingSheet{}, memory, settings, [](double) {}, report) == 0.03);
  CHECK(memory.omega == std::vector<double>{1.7, 1.7, 1.0, 1.7, 1.0});
}

TEST_CASE("limited sweeps: without extra sweeps the start does not move", "[limited_sweeps]") {
  RecordingSheet::Scratch memory;
  memory.start[0] = 0.1;
  memory.points[0] = 0.3;
  memory.worst = {0.01, 0.01};
  const auto report = sweep(memory, 4, limit_of_five_percent());
  CHECK(memory.calls == "Lubeaseas");
  CHECK(report.status == StepStatus::Converged);
  CHECK(memory.start[0] == 0.1);  // the same bits
}

TEST_CASE("limited sweeps: motion is measured against the held vertex and gravity",
          "[limited_sweeps]") {
  RecordingSheet::Scratch memory;
  memory.points << 1, 2, 3, 0;
  memory.start << 0.5, 2, 4, 0;
  PositionBasedSettings<double> settings;
  settings.gravity = Vector3<double>(0, 3, -4);
  const auto frame = substep_frame(RecordingSheet{}, memory, settings, 0.1, {0});
  CHECK(frame.mean.x == 0.5);
  CHECK(frame.mean.y == 0);
  CHECK(frame.mean.z == -1);
  CHECK(frame.gift == Approx(0.0625));  // (5 · 5 m/s² · 0.01 s²)²
}

TEST_CASE("limited sweeps: a state within the limit is only measured", "[limited_sweeps]") {
  RecordingSheet::Scratch memory;
  memory.worst = {as_part(0.05)};
  memory.start[0] = 7;
  StepReport<double> report;
  pull_within_limit(RecordingSheet{}, memory, limit_of_five_percent(), report);
  CHECK(memory.calls == "t");
  CHECK(memory.start[0] == 7);
  CHECK(report.iterations == 0);
}

TEST_CASE("limited sweeps: a state beyond the limit is pulled back with its start",
          "[limited_sweeps]") {
  for (const int allowed : {0, 1, 60}) {
    auto settings = limit_of_five_percent();
    settings.extra_sweeps = allowed;
    RecordingSheet::Scratch memory;
    memory.worst = {0.3, 0.2, 0.04, 0.04};
    memory.start[0] = 7;
    StepReport<double> report;
    pull_within_limit(RecordingSheet{}, memory, settings, report);
    const int sweeps = std::min(allowed, 3);  // the last of them plain
    CHECK(memory.calls == (allowed == 0 ? "" : allowed == 1 ? "tt" : "tttt"));
    CHECK(memory.start[0] == 7 + sweeps);  // each sweep moves the points by one
    CHECK(report.iterations == sweeps);
    if (sweeps > 0) CHECK(memory.slack == Approx(as_part(0.03)));  // as in the substeps
  }
}
