// Sheets in contact with themselves: the search for pairs and crossings, and the pass over a step,
// for a flat sheet and one folded in two and in four. `pairs` counts what the search finds.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "clothctl/collision/self_contacts.hpp"
#include "clothctl/contact/sheet_impacts.hpp"

namespace {

using namespace clothctl;

constexpr double kSize = 0.5, kThickness = 0.002, kGap = 1.1 * kThickness;

struct Scene {
  Points<double> rest, folded;
  std::vector<std::array<int, 3>> triangles;
};

/// An n×n sheet, flat (0 folds), folded in two (1) or in four (2), with layers that do not lie
/// vertex on vertex.
Scene scene(int n, int folds) {
  Scene s;
  s.rest.resize(3, n * n);
  const double pi = std::acos(-1.0);
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < n; ++c) {
      s.rest.col(r * n + c) << kSize * c / (n - 1), kSize * r / (n - 1), 0;
      if (r + 1 == n || c + 1 == n) continue;
      const int a = r * n + c;
      s.triangles.push_back({a, a + 1, a + n + 1});
      s.triangles.push_back({a, a + n + 1, a + n});
    }
  }
  s.folded = s.rest;
  for (Index i = 0; i < s.folded.cols(); ++i) {
    // Folds beside the middle, so that layers are shifted against each other.
    const auto fold = [&](double u, double up, double radius, double start) {
      const double angle = std::clamp((u - start) / radius, 0.0, pi), inner = radius - up;
      const double rest = u - start < 0 ? u - start : std::max(0.0, u - start - pi * radius);
      const double along = start + (angle < pi ? std::min(rest, 0.0) : -rest);
      return std::array<double, 2>{along + inner * std::sin(angle),
                                   radius - inner * std::cos(angle)};
    };
    if (folds > 0) {
      const auto [x, up] = fold(s.rest(0, i), 0, 0.5 * kGap, 0.513 * kSize);
      s.folded(0, i) = x;
      s.folded(2, i) = up;
    }
    if (folds > 1) {
      const auto [y, up] = fold(s.rest(1, i), s.folded(2, i), 1.5 * kGap, 0.487 * kSize);
      s.folded(1, i) = y;
      s.folded(2, i) = up;
    }
  }
  return s;
}

void find_pairs(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  const Scene s = scene(n, static_cast<int>(state.range(1)));
  auto finder =
      SelfContactFinder<double>::create(s.rest, s.triangles, {}, {kThickness, {}}).value();
  finder.reserve(60 * n * n);
  finder.update(s.folded);
  for (auto _ : state) benchmark::DoNotOptimize(finder.find(0.5 * kThickness));
  state.counters["pairs"] = static_cast<double>(finder.contacts().size());
}

void count_crossings(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  const Scene s = scene(n, static_cast<int>(state.range(1)));
  auto finder = SelfContactFinder<double>::create(s.rest, s.triangles).value();
  int count = 0;
  for (auto _ : state) benchmark::DoNotOptimize(count = finder.count_crossings(s.folded));
  state.counters["crossings"] = count;
}

/// The layers fall towards the lowest one at 0.1 m/s for a step of 10 ms.
void pass(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  const Scene s = scene(n, static_cast<int>(state.range(1)));
  SheetImpactSettings<double> settings;
  settings.thickness = kThickness;
  auto impacts = SheetImpacts<double>::create(s.rest, s.triangles, settings).value();
  const VectorX<double> inverse_mass = VectorX<double>::Constant(n * n, 1000);
  ClothState<double> start{s.folded, Points<double>::Zero(3, n * n)};
  start.velocities.row(2) = -0.1 * s.folded.row(2) / kGap;
  start.positions += 0.01 * start.velocities;
  ClothState<double> end = start;
  SheetImpactReport report;
  for (auto _ : state) {
    end = start;
    report = impacts.resolve(s.folded, inverse_mass, 0.01, end);
  }
  state.counters["contacts"] = report.contacts;
  state.counters["rounds"] = report.rounds;
  state.counters["left"] = report.crossings_left;
}

void sizes(benchmark::internal::Benchmark* b) {
  for (const int n : {33, 65, 115}) {
    for (const int folds : {0, 1, 2}) b->Args({n, folds});
  }
  b->Unit(benchmark::kMillisecond);
}

BENCHMARK(find_pairs)->Apply(sizes);
BENCHMARK(count_crossings)->Apply(sizes);
BENCHMARK(pass)->Apply(sizes);

}  // namespace

BENCHMARK_MAIN();
