// Rigid bodies: a step of a stack at rest, of a pile of boxes as it falls and when it has settled,
// and the contacts of one pair.

#include <benchmark/benchmark.h>

#include <cstddef>
#include <random>
#include <vector>

#include "clothctl/sim/rigid_bodies.hpp"

namespace {

using namespace clothctl;
using V = Vector3<double>;

/// Boxes in a bin without a lid.
struct Bin {
  Bin() {
    for (const V& n : {V(0, 0, 1), V(1, 0, 0), V(-1, 0, 0), V(0, 1, 0), V(0, -1, 0)}) {
      const V point = -1.5 * n + V(0, 0, 1.5 * n[2]);
      planes.push_back(PlaneCollider<double>::create(point, n).value());
    }
    RigidBodiesSettings<double> settings;
    settings.sleep_time = 0;
    bodies = RigidBodies<double>(settings);
    for (const PlaneCollider<double>& p : planes)
      benchmark::DoNotOptimize(bodies.add_obstacle(ColliderRef<double>(p)).value());
  }
  void add(const V& half, const V& position, const V& turn) {
    RigidBodySetup<double> setup{ConvexShape<double>::box(half).value()};
    setup.motion.position = position;
    setup.motion.R_world_body = rotation_exp<double>(turn);
    benchmark::DoNotOptimize(bodies.add(setup).value());
  }
  void fill(int count) {
    std::mt19937 random(1);
    const auto draw = [&] { return static_cast<double>(random()) / 4294967296.0 - 0.5; };
    for (int i = 0; i < count; ++i) {
      const V place(0.55 * (i % 5 - 2), 0.55 * (i / 5 % 5 - 2), 0.3 + 0.6 * (i / 25));
      add(V(0.2, 0.2, 0.2) + 0.1 * V(draw(), draw(), draw()), place, V(draw(), draw(), draw()));
    }
  }
  RigidStepReport<double> step() { return bodies.step(1.0 / 60); }

  std::vector<PlaneCollider<double>> planes;
  RigidBodies<double> bodies;
};

void run(benchmark::State& state, Bin& bin) {
  double contacts = 0, newton = 0, sweeps = 0, steps = 0;
  for (auto _ : state) {
    const RigidStepReport<double> report = bin.step();
    contacts += report.contacts;
    newton += report.newton_steps;
    sweeps += report.sweeps;
    steps += 1;
  }
  state.counters["contacts"] = contacts / steps;
  state.counters["newton_steps"] = newton / steps;
  state.counters["sweeps"] = sweeps / steps;
}

void stack_at_rest(benchmark::State& state) {
  Bin bin;
  for (int i = 0; i < state.range(0); ++i)
    bin.add(V(0.5, 0.5, 0.5), V(0, 0, 0.5 + i), V(0, 0, 0.3 * i));
  for (int k = 0; k < 60; ++k) benchmark::DoNotOptimize(bin.step());
  run(state, bin);
}
BENCHMARK(stack_at_rest)->Arg(1)->Arg(5)->Arg(10)->Unit(benchmark::kMillisecond);

void falling_pile(benchmark::State& state) {
  Bin bin;
  bin.fill(static_cast<int>(state.range(0)));
  run(state, bin);
}
BENCHMARK(falling_pile)->Arg(100)->Iterations(120)->Unit(benchmark::kMillisecond);

void settled_pile(benchmark::State& state) {
  Bin bin;
  bin.fill(static_cast<int>(state.range(0)));
  for (int k = 0; k < 300; ++k) benchmark::DoNotOptimize(bin.step());
  run(state, bin);
}
BENCHMARK(settled_pile)->Arg(10)->Arg(30)->Arg(100)->Unit(benchmark::kMillisecond);

void boxes_face_to_face(benchmark::State& state) {
  const ConvexShape<double> box = ConvexShape<double>::box(V(0.5, 0.5, 0.5)).value();
  const Matrix3<double> upright = Matrix3<double>::Identity();
  const Matrix3<double> turned = rotation_exp<double>(V(0, 0, 0.4));
  for (auto _ : state)
    benchmark::DoNotOptimize(
        find_body_contacts<double>(box, turned, V(0.1, 0.2, 1), box, upright, V(0, 0, 0), 0.01));
}
BENCHMARK(boxes_face_to_face);

}  // namespace
