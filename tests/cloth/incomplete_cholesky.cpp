// The incomplete factor: exact without fill, beside a dense reference with compensation, held
// vertices, refusals, and what it does for conjugate gradients.

#include "clothctl/cloth/detail/incomplete_cholesky.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "clothctl/cloth/detail/conjugate_gradient.hpp"
#include "support/allocations.hpp"
#include "support/block_matrices.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using namespace clothctl_test;

namespace {

using Row = Lanes<double, 1>;

// P⁻¹ as a dense matrix.
Eigen::MatrixXd inverse_of(const IncompleteCholesky<double>& factor, Index rows) {
  return dense_map(rows, [&](Row& x) { factor.solve(x); });
}

// A step matrix in small: unit masses, and the springs of a slightly crumpled sheet whose vertices
// have a scattered order.
BlockSymmetric<double> stiff_matrix(double stiffness, std::mt19937& random) {
  Graph graph = sheet_graph(12, 12, true);
  std::vector<int> number(144);
  std::iota(number.begin(), number.end(), 0);
  std::shuffle(number.begin(), number.end(), random);
  BlockSymmetric<double> matrix(144, [&] {
    auto pairs = graph.pairs;
    for (auto& [i, j] : pairs) {
      i = number[static_cast<std::size_t>(i)];
      j = number[static_cast<std::size_t>(j)];
    }
    return pairs;
  }());
  for (double& x : graph.positions.reshaped()) x += 0.02 * (double(random()) / 4294967296.0 - 0.5);
  for (Index i = 0; i < 144; ++i) matrix.diagonal(i).setIdentity();
  for (const auto& [a, b] : graph.pairs) {
    const int i = number[static_cast<std::size_t>(a)], j = number[static_cast<std::size_t>(b)];
    const Eigen::Vector3d along = (graph.positions.col(a) - graph.positions.col(b)).normalized();
    const Eigen::Matrix3d spring = stiffness * along * along.transpose();
    matrix.diagonal(i) += spring;
    matrix.diagonal(j) += spring;
    matrix.lower(matrix.find(i, j)) -= spring;
  }
  return matrix;
}

// L D Lᵀ with what is left out compensated by the rule of the header, pair by pair; empty where a
// pivot block is not clearly definite.
Eigen::MatrixXd reference(const BlockSymmetric<double>& matrix, double alpha) {
  const Index n = matrix.rows();
  const auto block = [](Eigen::MatrixXd& m, Index i, Index j) {
    return m.block<3, 3>(3 * i, 3 * j);
  };
  Eigen::MatrixXd u = dense(matrix);
  Eigen::MatrixXd l = Eigen::MatrixXd::Identity(3 * n, 3 * n), d = l;
  for (Index k = 0; k < n; ++k) {
    const Eigen::Matrix3d pivot = block(u, k, k);
    for (int c = 0; c < 3; ++c) {
      // The c-th pivot of the block, by determinants.
      const double size = matrix.diagonal(k)(c, c);
      const double above = c == 0 ? 1.0 : pivot.topLeftCorner(c, c).determinant();
      if (pivot.topLeftCorner(c + 1, c + 1).determinant() <= 1e-9 * size * above) return {};
    }
    block(d, k, k) = pivot;
    for (Index i = k + 1; i < n; ++i) block(l, i, k) = block(u, i, k) * pivot.inverse();
    for (Index i = k + 1; i < n; ++i) {
      const Eigen::Matrix3d ui = block(u, i, k), li = block(l, i, k);
      const double size = ui.cwiseAbs().sum();
      if (size == 0.0) continue;
      block(u, i, i) -= ui * li.transpose();
      for (Index j = k + 1; j < n; ++j) {
        const Eigen::Matrix3d lj = block(l, j, k);
        const double other = Eigen::Matrix3d(block(u, j, k)).cwiseAbs().sum();
        if (i == j || other == 0.0) continue;
        if (0 <= matrix.find(static_cast<int>(i), static_cast<int>(j)))
          block(u, i, j) -= ui * lj.transpose();
        else
          block(u, i, i) += alpha * other / size * ui * li.transpose();
      }
    }
  }
  return l * d * l.transpose();
}

}  // namespace

TEST_CASE("the incomplete factor of a chain, which has no fill, is exact", "[cloth]") {
  std::mt19937 random(1);
  const BlockSymmetric<double> matrix = random_spd<double>(sheet_graph(1, 9, false), random);
  IncompleteCholesky<double> factor(matrix);
  std::vector<unsigned char> held = none_held(matrix);
  held[3] = 1;
  const long before = allocations();
  REQUIRE(factor.factorize(matrix, held));
  Row x = Row::Constant(1, 27, 0.5);
  factor.solve(x);
  const long made = allocations() - before;
  if (allocation_counting_works()) CHECK(made == 1);  // the row x
  Eigen::MatrixXd a = dense(matrix);
  a.middleRows<3>(9).setZero();
  a.middleCols<3>(9).setZero();
  a.block<3, 3>(9, 9).setIdentity();
  CHECK((inverse_of(factor, 9) * a - Eigen::MatrixXd::Identity(27, 27)).norm() <= 1e-11);
}

TEST_CASE("the incomplete factor has the least compensation with which it exists", "[cloth]") {
  std::mt19937 random(2);
  int with[2] = {0, 0};  // without compensation, and with some
  const int every = clothctl_test::kSanitized ? 3 : 1, least = clothctl_test::kSanitized ? 1 : 3;
  for (int trial = 0; trial < 14; trial += every) {
    const BlockSymmetric<double> matrix = stiff_matrix(std::pow(10.0, 2.0 + 0.3 * trial), random);
    IncompleteCholesky<double> factor(matrix);
    REQUIRE(factor.factorize(matrix, none_held(matrix)));
    const double alpha = factor.compensation();
    const Eigen::MatrixXd inverse = inverse_of(factor, 144);
    CHECK((inverse - inverse.transpose()).norm() <= 1e-10 * inverse.norm());
    CHECK(Eigen::LLT<Eigen::MatrixXd>(inverse).info() == Eigen::Success);
    for (const double tried : {0.0, 0.02, 0.1, 0.3, 1.0}) {
      const Eigen::MatrixXd product = reference(matrix, tried);
      if (product.size() == 0) continue;
      CAPTURE(trial, alpha, tried);
      CHECK(alpha <= tried);
      if (alpha < tried) continue;
      CHECK((inverse * product - Eigen::MatrixXd::Identity(432, 432)).norm() <= 1e-5);
      ++with[0.0 < alpha ? 1 : 0];
    }
  }
  CHECK(with[0] >= least);
  CHECK(with[1] >= least);
}

TEST_CASE("with each compensation the incomplete factor is the dense reference", "[cloth]") {
  std::mt19937 random(5);
  for (const double stiffness : {1e2, 1e3, 1e4}) {
    const BlockSymmetric<double> matrix = stiff_matrix(stiffness, random);
    IncompleteCholesky<double> factor(matrix);
    for (const double alpha : {0.02, 0.1, 0.3, 1.0}) {
      const Eigen::MatrixXd product = reference(matrix, alpha);
      if (alpha == 1.0) REQUIRE(product.size() > 0);
      if (product.size() == 0) continue;
      CAPTURE(stiffness, alpha);
      REQUIRE(factor.factorize(matrix, none_held(matrix), alpha));
      CHECK(factor.compensation() == alpha);
      const Eigen::MatrixXd inverse = inverse_of(factor, 144);
      CHECK((inverse * product - Eigen::MatrixXd::Identity(432, 432)).norm() <= 1e-5);
      if (alpha < 1.0) continue;
      // P - A is positive semidefinite, which is why full compensation cannot fail.
      const Eigen::MatrixXd a = dense(matrix), more = product - a;
      const Eigen::VectorXd values =
          Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(more).eigenvalues();
      CHECK(values[0] >= -1e-9 * a.norm());
      CHECK(values[431] > 1e-3 * stiffness);
    }
  }
}

TEST_CASE("the incomplete factor saves most iterations of conjugate gradients", "[cloth]") {
  std::mt19937 random(3);
  const BlockSymmetric<double> matrix = random_spd<double>(sheet_graph(20, 20, false), random);
  const std::vector<unsigned char> held = none_held(matrix);
  IncompleteCholesky<double> factor(matrix);
  REQUIRE(factor.factorize(matrix, held));
  ConjugateGradientMemory<double> memory;
  memory.reserve(400);
  const Row right = Row::Ones(1, 1200);
  const VectorX<double> mass = VectorX<double>::Ones(400);
  const ConjugateGradientLimits<double> limits{0.0, 1e-8, 2000};
  const auto iterations = [&](auto apply) {
    const ConjugateGradientReport report =
        conjugate_gradient<double>(matrix, right, mass, held, limits, apply, memory);
    CHECK(report.converged);
    return report.iterations;
  };
  const int plain = iterations([](const Row& r, Row& z) { z = r; });
  const int better = iterations([&](const Row& r, Row& z) {
    z = r;
    factor.solve(z);
  });
  CHECK(3 * better < plain);
}

TEST_CASE("a diagonal block that is not positive definite or not finite is refused", "[cloth]") {
  std::mt19937 random(4);
  for (const double bad : {-1.0, 0.0, std::numeric_limits<double>::quiet_NaN(),
                           std::numeric_limits<double>::infinity()}) {
    BlockSymmetric<double> matrix = random_spd<double>(sheet_graph(2, 3, false), random);
    matrix.diagonal(4)(1, 1) = bad;
    IncompleteCholesky<double> factor(matrix);
    std::vector<unsigned char> held = none_held(matrix);
    CHECK_FALSE(factor.factorize(matrix, held));
    held[4] = 1;
    CHECK(factor.factorize(matrix, held));
  }
}

TEST_CASE("numbers that are not finite are refused wherever they stand", "[cloth]") {
  std::mt19937 random(6);
  const BlockSymmetric<double> good = random_spd<double>(sheet_graph(2, 3, false), random);
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (Index entry = 0; entry < 9; ++entry) {
      BlockSymmetric<double> matrix = good;
      matrix.diagonal(4).data()[entry] = bad;
      IncompleteCholesky<double> factor(matrix);
      CHECK_FALSE(factor.factorize(matrix, none_held(matrix)));
      matrix = good;
      matrix.lower(3).data()[entry] = bad;
      CHECK_FALSE(factor.factorize(matrix, none_held(matrix)));
    }
  }
}
