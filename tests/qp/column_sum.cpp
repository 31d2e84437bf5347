#include "clothctl/qp/column_sum.hpp"

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("a column sum is the product with the weights, whatever their number and zeros", "[qp]", float, double) {
  using S = TestType;
  const MatrixX<S> M = MatrixX<S>::Random(9, 20);
  for (Index count = 0; count <= 20; ++count) {
    VectorX<S> w = VectorX<S>::Random(20);
    for (Index i = 0; i < 20; ++i) {
      if (i >= count || i % 5 == 3) w[i] = S(0);
    }
    VectorX<S> sum = VectorX<S>::Ones(12);
    const long before = clothctl_test::allocations();
    detail::ColumnSum<S> columns(M, sum.head(9));
    for (Index i = 0; i < 20; ++i) columns.add((7 * i) % 20, w[(7 * i) % 20]);
    columns.finish();
    columns.finish();  // nothing is added twice
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    CHECK((sum.head(9) - VectorX<S>::Ones(9) - M * w).cwiseAbs().maxCoeff() < S(50) * scalar_traits<S>::epsilon());
    CHECK(sum.tail(3) == VectorX<S>::Ones(3));
  }
}
