#include "clothctl/cloth/detail/limited_sweeps.hpp"

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
  };
  int vertex_count() const { return 1; }
  std::size_t offset(int) const { return 0; }
  void correct_levels(int, int, double, Scratch& memory) const { memory.calls += 'L'; }
  void sweep_unlimited(Scratch& memory) const { memory.calls += 'u'; }
  template <bool, bool>
  void bend(Scratch& memory) const {
    memory.calls += 'b';
  }
  LimitRule<double, 1> sweep(LimitRule<double, 1> rule, Scratch& memory) const {
    memory.calls += 's';
    return swept(rule, memory);
  }
  TensionRule<double, 1> sweep(TensionRule<double, 1> rule, Scratch& memory) const {
    memory.calls += 't';
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
  sweep_within_limit(
      RecordingSheet{}, memory, settings, part, [&] { memory.calls += 'e'; },
      [&] { memory.calls += 'a'; }, report);
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
  CHECK(memory.calls == "Lubeaseastt");
  CHECK(report.iterations == 4);
  CHECK(report.residual == Approx(0.0449));
  CHECK(report.status == StepStatus::Converged);
  // The two extra sweeps moved the vertex by 2 m; a quarter of that is left as velocity.
  CHECK(memory.points[0] - memory.start[0] == Approx(2.0 + 2.0 / 4.0));
}

TEST_CASE("limited sweeps: a limit that is not kept is reported", "[limited_sweeps]") {
  RecordingSheet::Scratch memory;
  memory.worst = {0.2, 0.1, 0.1, 0.1, as_part(0.08)};
  const auto report = sweep(memory, 4, limit_of_five_percent());
  CHECK(memory.calls == "Lubeaseasttt");
  CHECK(report.residual == Approx(0.08));
  CHECK(report.status == StepStatus::IterationLimit);
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
