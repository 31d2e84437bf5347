// A step of a position-based sheet: XPBD 20 × 2 with and without air and with a limit of stretch,
// and Verlet with 15 sweeps.

#include "clothctl/cloth/position_based.hpp"

#include <benchmark/benchmark.h>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"

namespace {

using namespace clothctl;

template <class Scalar>
void step(benchmark::State& bench, PositionBasedSettings<Scalar> settings) {
  const int n = static_cast<int>(bench.range(0));
  const Result<GridMesh<Scalar>> grid = make_grid<Scalar>(n, n, Scalar(0.5), Scalar(0.5));
  if (!grid) return bench.SkipWithError(grid.error().c_str());
  const Result<SpringNetwork<Scalar>> network = sheet_network(grid.value(), Material<Scalar>());
  if (!network) return bench.SkipWithError(network.error().c_str());
  settings.pinned = {n * n - n, n * n - 1};
  settings.drag = Scalar(0.5);
  const Result<PositionBased<Scalar>> model =
      PositionBased<Scalar>::create(network.value(), settings);
  if (!model) return bench.SkipWithError(model.error().c_str());
  auto workspace = model.value().make_workspace();
  ClothState<Scalar> state = model.value().rest_state();
  const ClothInput<Scalar> input;
  for (auto _ : bench) {
    if (!model.value().step(state, input, Scalar(0.02), workspace).advanced)
      return bench.SkipWithError("step failed");
  }
}

template <class Scalar>
void xpbd(benchmark::State& bench) {
  step<Scalar>(bench, {});
}

template <class Scalar>
void limited(benchmark::State& bench) {
  PositionBasedSettings<Scalar> settings;
  settings.substeps = 10;
  settings.stretch_limit = Scalar(0.02);
  step<Scalar>(bench, settings);
}

void xpbd_air(benchmark::State& bench) {
  PositionBasedSettings<double> settings;
  settings.air.normal_coefficient = 1.0;
  settings.air.tangent_coefficient = 0.1;
  step<double>(bench, settings);
}

void verlet(benchmark::State& bench) {
  step<double>(bench, PositionBasedSettings<double>::verlet());
}

BENCHMARK_TEMPLATE(xpbd, double)->Arg(17)->Arg(33)->Arg(65)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(xpbd, float)->Arg(17)->Arg(33)->Arg(65)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(limited, double)->Arg(33)->Arg(65)->Arg(129)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(limited, float)->Arg(33)->Arg(65)->Arg(129)->Unit(benchmark::kMillisecond);
BENCHMARK(xpbd_air)->Arg(17)->Arg(65)->Unit(benchmark::kMillisecond);
BENCHMARK(verlet)->Arg(17)->Arg(65)->Unit(benchmark::kMillisecond);

}  // namespace
