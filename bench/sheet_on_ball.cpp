// A sheet of 1 m falls on a ball and comes to rest: 10 s at 60 Hz, once for each model. Every step
// is interleaved with one of the same model in free fall. Counters:
//
//   step_ms, p99_ms   median and 99th percentile of the step with its contacts
//   free_ms, ratio    median of the free step, and step_ms/free_ms
//   find_ms           median of the search for contacts
//   closed            contacts that transmit a force at the end
//   touching, hem     speed of the fastest vertex that touches, and of the others, at the end, mm/s
//   impact_mm, rest_um  largest depth in the fall, and at the end

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/collision/shapes.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"

namespace {

using namespace clothctl;
using Clock = std::chrono::steady_clock;

constexpr double kStep = 1.0 / 60, kRadius = 0.3;
constexpr int kSteps = 600;

double milliseconds(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double, std::milli>(to - from).count();
}

double share_of(std::vector<double> times, double share) {
  std::sort(times.begin(), times.end());
  return times[static_cast<std::size_t>(share * static_cast<double>(times.size() - 1))];
}

/// A level sheet of n×n vertices, 5 cm above the top of the ball.
SpringNetwork<double> level_sheet(int n) {
  GridMesh<double> grid = make_grid<double>(n, n, 1, 1).value();
  const Points<double> hanging = grid.positions;
  grid.positions.row(0) = hanging.row(0).array() - hanging.row(0).mean();
  grid.positions.row(1) = hanging.row(2).array() - hanging.row(2).mean();
  grid.positions.row(2).setConstant(kRadius + 0.05);
  return sheet_network(grid.positions, grid.triangles, material_preset<double>("cotton").value())
      .value();
}

template <class Model>
void fall_on_ball(benchmark::State& state, const Model& model) {
  const Index room = 20 * model.vertex_count();
  SheetContactSettings<double> inside;
  inside.smooth_gain = 1e-3;
  const SpringNetwork<double>& network = model.network();
  const auto ball =
      SphereCollider<double>::create(Vector3<double>::Zero(), kRadius, {0.4, 0}).value();
  const std::vector<ColliderRef<double>> obstacles{ColliderRef<double>(ball)};
  ClothInput<double> input;
  input.clear();
  for (auto _ : state) {
    auto finder =
        SheetContactFinder<double>::create(network.rest_positions, network.triangles, {}, inside)
            .value();
    auto contacts = ObstacleContacts<double>::create(room).value();
    auto ws = model.make_workspace(room), free_ws = model.make_workspace();
    auto sheet = model.rest_state(), free = sheet;
    std::vector<double> step, alone, find;
    double impact = 0;
    for (int i = 0; i < kSteps; ++i) {
      const auto a = Clock::now();
      benchmark::DoNotOptimize(finder.update(sheet.positions));
      benchmark::DoNotOptimize(contacts.update(obstacles, sheet.velocities, kStep, finder));
      const auto b = Clock::now();
      benchmark::DoNotOptimize(model.step(sheet, input, contacts, kStep, ws));
      const auto c = Clock::now();
      benchmark::DoNotOptimize(model.step(free, input, kStep, free_ws));
      find.push_back(milliseconds(a, b));
      step.push_back(milliseconds(b, c));
      alone.push_back(milliseconds(c, Clock::now()));
      impact = std::max(impact, contacts.report().penetration);
    }
    std::vector<bool> touches(static_cast<std::size_t>(model.vertex_count()), false);
    for (const auto& contact : contacts.contacts()) {
      for (const int v : contact.point.vertex) {
        if (v >= 0 && contact.state != ContactState::Open)
          touches[static_cast<std::size_t>(v)] = true;
      }
    }
    double touching = 0, hem = 0;
    for (Index v = 0; v < model.vertex_count(); ++v) {
      double& most = touches[static_cast<std::size_t>(v)] ? touching : hem;
      most = std::max(most, 1000 * sheet.velocities.col(v).norm());
    }
    state.counters["step_ms"] = share_of(step, 0.5);
    state.counters["p99_ms"] = share_of(step, 0.99);
    state.counters["free_ms"] = share_of(alone, 0.5);
    state.counters["ratio"] = share_of(step, 0.5) / share_of(alone, 0.5);
    state.counters["find_ms"] = share_of(find, 0.5);
    state.counters["closed"] = static_cast<double>(contacts.report().closed);
    state.counters["touching"] = touching;
    state.counters["hem"] = hem;
    state.counters["impact_mm"] = 1e3 * impact;
    state.counters["rest_um"] = 1e6 * contacts.report().penetration;
  }
}

void mass_spring(benchmark::State& state) {
  const auto settings = MassSpringSettings<double>::of(material_preset<double>("cotton").value());
  fall_on_ball(
      state,
      MassSpring<double>::create(level_sheet(static_cast<int>(state.range(0))), settings).value());
}
void xpbd(benchmark::State& state) {
  const auto settings =
      PositionBasedSettings<double>::of(material_preset<double>("cotton").value());
  fall_on_ball(
      state, PositionBased<double>::create(level_sheet(static_cast<int>(state.range(0))), settings)
                 .value());
}
void xpbd_limited(benchmark::State& state) {
  auto settings = PositionBasedSettings<double>::of(material_preset<double>("cotton").value());
  settings.substeps = static_cast<int>(state.range(1));
  settings.stretch_limit = 0.02;
  fall_on_ball(
      state, PositionBased<double>::create(level_sheet(static_cast<int>(state.range(0))), settings)
                 .value());
}
BENCHMARK(mass_spring)->Arg(33)->Arg(65)->Iterations(1)->Unit(benchmark::kSecond);
BENCHMARK(xpbd)->Arg(33)->Arg(65)->Iterations(1)->Unit(benchmark::kSecond);
BENCHMARK(xpbd_limited)
    ->ArgsProduct({{17, 25, 33}, {4, 8, 20}})
    ->Iterations(1)
    ->Unit(benchmark::kSecond);

}  // namespace
