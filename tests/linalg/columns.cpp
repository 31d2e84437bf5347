#include "clothctl/linalg/columns.hpp"

#include <random>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class S>
MatrixX<S> drawn(Index rows, Index columns, double share, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  MatrixX<S> M(rows, columns);
  for (Index k = 0; k < M.size(); ++k)
    M.data()[k] = uniform(random) < share ? static_cast<S>(normal(random)) : S(0);
  return M;
}

}  // namespace

TEMPLATE_TEST_CASE("products by columns agree with the matrix, with and without lists of nonzeros",
                   "[qp]", float, double) {
  using S = TestType;
  std::mt19937 random(3);
  for (const double share : {0.0, 0.05, 0.2, 0.9}) {
    const MatrixX<S> M = drawn<S>(17, 23, share, random);
    Columns<S> columns;
    columns.reserve(17, 23);
    columns.list(M.data(), 17, 23);
    CHECK(columns.sparse() == (share < 0.5));
    CHECK(columns.rows() == 17);
    CHECK(columns.columns() == 23);
    const VectorX<S> x = drawn<S>(23, 1, 1.0, random);
    VectorX<S> out = VectorX<S>::Ones(20), size = out;
    const VectorX<S> v = drawn<S>(20, 1, 1.0, random);
    for (Index j = 0; j < 23; ++j) {
      const S terms = M.col(j).cwiseProduct(v.head(17)).cwiseAbs().sum();
      CHECK(std::abs(columns.size_of_dot(j, v) - terms) <=
            S(20) * scalar_traits<S>::epsilon() * terms);
      AccurateSum<S> sum;
      columns.add_dot(j, v, sum);
      CHECK(std::abs(sum.value() - M.col(j).dot(v.head(17))) <=
            S(20) * scalar_traits<S>::epsilon() * terms);
      columns.add(j, x[j], out);
      columns.add_size(j, x[j], size);
    }
    const S rounding = S(100) * scalar_traits<S>::epsilon();
    CHECK((out.head(17) - VectorX<S>::Ones(17) - M * x).norm() <= rounding * (S(5) + x.norm()));
    CHECK((size.head(17) - VectorX<S>::Ones(17) - M.cwiseAbs() * x.cwiseAbs()).norm() <=
          rounding * (S(20) + x.norm()));
    CHECK(out.tail(3) == VectorX<S>::Ones(3));
    CHECK(size.tail(3) == VectorX<S>::Ones(3));
  }
}

TEST_CASE("a quarter of nonzeros is listed, and one more is not", "[qp]") {
  Columns<double> columns;
  columns.reserve(4, 4);
  MatrixX<double> M = MatrixX<double>::Identity(4, 4);
  columns.list(M.data(), 4, 4);
  REQUIRE(columns.sparse());
  for (Index j = 0; j < 4; ++j) {
    REQUIRE(columns.start(j + 1) == columns.start(j) + 1);
    CHECK(columns.row(columns.start(j)) == j);
    CHECK(columns.value(columns.start(j)) == 1.0);
  }
  M(0, 3) = -1.0;
  columns.list(M.data(), 4, 4);
  CHECK_FALSE(columns.sparse());
  columns.view(M.data(), 4, 4);
  CHECK_FALSE(columns.sparse());
}

TEST_CASE("listing does not allocate within the reserved size", "[qp]") {
  Columns<double> columns;
  columns.reserve(30, 30);
  const MatrixX<double> M = MatrixX<double>::Identity(30, 20);
  const long before = clothctl_test::allocations();
  columns.list(M.data(), 30, 20);
  const long taken = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
  CHECK(columns.sparse());
}
