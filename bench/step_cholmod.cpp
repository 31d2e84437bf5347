// A linearly implicit step of a swinging sheet beside the same step whose linear system CHOLMOD
// solves: the same assembly, right-hand side and update, another factor. Both reach the same
// states, which is checked before anything is timed. CHOLMOD gets the best that it can use: a
// supernodal factor, analysed once, with an order of elimination of its own or ours, of a matrix
// whose rows are already in this order, so that it permutes nothing. It is as fast as the BLAS that
// it finds: install OpenBLAS. For one thread set OPENBLAS_NUM_THREADS=1 and OMP_THREAD_LIMIT=1;
// CHOLMOD itself asks OpenMP for four threads, whatever OMP_NUM_THREADS says.

#include <benchmark/benchmark.h>
#include <suitesparse/cholmod.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/linalg/nested_dissection.hpp"
#include "swinging_sheet.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A linearly implicit step in which `solve` replaces the project's own factor. It turns ws.rhs
/// into the solution of the system ws.matrix, with the identity in the rows of ws.held.
template <RealScalar Scalar>
struct StepParts {
  template <class Solve>
  static bool step(const MassSpring<Scalar>& model, ClothState<Scalar>& state,
                   const ClothInput<Scalar>& input, Scalar dt, MassSpringWorkspace<Scalar>& ws,
                   Solve&& solve) {
    if (model.refuse(state, input, dt, ws) != StepStatus::Converged) return false;
    model.prepare(state, input, dt, ws);
    StepSolver<Scalar> steps = model.solver(state, dt, ws);
    steps.assemble(state.positions, Scalar(0));
    steps.load_linear();
    if (!solve(ws.matrix, ws.held, ws.rhs)) return false;
    move_along(ws.velocity, Scalar(1), ws.rhs, ws.velocity);
    const StepReport<Scalar> report{StepStatus::Converged, false, Scalar(0), 1};
    return model.finish(state, input, dt, report, ws).advanced;
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail

namespace {

using namespace clothctl_bench;
using Workspace = MassSpring<double>::Workspace;

/// Orders of elimination: CHOLMOD's own, and the project's nested dissection.
enum Order { kAmd, kMetis, kNesdis, kOurs };

/// The supernodal factor of a BlockSymmetric.
class Cholmod {
 public:
  Cholmod(const BlockSymmetric<double>& pattern, Order order, const Points<double>& positions)
      : rows_(3 * static_cast<int>(pattern.rows())), place_(static_cast<std::size_t>(rows_)) {
    cholmod_start(&common_);
    common_.supernodal = CHOLMOD_SUPERNODAL;
    common_.nmethods = 1;
    common_.method[0].ordering = std::array{CHOLMOD_AMD, CHOLMOD_METIS, CHOLMOD_NESDIS,
                                            CHOLMOD_GIVEN}[static_cast<std::size_t>(order)];
    for (int i = 0; i < rows_; ++i) at(place_, i) = i;
    std::vector<int> given;
    if (order == kOurs) {
      for (const int vertex : nested_dissection<double>(pattern, positions).permutation)
        for (int c = 0; c < 3; ++c) given.push_back(3 * vertex + c);
    }
    load_pattern(pattern);
    factor_ =
        cholmod_analyze_p(matrix_, given.empty() ? nullptr : given.data(), nullptr, 0, &common_);
    for (int k = 0; k < rows_; ++k) at(place_, static_cast<const int*>(factor_->Perm)[k]) = k;
    cholmod_free_factor(&factor_, &common_);
    load_pattern(pattern);
    common_.method[0].ordering = CHOLMOD_NATURAL;
    common_.postorder = 0;
    factor_ = cholmod_analyze(matrix_, &common_);
    right_ = cholmod_zeros(static_cast<std::size_t>(rows_), 1, CHOLMOD_REAL, &common_);
  }
  Cholmod(const Cholmod&) = delete;
  Cholmod& operator=(const Cholmod&) = delete;
  ~Cholmod() {
    for (cholmod_dense** dense : {&right_, &solution_, &first_, &second_})
      cholmod_free_dense(dense, &common_);
    cholmod_free_factor(&factor_, &common_);
    cholmod_free_sparse(&matrix_, &common_);
    cholmod_finish(&common_);
  }

  /// Multiplications and additions of a factorisation, and the scalars that the factor stores.
  double flops() const { return common_.fl; }
  double entries() const { return static_cast<double>(factor_->xsize); }

  bool factorize(const BlockSymmetric<double>& matrix, std::span<const unsigned char> held) {
    double* x = static_cast<double*>(matrix_->x);
    const int* to = target_.data();
    for (Index i = 0; i < matrix.rows(); ++i) to = copy_diagonal(matrix.diagonal(i), x, to);
    for (Index s = 0; s < matrix.lower_count(); ++s) {
      const double* block = matrix.lower(s).data();
      for (int k = 0; k < 9; ++k) x[*to++] = block[k];
    }
    for (std::size_t i = 0; i < held.size(); ++i) {
      if (held[i] == 0) continue;
      for (const int k : of_vertex_[i]) x[k] = 0.0;
      for (int c = 0; c < 3; ++c)
        x[static_cast<const int*>(matrix_->p)[at(place_, 3 * static_cast<int>(i) + c)]] = 1.0;
    }
    return cholmod_factorize(matrix_, factor_, &common_) != 0 && common_.status == CHOLMOD_OK;
  }

  bool solve(Lanes<double, 1>& x) {
    double* right = static_cast<double*>(right_->x);
    for (int i = 0; i < rows_; ++i) right[at(place_, i)] = x[i];
    if (cholmod_solve2(CHOLMOD_A, factor_, right_, nullptr, &solution_, nullptr, &first_, &second_,
                       &common_) == 0)
      return false;
    const double* solution = static_cast<const double*>(solution_->x);
    for (int i = 0; i < rows_; ++i) x[i] = solution[at(place_, i)];
    return true;
  }

 private:
  /// An entry of the lower triangle, its place in `target_` and its vertices.
  struct Entry {
    int column, row;
    std::size_t source;
    int a, b;
  };

  static int& at(std::vector<int>& v, int i) { return v[static_cast<std::size_t>(i)]; }

  static const int* copy_diagonal(const Matrix3<double>& block, double* x, const int* to) {
    for (int c = 0; c < 3; ++c)
      for (int r = c; r < 3; ++r) x[*to++] = block(r, c);
    return to;
  }

  /// Replaces matrix_ by the pattern with row i in row place_[i], its lower triangle by columns.
  void load_pattern(const BlockSymmetric<double>& pattern) {
    std::vector<Entry> entries;
    const auto add = [&](int a, int r, int b, int c) {
      const int i = at(place_, 3 * a + r), j = at(place_, 3 * b + c);
      entries.push_back({(std::min)(i, j), (std::max)(i, j), entries.size(), a, b});
    };
    const int vertices = static_cast<int>(pattern.rows());
    for (int i = 0; i < vertices; ++i)
      for (int c = 0; c < 3; ++c)
        for (int r = c; r < 3; ++r) add(i, r, i, c);
    for (int i = 0; i < vertices; ++i)
      for (int s = pattern.row_begin(i); s < pattern.row_begin(i + 1); ++s)
        for (int k = 0; k < 9; ++k) add(i, k % 3, pattern.column(s), k / 3);
    std::sort(entries.begin(), entries.end(), [](const Entry& p, const Entry& q) {
      return std::pair(p.column, p.row) < std::pair(q.column, q.row);
    });
    const std::size_t n = static_cast<std::size_t>(rows_);
    cholmod_free_sparse(&matrix_, &common_);
    matrix_ = cholmod_allocate_sparse(n, n, entries.size(), 1, 1, -1, CHOLMOD_REAL, &common_);
    int* begin = static_cast<int*>(matrix_->p);
    std::fill_n(begin, n + 1, 0);
    target_.resize(entries.size());
    of_vertex_.assign(static_cast<std::size_t>(vertices), {});
    for (std::size_t k = 0; k < entries.size(); ++k) {
      const Entry& entry = entries[k];
      ++begin[entry.column + 1];
      static_cast<int*>(matrix_->i)[k] = entry.row;
      target_[entry.source] = static_cast<int>(k);
      for (const int vertex : {entry.a, entry.b})
        of_vertex_[static_cast<std::size_t>(vertex)].push_back(static_cast<int>(k));
    }
    for (int j = 0; j < rows_; ++j) begin[j + 1] += begin[j];
  }

  int rows_;
  std::vector<int> place_;                   // of each row in the order of elimination
  std::vector<int> target_;                  // of each entry of the BlockSymmetric
  std::vector<std::vector<int>> of_vertex_;  // entries in rows and columns of a vertex
  cholmod_common common_;
  cholmod_sparse* matrix_ = nullptr;
  cholmod_factor* factor_ = nullptr;
  cholmod_dense *right_ = nullptr, *solution_ = nullptr, *first_ = nullptr, *second_ = nullptr;
};

/// A sheet, its state and its hands.
struct Swing {
  Result<MassSpring<double>> model;
  Workspace workspace;
  ClothState<double> state;
  SwingingHands<double> hands;

  explicit Swing(int n)
      : model(pinned_sheet<double>(n, settings())),
        workspace(model.value().make_workspace()),
        state(model.value().rest_state()),
        hands(model.value()) {}

  static MassSpringSettings<double> settings() {
    MassSpringSettings<double> out;
    out.integration = Integration::LinearlyImplicit;
    out.limit_energy = false;
    return out;
  }
  Cholmod cholmod(Order order) const {
    return {workspace.matrix, order, model.value().network().rest_positions};
  }
  bool step() { return model.value().step(state, hands.next(), kStep, workspace).advanced; }
  bool step(Cholmod& cholmod) {
    const auto solve = [&](const auto& matrix, const auto& held, Lanes<double, 1>& x) {
      return cholmod.factorize(matrix, held) && cholmod.solve(x);
    };
    return detail::StepParts<double>::step(model.value(), state, hands.next(), kStep, workspace,
                                           solve);
  }
  /// Flops of a factorisation with the project's own factor: Σ c² over columns of c entries.
  double flops() const {
    const EliminationTree tree =
        nested_dissection<double>(workspace.matrix, model.value().network().rest_positions);
    double sum = 0.0;
    for (const detail::Front& front : detail::FrontLayout(workspace.matrix, tree, 1).fronts) {
      for (Index k = 0; k < front.pivots; ++k) {
        const double entries = static_cast<double>(front.pivots - k + front.border);
        sum += entries * entries;
      }
    }
    return sum;
  }
};

/// Median and 99th percentile of the steps of a run, in ms.
class StepTimes {
 public:
  explicit StepTimes(benchmark::State& bench) : bench_(bench) {
    times_.reserve(static_cast<std::size_t>(bench.max_iterations));
  }
  ~StepTimes() {
    if (times_.empty()) return;
    std::sort(times_.begin(), times_.end());
    bench_.counters["p50_ms"] = times_[times_.size() / 2];
    bench_.counters["p99_ms"] = times_[(times_.size() - 1) * 99 / 100];
  }
  StepTimes(const StepTimes&) = delete;
  StepTimes& operator=(const StepTimes&) = delete;

  template <class Step>
  bool measure(Step&& step) {
    const auto begin = std::chrono::steady_clock::now();
    const bool good = step();
    const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - begin;
    times_.push_back(time.count());
    return good;
  }

 private:
  benchmark::State& bench_;
  std::vector<double> times_;
};

/// Largest difference of positions (m) and velocities (m/s) that 40 frames leave between the two.
double difference(int n, Order order) {
  static std::map<std::pair<int, int>, double> known;
  const auto [place, is_new] = known.try_emplace({n, order}, 0.0);
  if (!is_new) return place->second;
  double& largest = place->second;
  Swing own(n), other(n);
  Cholmod cholmod = other.cholmod(order);
  for (int frame = 0; frame < 40; ++frame) {
    if (!own.step() || !other.step(cholmod)) return largest = 1.0;
    const auto x = (own.state.positions - other.state.positions).cwiseAbs();
    const auto v = (own.state.velocities - other.state.velocities).cwiseAbs();
    largest = (std::max)({largest, x.maxCoeff(), v.maxCoeff()});
  }
  return largest;
}

void count(benchmark::State& bench, double flops, double entries, bool rate) {
  using benchmark::Counter;
  bench.counters["Mflop"] = flops * 1e-6;
  bench.counters["MB"] = entries * 8e-6;
  if (rate) bench.counters["flops"] = Counter(flops, Counter::kIsIterationInvariantRate);
}

void step_own(benchmark::State& bench) {
  Swing swing(static_cast<int>(bench.range(0)));
  count(bench, swing.flops(), static_cast<double>(swing.workspace.factor.factor_entries()), false);
  StepTimes times(bench);
  for (auto _ : bench) {
    if (!times.measure([&] { return swing.step(); })) return bench.SkipWithError("step failed");
  }
}

void step_cholmod(benchmark::State& bench) {
  const int n = static_cast<int>(bench.range(0));
  const Order order = static_cast<Order>(bench.range(1));
  const double apart = difference(n, order);
  if (!(apart < 1e-9)) return bench.SkipWithError("the states differ");
  Swing swing(n);
  Cholmod cholmod = swing.cholmod(order);
  count(bench, cholmod.flops(), cholmod.entries(), false);
  bench.counters["apart"] = apart;
  StepTimes times(bench);
  for (auto _ : bench) {
    if (!times.measure([&] { return swing.step(cholmod); }))
      return bench.SkipWithError("step failed");
  }
}

void factor_own(benchmark::State& bench) {
  Swing swing(static_cast<int>(bench.range(0)));
  Workspace& ws = swing.workspace;
  if (!swing.step()) return bench.SkipWithError("step failed");
  for (auto _ : bench) benchmark::DoNotOptimize(ws.factor.factorize(ws.matrix, ws.held));
  count(bench, swing.flops(), static_cast<double>(ws.factor.factor_entries()), true);
}

void factor_cholmod(benchmark::State& bench) {
  Swing swing(static_cast<int>(bench.range(0)));
  Cholmod cholmod = swing.cholmod(static_cast<Order>(bench.range(1)));
  if (!swing.step()) return bench.SkipWithError("step failed");
  const Workspace& ws = swing.workspace;
  for (auto _ : bench) benchmark::DoNotOptimize(cholmod.factorize(ws.matrix, ws.held));
  count(bench, cholmod.flops(), cholmod.entries(), true);
}

/// A dense product, for the flops that one core reaches.
void dense_product(benchmark::State& bench) {
  const Index n = bench.range(0);
  const Eigen::MatrixXd a = Eigen::MatrixXd::Random(n, n), b = Eigen::MatrixXd::Random(n, n);
  Eigen::MatrixXd c = a;
  for (auto _ : bench) {
    c.noalias() = a * b;
    benchmark::DoNotOptimize(c.data());
  }
  const double flops =
      2.0 * static_cast<double>(n) * static_cast<double>(n) * static_cast<double>(n);
  bench.counters["flops"] =
      benchmark::Counter(flops, benchmark::Counter::kIsIterationInvariantRate);
}

// As many steps in all runs, so that all take the same frames; all threads count as CPU time.
void frames(benchmark::internal::Benchmark* bench) {
  bench->Iterations(30)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond);
}
void own(benchmark::internal::Benchmark* bench) {
  bench->ArgName("n")->Arg(33)->Arg(65)->Arg(129)->Apply(frames);
}
void orders(benchmark::internal::Benchmark* bench) {
  bench->ArgNames({"n", "order"})->ArgsProduct({{33, 65}, {kAmd, kMetis, kNesdis, kOurs}});
  bench->Args({129, kMetis})->Args({129, kOurs})->Apply(frames);
}

BENCHMARK(step_own)->Apply(own);
BENCHMARK(step_cholmod)->Apply(orders);
BENCHMARK(factor_own)->Apply(own);
BENCHMARK(factor_cholmod)->Apply(orders);
BENCHMARK(dense_product)->Arg(384)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond);

}  // namespace
