// Step matrices of sheets: BlockCholesky compared with Eigen's SimplicialLLT and, where CMake finds
// it, with CHOLMOD's supernodal factor for the same matrix. CHOLMOD is as fast as the BLAS that it
// finds: try OpenBLAS too.

#include <benchmark/benchmark.h>

#include <Eigen/SparseCholesky>
#include <random>
#include <utility>
#include <vector>

#include "clothctl/linalg/block_cholesky.hpp"
#include "clothctl/linalg/nested_dissection.hpp"

#if defined(CLOTHCTL_CHOLMOD)
#include <suitesparse/cholmod.h>
#endif

namespace {

using namespace clothctl;

/// An n×n sheet with structural and shear couplings, and with bending couplings (next but one) if
/// `bending`. Stiffnesses are random.
template <class Scalar>
struct Sheet {
  Points<Scalar> positions;
  BlockSymmetric<Scalar> matrix;

  Sheet(int n, bool bending) : positions(3, n * n) {
    std::vector<std::pair<int, int>> pairs;
    const std::pair<int, int> steps[] = {{1, 0}, {0, 1}, {1, 1}, {1, -1}, {2, 0}, {0, 2}};
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) {
        positions.col(i * n + j) << Scalar(j) / Scalar(n), Scalar(0), Scalar(-i) / Scalar(n);
        for (int s = 0; s < (bending ? 6 : 4); ++s) {
          const int a = i + steps[s].first, b = j + steps[s].second;
          if (a < n && b >= 0 && b < n) pairs.push_back({i * n + j, a * n + b});
        }
      }
    }
    matrix = BlockSymmetric<Scalar>(n * n, pairs);
    std::mt19937 random(1);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    for (Index i = 0; i < matrix.rows(); ++i)
      matrix.diagonal(i) = Scalar(0.01) * Matrix3<Scalar>::Identity();
    for (Index i = 0; i < matrix.rows(); ++i) {
      for (int s = matrix.row_begin(i); s < matrix.row_begin(i + 1); ++s) {
        const Vector3<Scalar> d(Scalar(uniform(random)), Scalar(uniform(random)),
                                Scalar(uniform(random)));
        const Matrix3<Scalar> stiffness =
            d * d.transpose() + Scalar(0.05) * Matrix3<Scalar>::Identity();
        matrix.lower(s) = -stiffness;
        matrix.diagonal(i) += stiffness;
        matrix.diagonal(matrix.column(s)) += stiffness;
      }
    }
  }

  Eigen::SparseMatrix<Scalar> sparse() const {
    std::vector<Eigen::Triplet<Scalar>> triplets;
    const auto add = [&](Index i, Index j, const Matrix3<Scalar>& block) {
      for (Index c = 0; c < 3; ++c) {
        for (Index r = 0; r < 3; ++r) {
          triplets.emplace_back(static_cast<int>(3 * i + r), static_cast<int>(3 * j + c),
                                block(r, c));
        }
      }
    };
    for (Index i = 0; i < matrix.rows(); ++i) {
      add(i, i, matrix.diagonal(i));
      for (int s = matrix.row_begin(i); s < matrix.row_begin(i + 1); ++s)
        add(i, matrix.column(s), matrix.lower(s));
    }
    Eigen::SparseMatrix<Scalar> full(3 * matrix.rows(), 3 * matrix.rows());
    full.setFromTriplets(triplets.begin(), triplets.end());
    return full;
  }
};

template <class Scalar>
void factorize_own(benchmark::State& state) {
  const Sheet<Scalar> sheet(static_cast<int>(state.range(0)), state.range(1) != 0);
  BlockCholesky<Scalar> factor(sheet.matrix,
                               nested_dissection<Scalar>(sheet.matrix, sheet.positions));
  for (auto _ : state) benchmark::DoNotOptimize(factor.factorize(sheet.matrix));
  state.counters["entries"] = static_cast<double>(factor.factor_entries());
}

template <class Scalar>
void factorize_eigen(benchmark::State& state) {
  const Sheet<Scalar> sheet(static_cast<int>(state.range(0)), state.range(1) != 0);
  const Eigen::SparseMatrix<Scalar> matrix = sheet.sparse();
  Eigen::SimplicialLLT<Eigen::SparseMatrix<Scalar>> factor;
  factor.analyzePattern(matrix);
  for (auto _ : state) {
    factor.factorize(matrix);
    benchmark::DoNotOptimize(factor.info());
  }
}

template <class Scalar, int kLanes>
void solve_own(benchmark::State& state) {
  const Sheet<Scalar> sheet(static_cast<int>(state.range(0)), state.range(1) != 0);
  BlockCholesky<Scalar> factor(sheet.matrix,
                               nested_dissection<Scalar>(sheet.matrix, sheet.positions));
  if (!factor.factorize(sheet.matrix)) state.SkipWithError("not positive definite");
  const Lanes<Scalar, kLanes> b = Lanes<Scalar, kLanes>::Random(kLanes, 3 * sheet.matrix.rows());
  Lanes<Scalar, kLanes> x = b;
  for (auto _ : state) {
    x = b;
    factor.template solve<kLanes>(x);
    benchmark::DoNotOptimize(x.data());
  }
}

/// The rows and columns of the inverse of a square of vertices at a corner.
template <class Scalar>
void inverse_block(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0)), count = static_cast<int>(state.range(1));
  const Sheet<Scalar> sheet(n, true);
  BlockCholesky<Scalar> factor(sheet.matrix,
                               nested_dissection<Scalar>(sheet.matrix, sheet.positions));
  if (!factor.factorize(sheet.matrix)) state.SkipWithError("not positive definite");
  int side = 1;
  while (side * side < count) ++side;
  std::vector<int> vertices;
  for (int i = 0; i < count; ++i) vertices.push_back(i / side * n + i % side);
  auto memory = factor.make_inverse_block_memory(count);
  MatrixX<Scalar> block(3 * count, 3 * count);
  for (auto _ : state) benchmark::DoNotOptimize(factor.inverse_block(vertices, memory, block));
}

template <class Scalar, int kLanes>
void solve_eigen(benchmark::State& state) {
  const Sheet<Scalar> sheet(static_cast<int>(state.range(0)), state.range(1) != 0);
  const Eigen::SimplicialLLT<Eigen::SparseMatrix<Scalar>> factor(sheet.sparse());
  using Block = Eigen::Matrix<Scalar, Eigen::Dynamic, kLanes,
                              kLanes == 1 ? Eigen::ColMajor : Eigen::RowMajor>;
  const Block b = Block::Random(3 * sheet.matrix.rows(), kLanes);
  Block x = b;
  for (auto _ : state) {
    x = factor.solve(b);
    benchmark::DoNotOptimize(x.data());
  }
}

#if defined(CLOTHCTL_CHOLMOD)
/// The matrix of a sheet, its supernodal factor and one right-hand side, in CHOLMOD.
struct Cholmod {
  cholmod_common common;
  cholmod_sparse* matrix = nullptr;
  cholmod_factor* factor = nullptr;
  cholmod_dense *right = nullptr, *solution = nullptr, *first = nullptr, *second = nullptr;

  explicit Cholmod(const Sheet<double>& sheet) {
    cholmod_start(&common);
    common.supernodal = CHOLMOD_SUPERNODAL;
    const Eigen::SparseMatrix<double> full = sheet.sparse();
    const std::size_t n = static_cast<std::size_t>(full.rows());
    cholmod_triplet* entries = cholmod_allocate_triplet(
        n, n, static_cast<std::size_t>(full.nonZeros()), -1, CHOLMOD_REAL, &common);
    for (int column = 0; column < full.cols(); ++column) {
      for (Eigen::SparseMatrix<double>::InnerIterator it(full, column); it; ++it) {
        if (it.row() < it.col()) continue;
        static_cast<int*>(entries->i)[entries->nnz] = static_cast<int>(it.row());
        static_cast<int*>(entries->j)[entries->nnz] = column;
        static_cast<double*>(entries->x)[entries->nnz++] = it.value();
      }
    }
    matrix = cholmod_triplet_to_sparse(entries, 0, &common);
    cholmod_free_triplet(&entries, &common);
    factor = cholmod_analyze(matrix, &common);
    right = cholmod_ones(n, 1, CHOLMOD_REAL, &common);
  }
  Cholmod(const Cholmod&) = delete;
  Cholmod& operator=(const Cholmod&) = delete;
  ~Cholmod() {
    for (cholmod_dense** dense : {&right, &solution, &first, &second})
      cholmod_free_dense(dense, &common);
    cholmod_free_factor(&factor, &common);
    cholmod_free_sparse(&matrix, &common);
    cholmod_finish(&common);
  }
  bool factorize() { return cholmod_factorize(matrix, factor, &common) != 0; }
  void solve() {
    cholmod_solve2(CHOLMOD_A, factor, right, nullptr, &solution, nullptr, &first, &second, &common);
  }
};

void factorize_cholmod(benchmark::State& state) {
  const Sheet<double> sheet(static_cast<int>(state.range(0)), state.range(1) != 0);
  Cholmod cholmod(sheet);
  for (auto _ : state) benchmark::DoNotOptimize(cholmod.factorize());
  state.counters["entries"] = cholmod.common.lnz;
}

void solve_cholmod(benchmark::State& state) {
  const Sheet<double> sheet(static_cast<int>(state.range(0)), state.range(1) != 0);
  Cholmod cholmod(sheet);
  if (!cholmod.factorize()) state.SkipWithError("not positive definite");
  for (auto _ : state) cholmod.solve();
}
#endif

template <class Scalar>
void multiply_own(benchmark::State& state) {
  const Sheet<Scalar> sheet(static_cast<int>(state.range(0)), state.range(1) != 0);
  const Lanes<Scalar, 16> x = Lanes<Scalar, 16>::Random(16, 3 * sheet.matrix.rows());
  Lanes<Scalar, 16> y = x;
  for (auto _ : state) {
    sheet.matrix.multiply(x, y);
    benchmark::DoNotOptimize(y.data());
  }
}

template <class Scalar>
void order_and_analyse(benchmark::State& state) {
  const Sheet<Scalar> sheet(static_cast<int>(state.range(0)), state.range(1) != 0);
  for (auto _ : state) {
    BlockCholesky<Scalar> factor(sheet.matrix,
                                 nested_dissection<Scalar>(sheet.matrix, sheet.positions));
    benchmark::DoNotOptimize(factor.factor_entries());
  }
}

void grids(benchmark::internal::Benchmark* bench) {
  bench->ArgNames({"n", "bending"})
      ->ArgsProduct({{17, 33, 65}, {0, 1}})
      ->Unit(benchmark::kMillisecond);
}

BENCHMARK(factorize_own<float>)->Apply(grids);
BENCHMARK(factorize_own<double>)->Apply(grids);
BENCHMARK(factorize_eigen<float>)->Apply(grids);
BENCHMARK(factorize_eigen<double>)->Apply(grids);
BENCHMARK(solve_own<float, 1>)->Apply(grids);
BENCHMARK(solve_own<float, 4>)->Apply(grids);
BENCHMARK(solve_own<float, 16>)->Apply(grids);
BENCHMARK(solve_eigen<float, 1>)->Apply(grids);
BENCHMARK(solve_eigen<float, 16>)->Apply(grids);
BENCHMARK(solve_own<double, 1>)->Apply(grids);
BENCHMARK(solve_own<double, 8>)->Apply(grids);
BENCHMARK(solve_own<double, 16>)->Apply(grids);
BENCHMARK(solve_eigen<double, 1>)->Apply(grids);
BENCHMARK(solve_eigen<double, 16>)->Apply(grids);
BENCHMARK(inverse_block<float>)
    ->ArgsProduct({{33, 65}, {4, 9, 24, 48}})
    ->Unit(benchmark::kMillisecond);
BENCHMARK(inverse_block<double>)
    ->ArgsProduct({{33, 65}, {4, 9, 24, 48}})
    ->Unit(benchmark::kMillisecond);
BENCHMARK(multiply_own<float>)->Apply(grids);
BENCHMARK(order_and_analyse<float>)->Apply(grids);
#if defined(CLOTHCTL_CHOLMOD)
BENCHMARK(factorize_cholmod)->Apply(grids);
BENCHMARK(solve_cholmod)->Apply(grids);
#endif

}  // namespace
