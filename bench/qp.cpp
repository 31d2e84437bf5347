// The QP solvers: cold and warm solves of random problems with fixed seeds, the cost of a new
// Hessian, and updates of the factor.

#include <benchmark/benchmark.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"

namespace {

using namespace clothctl;

/// Returns normally distributed entries for a seed.
class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double normal() { return normal_(engine_); }

  template <class Scalar>
  MatrixX<Scalar> matrix(Index rows, Index cols) {
    MatrixX<Scalar> M(rows, cols);
    for (Index j = 0; j < cols; ++j) {
      for (Index i = 0; i < rows; ++i) M(i, j) = static_cast<Scalar>(normal());
    }
    return M;
  }
  template <class Scalar>
  VectorX<Scalar> vector(Index size) {
    return matrix<Scalar>(size, 1).col(0);
  }

 private:
  std::mt19937 engine_;
  std::normal_distribution<double> normal_{0.0, 1.0};
};

/// H = J Jᵀ / n + 0.05 I.
template <class Scalar>
MatrixX<Scalar> hessian(Random& random, Index n) {
  const MatrixX<Scalar> J = random.matrix<Scalar>(n, n);
  MatrixX<Scalar> H = J * J.transpose() / static_cast<Scalar>(n);
  H.diagonal().array() += Scalar(0.05);
  const MatrixX<Scalar> mirrored = Scalar(0.5) * (H + H.transpose());
  return mirrored;
}

/// Bounds [0, 1] on every unknown; about half of them are active at the optimum.
template <class Scalar>
struct BoxProblem {
  MatrixX<Scalar> H;
  VectorX<Scalar> g, lb, ub;

  explicit BoxProblem(Index n) {
    Random random(1);
    H = hessian<Scalar>(random, n);
    g = random.vector<Scalar>(n);
    lb = VectorX<Scalar>::Constant(n, Scalar(0));
    ub = VectorX<Scalar>::Constant(n, Scalar(1));
  }
};

/// m rows |a_iᵀx - b_i| ≤ 1/2 around a point within the box; a fifth of them are equalities.
template <class Scalar>
struct RowProblem : BoxProblem<Scalar> {
  MatrixX<Scalar> A;
  VectorX<Scalar> rl, ru;

  RowProblem(Index n, Index m) : BoxProblem<Scalar>(n) {
    Random random(2);
    A = random.matrix<Scalar>(m, n);
    const VectorX<Scalar> middle = A * VectorX<Scalar>::Constant(n, Scalar(0.5));
    rl = middle;
    ru = middle;
    for (Index i = 0; i < m; ++i) {
      if (i % 5 == 0) continue;
      rl[i] -= Scalar(0.5);
      ru[i] += Scalar(0.5);
    }
  }
};

/// A receding horizon: min Σ_t |Σ_{s≤t} B_{t-s} d_s - r_t|² + 0.01 |d|², d ≥ 0, with 8 unknowns per
/// frame and a moving reference. The solution of a frame is nearly that of the previous frame,
/// shifted by 8 unknowns.
struct Sequence {
  static constexpr Index kUnknowns = 8, kOutputs = 6;
  MatrixX<double> H;
  std::vector<VectorX<double>> g;
  VectorX<double> lb, ub;

  Sequence(Index n, int frames) {
    Random random(3);
    const Index horizon = n / kUnknowns;
    const MatrixX<double> gain = random.matrix<double>(kOutputs, kUnknowns);
    MatrixX<double> J = MatrixX<double>::Constant(kOutputs * horizon, n, 0.0);
    for (Index t = 0; t < horizon; ++t) {
      for (Index s = 0; s <= t; ++s) {
        const double decay = std::exp(-0.1 * static_cast<double>(t - s));
        J.block(kOutputs * t, kUnknowns * s, kOutputs, kUnknowns) = decay * gain;
      }
    }
    const MatrixX<double> product = J.transpose() * J;
    H = 0.5 * (product + product.transpose());
    H.diagonal().array() += 0.01;
    const VectorX<double> phase = random.vector<double>(kOutputs);
    for (int f = 0; f < frames; ++f) {
      VectorX<double> reference(J.rows());
      for (Index t = 0; t < horizon; ++t) {
        for (Index i = 0; i < kOutputs; ++i) {
          const double time = 0.05 * static_cast<double>(f + t);
          reference[kOutputs * t + i] =
              std::sin(time * (1.0 + 0.2 * static_cast<double>(i)) + phase[i]) +
              0.02 * random.normal();
        }
      }
      g.push_back(-J.transpose() * reference);
    }
    lb = VectorX<double>::Constant(n, 0.0);
    ub = VectorX<double>::Constant(n, scalar_traits<double>::infinity());
  }
};

/// Ends a benchmark whose solver did not return `Solved`, and shows the status.
void expect_solved(benchmark::State& state, QpStatus status) {
  if (status != QpStatus::Solved) state.SkipWithError(std::string(to_string(status)).c_str());
}

template <class Scalar>
void box_cold(benchmark::State& state) {
  const BoxProblem<Scalar> p(state.range(0));
  BoxActiveSet<Scalar> solver;
  QpResult<Scalar> result;
  expect_solved(state, solver.set_hessian(p.H));
  for (auto _ : state) {
    solver.reset();
    expect_solved(state, solver.solve(p.g, p.lb, p.ub, result));
  }
  state.counters["rounds"] = result.iterations;
  state.counters["free"] = static_cast<double>(solver.free_count());
}

template <class Scalar>
void rows_cold(benchmark::State& state) {
  const RowProblem<Scalar> p(state.range(0), state.range(1));
  ActiveSet<Scalar> solver;
  QpResult<Scalar> result;
  solver.reserve(p.H.rows(), p.A.rows());
  expect_solved(state, solver.set_hessian(p.H));
  expect_solved(state, solver.set_rows(p.A));
  for (auto _ : state) {
    solver.reset();
    expect_solved(state, solver.solve(p.g, p.lb, p.ub, p.rl, p.ru, result));
  }
  state.counters["rounds"] = result.iterations;
}

/// Alternates between two gradients, so that a few bounds change each time.
void rows_warm(benchmark::State& state) {
  const RowProblem<double> p(state.range(0), state.range(1));
  Random random(4);
  const VectorX<double> other = p.g + 0.02 * random.vector<double>(p.g.size());
  ActiveSet<double> solver;
  QpResult<double> result;
  solver.reserve(p.H.rows(), p.A.rows());
  expect_solved(state, solver.set_hessian(p.H));
  expect_solved(state, solver.set_rows(p.A));
  bool first = false;
  for (auto _ : state) {
    first = !first;
    expect_solved(state, solver.solve(first ? p.g : other, p.lb, p.ub, p.rl, p.ru, result));
  }
  state.counters["rounds"] = result.iterations;
}

/// One iteration is one frame. After the last frame the sequence starts again, cold and untimed.
void sequence_warm(benchmark::State& state) {
  const Sequence sequence(state.range(0), 60);
  BoxActiveSet<double> solver;
  QpResult<double> result;
  expect_solved(state, solver.set_hessian(sequence.H));
  std::size_t frame = sequence.g.size();
  double rounds = 0;
  for (auto _ : state) {
    if (frame == sequence.g.size()) {
      state.PauseTiming();
      solver.reset();
      expect_solved(state, solver.solve(sequence.g[0], sequence.lb, sequence.ub, result));
      frame = 1;
      state.ResumeTiming();
    }
    solver.shift(Sequence::kUnknowns);
    expect_solved(state, solver.solve(sequence.g[frame++], sequence.lb, sequence.ub, result));
    rounds += result.iterations;
  }
  state.counters["rounds"] = benchmark::Counter(rounds, benchmark::Counter::kAvgIterations);
  state.counters["free"] = static_cast<double>(solver.free_count());
}

/// Solves the same problem again: the cost of a solve that changes nothing.
void box_again(benchmark::State& state) {
  const BoxProblem<double> p(state.range(0));
  BoxActiveSet<double> solver;
  QpResult<double> result;
  expect_solved(state, solver.set_hessian(p.H));
  expect_solved(state, solver.solve(p.g, p.lb, p.ub, result));
  for (auto _ : state) {
    expect_solved(state, solver.solve(p.g, p.lb, p.ub, result));
  }
  state.counters["rounds"] = result.iterations;
}

void box_set_hessian(benchmark::State& state) {
  const BoxProblem<double> p(state.range(0));
  BoxActiveSet<double> solver;
  solver.reserve(p.H.rows());
  for (auto _ : state) {
    expect_solved(state, solver.set_hessian(p.H));
  }
}

void general_set_matrices(benchmark::State& state) {
  const RowProblem<double> p(state.range(0), state.range(1));
  ActiveSet<double> solver;
  solver.reserve(p.H.rows(), p.A.rows());
  for (auto _ : state) {
    expect_solved(state, solver.set_hessian(p.H));
    expect_solved(state, solver.set_rows(p.A));
  }
}

/// Closes and opens the bounds of one free unknown in turn, so that each solve removes or adds one
/// column of the factor. `box_again` gives the cost of the solve without the update.
void box_one_update(benchmark::State& state) {
  const BoxProblem<double> p(state.range(0));
  BoxActiveSet<double> solver;
  QpResult<double> result;
  expect_solved(state, solver.set_hessian(p.H));
  expect_solved(state, solver.solve(p.g, p.lb, p.ub, result));
  Index chosen = 0;
  for (Index i = 0; i < p.g.size() / 2; ++i) {
    if (result.x[i] > 0.25 && result.x[i] < 0.75) chosen = i;
  }
  const VectorX<double> optimum = result.x;
  VectorX<double> lb = p.lb, ub = p.ub;
  bool closed = false;
  double rounds = 0;
  for (auto _ : state) {
    closed = !closed;
    lb[chosen] = closed ? optimum[chosen] : 0.0;
    ub[chosen] = closed ? optimum[chosen] : 1.0;
    expect_solved(state, solver.solve(p.g, lb, ub, result));
    rounds += result.iterations;
  }
  state.counters["rounds"] = benchmark::Counter(rounds, benchmark::Counter::kAvgIterations);
  state.counters["free"] = static_cast<double>(solver.free_count());
}

void sizes(benchmark::internal::Benchmark* bench) {
  bench->ArgName("n")->Arg(40)->Arg(80)->Arg(160)->Arg(320)->Arg(640)->Unit(
      benchmark::kMicrosecond);
}

void sizes_with_rows(benchmark::internal::Benchmark* bench) {
  bench->ArgNames({"n", "m"})->Args({40, 20})->Args({80, 40})->Args({160, 80})->Args({320, 160});
  bench->Unit(benchmark::kMicrosecond);
}

BENCHMARK(box_cold<float>)->Apply(sizes);
BENCHMARK(box_cold<double>)->Apply(sizes);
BENCHMARK(box_again)->Apply(sizes);
BENCHMARK(box_one_update)->Apply(sizes);
BENCHMARK(box_set_hessian)->Apply(sizes);
BENCHMARK(sequence_warm)->Apply(sizes);
BENCHMARK(rows_cold<float>)->Apply(sizes_with_rows);
BENCHMARK(rows_cold<double>)->Apply(sizes_with_rows);
BENCHMARK(rows_warm)->Apply(sizes_with_rows);
BENCHMARK(general_set_matrices)->Apply(sizes_with_rows);

}  // namespace
