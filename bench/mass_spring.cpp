// A step of a mass-spring sheet that swings from two pinned corners, with one solve and with
// Newton, by factors and by conjugate gradients, in double and single precision; and the
// linearisation of the response that predictors use.

#include "clothctl/cloth/mass_spring.hpp"

#include <benchmark/benchmark.h>

#include <cmath>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/network/sheet.hpp"

namespace {

using namespace clothctl;

template <class Scalar>
Result<MassSpring<Scalar>> sheet(int n, Integration integration,
                                 LinearSolver solver = LinearSolver::Factor) {
  const Result<GridMesh<Scalar>> grid = make_grid<Scalar>(n, n, Scalar(0.5), Scalar(0.5));
  if (!grid) return Error{grid.error()};
  const Material<Scalar> material;
  const Result<SpringNetwork<Scalar>> network = sheet_network(grid.value(), material);
  if (!network) return Error{network.error()};
  MassSpringSettings<Scalar> settings;
  settings.integration = integration;
  settings.linear_solver = solver;
  settings.drag = material.drag;
  settings.pinned = {n * n - n, n * n - 1};
  return MassSpring<Scalar>::create(network.value(), settings);
}

// The hands move back and forth, so that no step is trivial.
template <class Scalar>
void step(benchmark::State& bench, Integration integration,
          LinearSolver solver = LinearSolver::Factor) {
  const int n = static_cast<int>(bench.range(0));
  const Result<MassSpring<Scalar>> model = sheet<Scalar>(n, integration, solver);
  if (!model) return bench.SkipWithError(model.error().c_str());
  auto workspace = model.value().make_workspace();
  ClothState<Scalar> state = model.value().rest_state();
  ClothInput<Scalar> input;
  input.driven_vertices = {n * n - n, n * n - 1};
  input.driven_positions = state.positions.rightCols(n);
  const Points<Scalar> home = input.driven_positions;
  input.driven_positions.resize(3, 2);
  int frame = 0;
  long solves = 0;
  for (auto _ : bench) {
    const Scalar sway = Scalar(0.05) * Scalar(std::sin(0.05 * frame++));
    input.driven_positions.col(0) = home.col(0) + Vector3<Scalar>(Scalar(0), sway, Scalar(0));
    input.driven_positions.col(1) = home.col(n - 1) + Vector3<Scalar>(Scalar(0), sway, Scalar(0));
    const StepReport<Scalar> report = model.value().step(state, input, Scalar(0.02), workspace);
    if (!report.advanced) return bench.SkipWithError("step failed");
    solves += report.iterations;
  }
  bench.counters["solves"] =
      benchmark::Counter(static_cast<double>(solves), benchmark::Counter::kAvgIterations);
}

template <class Scalar>
void one_solve(benchmark::State& bench) {
  step<Scalar>(bench, Integration::LinearlyImplicit);
}

template <class Scalar>
void newton(benchmark::State& bench) {
  step<Scalar>(bench, Integration::Newton);
}

template <class Scalar>
void one_solve_cg(benchmark::State& bench) {
  step<Scalar>(bench, Integration::LinearlyImplicit, LinearSolver::ConjugateGradient);
}

template <class Scalar>
void newton_cg(benchmark::State& bench) {
  step<Scalar>(bench, Integration::Newton, LinearSolver::ConjugateGradient);
}

template <class Scalar>
void linearise(benchmark::State& bench) {
  const Result<MassSpring<Scalar>> model =
      sheet<Scalar>(static_cast<int>(bench.range(0)), Integration::LinearlyImplicit);
  if (!model) return bench.SkipWithError(model.error().c_str());
  MassSpringResponse<Scalar> response(model.value());
  const ClothState<Scalar> state = model.value().rest_state();
  const Vector3<Scalar> still = Vector3<Scalar>::Zero();
  for (auto _ : bench) {
    if (!response.linearise(state.positions, state.velocities, still, Scalar(0.02), {})) {
      return bench.SkipWithError("step matrix is not definite");
    }
  }
}

BENCHMARK_TEMPLATE(one_solve, double)->Arg(17)->Arg(33)->Arg(65)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(one_solve, float)->Arg(17)->Arg(33)->Arg(65)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(newton, double)->Arg(17)->Arg(33)->Arg(65)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(newton, float)->Arg(17)->Arg(33)->Arg(65)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(one_solve_cg, double)->Arg(65)->Arg(129)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(one_solve, double)->Arg(129)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(newton_cg, double)->Arg(65)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(linearise, float)->Arg(17)->Arg(33)->Arg(65)->Unit(benchmark::kMillisecond);

}  // namespace
