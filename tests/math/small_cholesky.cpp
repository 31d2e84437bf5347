#include "clothctl/math/small_cholesky.hpp"

#include <cmath>
#include <random>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("small systems are solved from the lower triangle alone", "[math]", float, double) {
  using S = TestType;
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  for (const Index n : {1, 2, 7, 34}) {
    MatrixX<S> B(n, n);
    for (Index k = 0; k < B.size(); ++k) B.data()[k] = static_cast<S>(normal(random));
    const MatrixX<S> A = B * B.transpose() + MatrixX<S>::Identity(n, n);
    const VectorX<S> x = VectorX<S>::LinSpaced(n, S(-1), S(2));
    MatrixX<S> L = A;
    L.template triangularView<Eigen::StrictlyUpper>().setConstant(S(7));
    VectorX<S> solution = A * x;
    const long before = clothctl_test::allocations();
    const Index failed = detail::factor_small<S>(L);
    detail::solve_small<S>(L, solution);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    CHECK(failed == -1);
    CHECK((solution - x).norm() <= S(1e4) * scalar_traits<S>::epsilon() * x.norm());
    if (n > 1) CHECK(L(0, n - 1) == S(7));
  }
}

TEST_CASE("the first pivot that is not positive is named", "[math]") {
  MatrixX<double> A = MatrixX<double>::Identity(3, 3);
  A(2, 2) = -1.0;
  CHECK(detail::factor_small<double>(A) == 2);
  A(0, 0) = std::nan("");
  CHECK(detail::factor_small<double>(A) == 0);
}
