// The incomplete factor: exact without fill, positive definite always, held vertices, refusals, and
// what it does for conjugate gradients.

#include "clothctl/cloth/detail/incomplete_cholesky.hpp"

#include <limits>
#include <random>

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

TEST_CASE("the incomplete factor is symmetric and positive definite, even where pivots fail",
          "[cloth]") {
  std::mt19937 random(2);
  for (int trial = 0; trial < 20; ++trial) {
    BlockSymmetric<double> matrix = random_spd<double>(sheet_graph(4, 5, true), random);
    // Couplings that are too strong for the diagonal: the exact factor does not exist.
    if (trial % 2 == 1) {
      for (Index slot = 0; slot < matrix.lower_count(); ++slot) matrix.lower(slot) *= 3.0;
    }
    IncompleteCholesky<double> factor(matrix);
    REQUIRE(factor.factorize(matrix, none_held(matrix)));
    const Eigen::MatrixXd inverse = inverse_of(factor, 20);
    CHECK((inverse - inverse.transpose()).norm() <= 1e-10 * inverse.norm());
    for (int k = 0; k < 50; ++k) {
      const Eigen::VectorXd x =
          Eigen::VectorXd::NullaryExpr(60, [&] { return double(random()) / 4294967296.0 - 0.5; });
      CHECK(x.dot(inverse * x) > 0.0);
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
