#include "clothctl/linalg/small_cholesky.hpp"

#include <cmath>
#include <random>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("small systems are solved from the lower triangle only", "[math]", float,
                   double) {
  using S = TestType;
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  for (const Index n : {1, 2, 3, 4, 7, 11, 12, 15, 16, 19, 23, 24, 34}) {
    MatrixX<S> B(n, n);
    for (Index k = 0; k < B.size(); ++k) B.data()[k] = static_cast<S>(normal(random));
    const MatrixX<S> A = B * B.transpose() + MatrixX<S>::Identity(n, n);
    const VectorX<S> x = VectorX<S>::LinSpaced(n, S(-1), S(2));
    SmallCholesky<S> small(40);
    small.resize(n);
    for (Index j = 0; j < n; ++j) {
      for (Index i = 0; i < SmallCholesky<S>::padded(n); ++i)
        small.column(j)[i] = i >= j && i < n ? A(i, j) : S(7);
    }
    VectorX<S> solution = A * x;
    const long before = clothctl_test::allocations();
    const Index failed = small.solve(solution);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    CHECK(failed == -1);
    CHECK((solution - x).norm() <= S(1e4) * scalar_traits<S>::epsilon() * x.norm());
  }
}

TEST_CASE("the index of the first pivot that is not positive is returned", "[math]") {
  SmallCholesky<double> small(3);
  small.resize(3);
  const auto fill = [&](double first, double last) {
    for (Index j = 0; j < 3; ++j) {
      for (Index i = j; i < 3; ++i) small(i, j) = i == j ? 1.0 : 0.0;
    }
    small(0, 0) = first;
    small(2, 2) = last;
  };
  VectorX<double> x = VectorX<double>::Ones(3);
  fill(1.0, -1.0);
  CHECK(small.solve(x) == 2);
  fill(std::nan(""), 1.0);
  CHECK(small.solve(x) == 0);
  CHECK(x == VectorX<double>::Ones(3));
  // A failure has no effect on the next matrix.
  fill(4.0, 1.0);
  CHECK(small.solve(x) == -1);
  CHECK(x == Vector3<double>(0.25, 1.0, 1.0));
}
