#include "clothctl/qp/detail/proximal_matrices.hpp"

#include "support/catch.hpp"

using namespace clothctl;

namespace {

detail::ProximalMatrices<double> sample(Index n, Index m) {
  detail::ProximalMatrices<double> matrices;
  matrices.reserve(n + 2, m + 1);
  matrices.resize(n, m);
  for (Index j = 0; j < n; ++j) {
    matrices.H()(j, j) = static_cast<double>(j) - 1;
    for (Index i = 0; i < m; ++i)
      matrices.A()(i, j) = (i + 2 * j) % 3 == 0 ? static_cast<double>(1 + i - j) : 0.0;
  }
  matrices.refresh_transpose();
  return matrices;
}

}  // namespace

TEST_CASE("the transpose of the rows is that of the rows", "[qp]") {
  for (const Index n : {1, 7, 8, 19}) {
    const auto matrices = sample(n, 5);
    REQUIRE((matrices.At().rows() == n && matrices.At().cols() == 5));
    CHECK(matrices.At() == matrices.A().transpose());
  }
}

TEST_CASE("a diagonal that is negative by rounding has the root 0", "[qp]") {
  const auto matrices = sample(12, 2);
  CHECK(matrices.root_of_diagonal(0) == 0);
  CHECK(matrices.root_of_diagonal(5) == 2);
}

TEST_CASE("only matrices that are not small are listed, and products are the same", "[qp]") {
  CHECK_FALSE(sample(30, 9).list());
  auto matrices = sample(30, 10);
  VectorX<double> viewed = VectorX<double>::Zero(10), listed = viewed, copied = viewed;
  matrices.attach();
  const VectorX<double> x = VectorX<double>::LinSpaced(30, 1, 30);
  for (Index j = 0; j < 30; ++j) matrices.columns_of_A().add(j, x[j], viewed);
  CHECK(matrices.list());
  for (Index j = 0; j < 30; ++j) matrices.columns_of_A().add(j, x[j], listed);
  CHECK((listed - matrices.A() * x).norm() < 1e-12);
  CHECK((viewed - listed).norm() < 1e-12);
  // A copy has its own numbers once it is attached.
  auto copy = matrices;
  copy.attach();
  matrices.A().setZero();
  for (Index j = 0; j < 30; ++j) copy.columns_of_A().add(j, x[j], copied);
  CHECK(copied == listed);
}
