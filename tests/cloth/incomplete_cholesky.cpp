// The incomplete factor: exact without fill, positive definite always, held vertices, refusals, and
// what it does for conjugate gradients.

#include "clothctl/cloth/detail/incomplete_cholesky.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "clothctl/cloth/detail/conjugate_gradient.hpp"
#include "support/allocations.hpp"
#include "support/block_matrices.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using namespace clothctl_test;

namespace {

using Row = Lanes<double, 1>;

std::vector<unsigned char> none_held(const BlockSymmetric<double>& matrix) {
  return std::vector<unsigned char>(static_cast<std::size_t>(matrix.rows()), 0);
}

// P⁻¹ as a dense matrix.
Eigen::MatrixXd inverse_of(const IncompleteCholesky<double>& factor, Index rows) {
  Eigen::MatrixXd out(3 * rows, 3 * rows);
  for (Index k = 0; k < 3 * rows; ++k) {
    Row x = Row::Zero(1, 3 * rows);
    x[k] = 1.0;
    factor.solve(x);
    out.col(k) = x.transpose();
  }
  return out;
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

// L D Lᵀ without fill and without compensation; empty where a pivot block is not definite.
Eigen::MatrixXd plain_product(const BlockSymmetric<double>& matrix) {
  const Index n = matrix.rows();
  Eigen::MatrixXd u = dense(matrix);
  Eigen::MatrixXd l = Eigen::MatrixXd::Identity(3 * n, 3 * n), d = l;
  for (Index k = 0; k < n; ++k) {
    const Eigen::Matrix3d pivot = u.block<3, 3>(3 * k, 3 * k);
    for (int c = 0; c < 3; ++c) {
      if (pivot.topLeftCorner(c + 1, c + 1).determinant() <= 0.0) return {};
    }
    d.block<3, 3>(3 * k, 3 * k) = pivot;
    for (Index i = k + 1; i < n; ++i)
      l.block<3, 3>(3 * i, 3 * k) = u.block<3, 3>(3 * i, 3 * k) * pivot.inverse();
    for (Index i = k + 1; i < n; ++i) {
      for (Index j = k + 1; j < n; ++j) {
        if (i == j || 0 <= matrix.find(static_cast<int>(i), static_cast<int>(j)))
          u.block<3, 3>(3 * i, 3 * j) -=
              l.block<3, 3>(3 * i, 3 * k) * u.block<3, 3>(3 * j, 3 * k).transpose();
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

TEST_CASE("the incomplete factor is the plain one where that exists, and definite elsewhere",
          "[cloth]") {
  std::mt19937 random(2);
  int plain = 0, compensated = 0;
  for (int trial = 0; trial < 14; ++trial) {
    const BlockSymmetric<double> matrix = stiff_matrix(std::pow(10.0, 2.0 + 0.3 * trial), random);
    IncompleteCholesky<double> factor(matrix);
    REQUIRE(factor.factorize(matrix, none_held(matrix)));
    const Eigen::MatrixXd inverse = inverse_of(factor, 144);
    CHECK((inverse - inverse.transpose()).norm() <= 1e-10 * inverse.norm());
    CHECK(Eigen::LLT<Eigen::MatrixXd>(inverse).info() == Eigen::Success);
    const Eigen::MatrixXd product = plain_product(matrix);
    if (product.size() > 0) {
      const double error = (inverse * product - Eigen::MatrixXd::Identity(432, 432)).norm();
      if (error < 1e-6) ++plain;
    } else {
      ++compensated;
    }
  }
  CAPTURE(plain, compensated);
  CHECK(plain >= 3);
  CHECK(compensated >= 3);
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
