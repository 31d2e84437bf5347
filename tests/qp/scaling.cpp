#include "clothctl/qp/detail/scaling.hpp"

#include <random>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("the largest weighted magnitude is found at every place and for every count", "[qp]") {
  const double ones[] = {1.0, 1.0, 1.0, 1.0, 1.0};
  for (Index count = 1; count <= 5; ++count) {
    for (Index place = 0; place < count; ++place) {
      double values[] = {0.5, -0.5, 0.25, -0.25, 0.5};
      values[place] = -3.0;
      CHECK(detail::largest_product(count, values, ones) == 3.0);
    }
  }
  CHECK(detail::largest_product(Index(0), ones, ones) == 0.0);
}

TEMPLATE_TEST_CASE("equilibration undoes scales of columns and rows by exact powers of two", "[qp]",
                   float, double) {
  using S = TestType;
  const Index n = 12, m = 7;
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  MatrixX<double> J(n, n), B(m, n);
  for (Index k = 0; k < J.size(); ++k) J.data()[k] = normal(random);
  for (Index k = 0; k < B.size(); ++k) B.data()[k] = normal(random);
  VectorX<double> s(n), t(m);
  for (Index j = 0; j < n; ++j) s[j] = std::pow(2.0, 2.0 * normal(random));
  for (Index i = 0; i < m; ++i) t[i] = std::pow(2.0, 2.0 * normal(random));
  const MatrixX<S> H0 = (s.asDiagonal() * (J.transpose() * J) * s.asDiagonal()).cast<S>();
  const MatrixX<S> A0 = (t.asDiagonal() * B * s.asDiagonal()).cast<S>();
  MatrixX<S> H = H0, A = A0;
  VectorX<S> D(n), E(m);
  detail::equilibrate<S>(H, A, D, E);
  for (Index j = 0; j < n; ++j) {
    int exponent = 0;
    CHECK(std::frexp(D[j], &exponent) == S(0.5));
    const S largest = std::max(H.col(j).cwiseAbs().maxCoeff(), A.col(j).cwiseAbs().maxCoeff());
    CHECK(largest > S(0.1));
    CHECK(largest < S(10));
  }
  for (Index i = 0; i < m; ++i) {
    int exponent = 0;
    CHECK(std::frexp(E[i], &exponent) == S(0.5));
    CHECK(A.row(i).cwiseAbs().maxCoeff() > S(0.6));
    CHECK(A.row(i).cwiseAbs().maxCoeff() < S(1.5));
  }
  // Exact: unscaling returns the same bits.
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < n; ++i) CHECK(H(i, j) / (D[i] * D[j]) == H0(i, j));
    for (Index i = 0; i < m; ++i) CHECK(A(i, j) / (E[i] * D[j]) == A0(i, j));
  }
}

TEST_CASE("empty columns and rows are not scaled", "[qp]") {
  MatrixX<double> H = MatrixX<double>::Zero(3, 3), A = MatrixX<double>::Zero(2, 3);
  H(0, 0) = 4.0;
  A(0, 1) = 8.0;
  VectorX<double> D(3), E(2);
  detail::equilibrate<double>(H, A, D, E);
  CHECK(D[2] == 1.0);
  CHECK(E[1] == 1.0);
  CHECK(H(0, 0) == Approx(1.0).margin(0.5));
  CHECK(A(0, 1) == Approx(1.0).margin(0.5));
}
