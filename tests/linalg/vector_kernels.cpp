#include "clothctl/linalg/vector_kernels.hpp"

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE(
    "a column sum is the product with the weights, for any number of weights and zeros", "[linalg]",
    float, double) {
  using S = TestType;
  const MatrixX<S> M = MatrixX<S>::Random(9, 20);
  for (Index count = 0; count <= 20; ++count) {
    VectorX<S> w = VectorX<S>::Random(20);
    for (Index i = 0; i < 20; ++i) {
      if (i >= count || i % 5 == 3) w[i] = S(0);
    }
    VectorX<S> sum = VectorX<S>::Ones(12);
    const long before = clothctl_test::allocations();
    ColumnSum<S> columns(M.data(), M.outerStride(), 9, sum.data());
    for (Index i = 0; i < 20; ++i) columns.add((7 * i) % 20, w[(7 * i) % 20]);
    columns.finish();
    columns.finish();  // a second call adds nothing
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    CHECK((sum.head(9) - VectorX<S>::Ones(9) - M * w).cwiseAbs().maxCoeff() <
          S(50) * scalar_traits<S>::epsilon());
    CHECK(sum.tail(3) == VectorX<S>::Ones(3));
  }
}

TEMPLATE_TEST_CASE("kernels agree with Eigen for every length and write nothing beyond it",
                   "[linalg]", float, double) {
  using S = TestType;
  const S tolerance = S(100) * scalar_traits<S>::epsilon();
  for (Index n = 0; n <= 40; ++n) {
    const MatrixX<S> M = MatrixX<S>::Random(n + 1, 4);
    const VectorX<S> start = VectorX<S>::Random(n + 1);
    const std::array<const S*, 4> columns = {&M(0, 0), &M(0, 1), &M(0, 2), &M(0, 3)};
    const auto error = [&](const VectorX<S>& got, const VectorX<S>& wanted) {
      CHECK(got[n] == start[n]);
      return n > 0 ? (got - wanted).head(n).cwiseAbs().maxCoeff() : S(0);
    };
    VectorX<S> y = start;
    add_scaled(n, S(0.5), columns[0], y.data());
    CHECK(error(y, start + S(0.5) * M.col(0)) <= tolerance);
    y = start;
    add_four<S>(n, {S(1), S(-2), S(3), S(0.25)}, columns, y.data());
    CHECK(error(y, start + M * Eigen::Matrix<S, 4, 1>(S(1), S(-2), S(3), S(0.25))) <= tolerance);
    y = start;
    scale_by(n, S(3), y.data());
    CHECK(error(y, S(3) * start) <= tolerance);
    VectorX<S> x = M.col(0);
    y = start;
    apply_rotation(n, S(0.6), S(0.8), x.data(), y.data());
    CHECK(error(y, S(0.6) * start - S(0.8) * M.col(0)) <= tolerance);
    CHECK(x[n] == M(n, 0));
    if (n > 0) CHECK((x - S(0.6) * M.col(0) - S(0.8) * start).head(n).norm() <= S(9) * tolerance);
    const std::array<S, 4> products = dot_four(n, columns, start.data());
    for (Index k = 0; k < 4; ++k) {
      const S wanted = M.col(k).head(n).dot(start.head(n));
      const S size = S(1) + start.norm();
      CHECK(std::abs(products[static_cast<std::size_t>(k)] - wanted) <= tolerance * size);
      CHECK(std::abs(dot_product(n, &M(0, k), start.data()) - wanted) <= tolerance * size);
    }
  }
}
