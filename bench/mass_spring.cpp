// A step of a mass-spring sheet that swings from two pinned corners, with one solve and with
// Newton, by factors and by conjugate gradients, in double and single precision; and the
// linearisation of the response that predictors use.

#include "clothctl/cloth/mass_spring.hpp"

#include <benchmark/benchmark.h>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "swinging_sheet.hpp"

namespace {

using namespace clothctl_bench;

template <class Scalar>
Result<MassSpring<Scalar>> sheet(int n, Integration integration,
                                 LinearSolver solver = LinearSolver::Factor) {
  MassSpringSettings<Scalar> settings;
  settings.integration = integration;
  settings.linear_solver = solver;
  return pinned_sheet<Scalar>(n, settings);
}

template <class Scalar>
void step(benchmark::State& bench, Integration integration,
          LinearSolver solver = LinearSolver::Factor) {
  const Result<MassSpring<Scalar>> model =
      sheet<Scalar>(static_cast<int>(bench.range(0)), integration, solver);
  if (!model) return bench.SkipWithError(model.error().c_str());
  auto workspace = model.value().make_workspace();
  ClothState<Scalar> state = model.value().rest_state();
  SwingingHands<Scalar> hands(model.value());
  long solves = 0;
  for (auto _ : bench) {
    const StepReport<Scalar> report =
        model.value().step(state, hands.next(), Scalar(kStep), workspace);
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
