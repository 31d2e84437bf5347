// Elimination with row exchanges: random systems, hidden pivots, singular matrices.

#include "clothctl/contact/detail/pivoted_lu.hpp"

#include <Eigen/Dense>
#include <limits>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;

namespace {

template <class S>
MatrixX<S> random_matrix(Index n, clothctl_test::Numbers& random) {
  MatrixX<S> A(n, n);
  for (Index i = 0; i < A.size(); ++i) A(i) = static_cast<S>(random(-1, 1));
  return A;
}

}  // namespace

TEMPLATE_TEST_CASE("systems of every size are solved", "[contact]", float, double) {
  using S = TestType;
  clothctl_test::Numbers random(1);
  detail::PivotedLu<S> lu;
  lu.reserve(40);
  for (Index n = 0; n <= 40; ++n) {
    MatrixX<S> A = random_matrix<S>(n, random);
    if (n > 2) A(0, 0) = A(1, 1) = S(0);  // needs exchanges
    VectorX<S> x = VectorX<S>::Ones(40);
    lu.resize(n);
    lu.matrix() = A;
    const long before = clothctl_test::allocations();
    const bool solved = lu.solve(x);
    const long made = clothctl_test::allocations() - before;
    REQUIRE(solved);
    if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
    const VectorX<S> off = A * x.head(n) - VectorX<S>::Ones(n);
    CHECK(off.norm() <= S(1e4) * scalar_traits<S>::epsilon() * (S(1) + x.head(n).norm()));
    CHECK(x.tail(40 - n) == VectorX<S>::Ones(40 - n));
  }
}

TEST_CASE("singular and bad matrices are reported", "[contact]") {
  clothctl_test::Numbers random(2);
  detail::PivotedLu<double> lu;
  lu.reserve(12);
  lu.resize(12);
  VectorX<double> x = VectorX<double>::Ones(12);
  MatrixX<double> A = random_matrix<double>(12, random);
  A.col(10).setZero();
  lu.matrix() = A;
  CHECK_FALSE(lu.solve(x));
  A.col(10).setConstant(std::numeric_limits<double>::quiet_NaN());
  lu.matrix() = A;
  CHECK_FALSE(lu.solve(x));
}
