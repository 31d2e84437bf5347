// Condensing, compared with products of the large matrices that it avoids.

#include "clothctl/mpc/detail/condense.hpp"

#include <random>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class Scalar>
MatrixX<Scalar> random_matrix(Index rows, Index cols, std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  MatrixX<Scalar> m(rows, cols);
  for (Index i = 0; i < m.size(); ++i) m(i) = Scalar(uniform(random));
  return m;
}

}  // namespace

TEMPLATE_TEST_CASE("condensing gives the normal equations of the whole window", "[mpc]", float,
                   double) {
  std::mt19937 random(11);
  const TestType tolerance = std::is_same_v<TestType, float> ? TestType(1e-4) : TestType(1e-12);
  for (const Index horizon : {1, 2, 7, 20}) {
    for (const Index inputs : {3, 6}) {
      const Index rows = 3 * (1 + horizon % 4);
      const MatrixX<TestType> blocks = random_matrix<TestType>(rows, inputs * horizon, random);
      const MatrixX<TestType> residual = random_matrix<TestType>(rows, horizon, random);
      MatrixX<TestType> big = MatrixX<TestType>::Zero(rows * horizon, inputs * horizon);
      for (Index k = 0; k < horizon; ++k) {
        for (Index j = 0; j <= k; ++j)
          big.block(k * rows, j * inputs, rows, inputs) =
              blocks.middleCols((k - j) * inputs, inputs);
      }
      const VectorX<TestType> e =
          Eigen::Map<const VectorX<TestType>>(residual.data(), residual.size());
      MatrixX<TestType> hessian =
          MatrixX<TestType>::Constant(inputs * horizon, inputs * horizon, TestType(7));
      VectorX<TestType> gradient = VectorX<TestType>::Constant(inputs * horizon, TestType(7));
      const long before = clothctl_test::allocations();
      detail::condense<TestType>(blocks, residual, hessian, gradient);
      const long made = clothctl_test::allocations() - before;
      if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
      const MatrixX<TestType> expected = big.transpose() * big;
      CHECK((hessian - expected).norm() < tolerance * expected.norm());
      CHECK((gradient - big.transpose() * e).norm() < tolerance * gradient.norm());
      CHECK(hessian == MatrixX<TestType>(hessian.transpose()));
    }
  }
}

TEST_CASE("a window without rows condenses to zero", "[mpc]") {
  MatrixX<double> hessian = MatrixX<double>::Ones(12, 12);
  VectorX<double> gradient = VectorX<double>::Ones(12);
  detail::condense<double>(MatrixX<double>(0, 12), MatrixX<double>(0, 4), hessian, gradient);
  CHECK(hessian.norm() == 0.0);
  CHECK(gradient.norm() == 0.0);
}

TEST_CASE("a response that changes along the window is condensed as a large matrix", "[mpc]") {
  std::mt19937 random(12);
  for (const Index horizon : {1, 2, 7}) {
    for (const Index inputs : {3, 6}) {
      const Index rows = 6;
      MatrixX<double> J = random_matrix<double>(rows * horizon, inputs * horizon, random);
      for (Index k = 0; k < horizon; ++k)
        J.middleRows(rows * k, rows).rightCols(inputs * (horizon - k - 1)).setZero();
      const MatrixX<double> residual = random_matrix<double>(rows, horizon, random);
      MatrixX<double> hessian = random_matrix<double>(J.cols(), J.cols(), random);
      hessian = (hessian + hessian.transpose()).eval();
      VectorX<double> gradient = random_matrix<double>(J.cols(), 1, random);
      const MatrixX<double> expected = hessian + J.transpose() * J;
      const VectorX<double> slope = gradient + J.transpose() * residual.reshaped();
      const MatrixX<double> response = J.transpose();
      const long before = clothctl_test::allocations();
      detail::condense_jacobian<double>(response, residual, hessian, gradient);
      CHECK(
          (clothctl_test::allocations() == before || !clothctl_test::allocation_counting_works()));
      CHECK((hessian - expected).norm() < 1e-13 * expected.norm());
      CHECK((gradient - slope).norm() < 1e-13 * slope.norm());
    }
  }
}
