#include "clothctl/linalg/tiled_cholesky.hpp"

#include <random>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class S>
MatrixX<S> draw(Index rows, Index cols, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  MatrixX<S> M(rows, cols);
  for (Index k = 0; k < M.size(); ++k) M.data()[k] = static_cast<S>(normal(random));
  return M;
}

}  // namespace

TEMPLATE_TEST_CASE("tiled kernels agree with plain products at sizes around the tile size", "[qp]",
                   float, double) {
  using S = TestType;
  const S eps = scalar_traits<S>::epsilon();
  for (Index n : {Index(1), Index(63), Index(64), Index(65), Index(200)}) {
    const MatrixX<S> J = draw<S>(n + 20, n, 1), X = draw<S>(70, n, 2);
    MatrixX<S> A = J.transpose() * J;
    A.diagonal().array() += S(n);
    const MatrixX<S> original = A;
    const VectorX<S> scale = A.diagonal();
    REQUIRE(cholesky_in_place<S>(A, scale, S(0)) == n);
    const MatrixX<S> L = A.template triangularView<Eigen::Lower>();
    const S size = original.cwiseAbs().maxCoeff();
    CHECK((L * L.transpose() - original).cwiseAbs().maxCoeff() < S(20) * eps * size);
    MatrixX<S> Y = X;
    right_solve<S>(A, Y);
    CHECK((Y * L.transpose() - X).cwiseAbs().maxCoeff() < S(1000) * eps);
    MatrixX<S> C = MatrixX<S>::Ones(70, 70);
    subtract_outer<S>(C, X, Y);
    CHECK((C + X * Y.transpose() - MatrixX<S>::Ones(70, 70)).cwiseAbs().maxCoeff() < S(1000) * eps);
  }
}

TEST_CASE("factoring stops at the first pivot that is too small", "[qp]") {
  const Index n = 150, rank = 100;
  const MatrixX<double> J = draw<double>(rank, n, 3);
  MatrixX<double> A = J.transpose() * J;
  const VectorX<double> scale = A.diagonal();
  CHECK(cholesky_in_place<double>(A, scale, 1e-11) == rank);
}

TEST_CASE("large tiled factorisations do not allocate", "[qp]") {
  if (!clothctl_test::allocation_counting_works()) return;
  const Index n = 400;
  const MatrixX<double> J = draw<double>(n, n, 4);
  MatrixX<double> A = J.transpose() * J, X = draw<double>(n, n, 5);
  A.diagonal().array() += 1.0;
  const VectorX<double> scale = A.diagonal();
  const long before = clothctl_test::allocations();
  const Index good = cholesky_in_place<double>(A, scale, 0.0);
  right_solve<double>(A, X);
  CHECK(clothctl_test::allocations() == before);
  CHECK(good == n);
}
