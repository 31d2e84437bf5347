#include "clothctl/qp/detail/kkt_factor.hpp"

#include <random>

#include "qp/listed_matrices.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ListedMatrices;

TEST_CASE(
    "the sparse factor is chosen for sparse matrices only, and both factors give the same steps",
    "[qp]") {
  std::mt19937 random(21);
  std::normal_distribution<double> normal;
  const Index n = 90, m = 40;
  for (const bool sparse : {true, false}) {
    MatrixX<double> H = MatrixX<double>::Zero(n, n), A = MatrixX<double>::Zero(m, n);
    for (Index i = 0; i < n; ++i) {
      H(i, i) = 2.0;
      if (i > 0) H(i, i - 1) = H(i - 1, i) = -0.9;
    }
    for (Index i = 0; i < m; ++i) {
      for (Index j = 2 * i; j < (sparse ? 2 * i + 3 : n); ++j) A(i, j) = normal(random);
    }
    const ListedMatrices<double> q(H, A);
    detail::KktFactor<double> chosen, dense;
    chosen.reserve(n, m);
    dense.reserve(n, m);
    chosen.choose(q.h, q.a, q.at);
    CHECK(chosen.sparse() == sparse);
    CHECK_FALSE(dense.sparse());
    const auto is_free = [](Index i) { return i % 5 != 1; };
    const auto is_active = [](Index i) { return i % 3 != 0; };
    const VectorX<double> r1 = VectorX<double>::LinSpaced(n, -1.0, 2.0),
                          r2 = VectorX<double>::LinSpaced(m, 1.0, -1.0);
    VectorX<double> p[2], delta[2];
    int which = 0;
    for (detail::KktFactor<double>* factor : {&chosen, &dense}) {
      bool changed = false;
      REQUIRE(factor->sync(q.H, q.At, 1e-3, 1e-2, is_free, is_active, changed));
      CHECK(changed);
      CHECK(factor->free_size() == 72);
      CHECK(factor->row_size() == 26);
      for (Index k = 0; k < factor->free_size(); ++k) REQUIRE(is_free(factor->unknown(k)));
      for (Index k = 0; k < factor->row_size(); ++k) REQUIRE(is_active(factor->row(k)));
      p[which] = VectorX<double>::Zero(n);
      delta[which] = VectorX<double>::Zero(m);
      factor->solve(r1, r2, p[which], delta[which]);
      ++which;
      factor->touch();
      REQUIRE(factor->sync(q.H, q.At, 1e-3, 1e-1, is_free, is_active, changed));
      CHECK_FALSE(changed);
    }
    CHECK((p[0] - p[1]).norm() < 1e-10 * p[1].norm());
    CHECK((delta[0] - delta[1]).norm() < 1e-10 * delta[1].norm());
    chosen.reset();
    CHECK_FALSE(chosen.sparse());
  }
}

TEST_CASE("both factors report where a failure occurred", "[qp]") {
  const Index n = 60;
  MatrixX<double> H = MatrixX<double>::Identity(n, n);
  H(3, 3) = -1.0;
  const ListedMatrices<double> q(H, MatrixX<double>(0, n));
  for (const bool sparse : {true, false}) {
    detail::KktFactor<double> factor;
    factor.reserve(n, 0);
    if (sparse) factor.choose(q.h, q.a, q.at);
    CHECK(factor.sparse() == sparse);
    bool changed = false;
    const auto all = [](Index) { return true; };
    CHECK_FALSE(factor.sync(q.H, q.At, 1e-3, 1.0, all, all, changed));
    CHECK(factor.free_failed());
    CHECK_FALSE(factor.sparse());  // with doubt from rounding, the dense factor is used
    factor.clear();
    CHECK(factor.sync(q.H, q.At, 2.0, 1.0, all, all, changed));
  }
}
