#include "clothctl/linalg/sparse_ldlt.hpp"

#include <limits>
#include <random>
#include <utility>
#include <vector>

#include "qp/listed_matrices.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ListedMatrices;

namespace {

template <class S>
ListedMatrices<S> drawn_matrices(Index n, Index m, std::mt19937& random) {
  std::normal_distribution<double> normal;
  const auto scatter = [&](auto&& entries) {  // three entries
    for (int k = 0; k < 3; ++k)
      entries[static_cast<Index>(random() % static_cast<unsigned>(n))] =
          static_cast<S>(normal(random));
  };
  MatrixX<S> H = MatrixX<S>::Zero(n, n), A = MatrixX<S>::Zero(m, n);
  for (Index i = 0; i < n;
       ++i) {  // sums of squares of three entries each, and some unknowns without curvature
    VectorX<S> v = VectorX<S>::Zero(n);
    scatter(v);
    if (i % 2 == 0) H += v * v.transpose();
  }
  for (Index i = 0; i < m; ++i) scatter(A.row(i));
  if (m > 3) A.row(3) = A.row(2);  // a repeated row
  return {std::move(H), std::move(A)};
}

template <class S>
VectorX<S> drawn(Index size, std::mt19937& random) {
  std::normal_distribution<double> normal;
  VectorX<S> v(size);
  for (Index k = 0; k < size; ++k) v[k] = static_cast<S>(normal(random));
  return v;
}

}  // namespace

TEMPLATE_TEST_CASE("the sparse factor solves the regularised optimality system on changing sets",
                   "[qp]", float, double) {
  using S = TestType;
  std::mt19937 random(8);
  for (const Index m : {Index(0), Index(35)}) {
    const Index n = 60;
    const ListedMatrices<S> q = drawn_matrices<S>(n, m, random);
    REQUIRE(q.h.sparse());
    SparseLdlt<S> factor;
    factor.reserve(n + 5, m + 2);
    REQUIRE(factor.analyse(q.h, q.a, q.at, 1e18));
    CHECK(factor.work() > 0);
    std::vector<bool> free(static_cast<std::size_t>(n)), active(static_cast<std::size_t>(m));
    S mu = S(1e-2);
    for (int round = 0; round < 60; ++round) {
      const int changes = round < 5 ? 30 : round % 3;
      for (int k = 0; k < changes; ++k) free[random() % free.size()].flip();
      for (int k = 0; k < 2 && m > 0; ++k) active[random() % active.size()].flip();
      if (round == 30) factor.clear();
      if (round == 40) {
        mu = S(1e-3);
        factor.touch();
      }
      const S rho = S(1e-2);
      const auto is_free = [&](Index i) { return bool(free[static_cast<std::size_t>(i)]); };
      const auto is_active = [&](Index i) { return bool(active[static_cast<std::size_t>(i)]); };
      bool changed = false;
      REQUIRE(factor.sync(rho, mu, is_free, is_active, changed));
      const VectorX<S> r1 = drawn<S>(n, random), r2 = drawn<S>(m, random);
      VectorX<S> p = VectorX<S>::Zero(n), delta = VectorX<S>::Zero(m);
      factor.solve(r1, r2, p, delta);
      const VectorX<S> first = q.H * p + rho * p - q.At * delta + r1;
      const VectorX<S> second = q.A * p + mu * delta + r2;
      S worst(0);
      Index frees = 0, actives = 0;
      for (Index i = 0; i < n; ++i) {
        REQUIRE(factor.has_unknown(i) == is_free(i));
        if (!is_free(i)) {
          REQUIRE(p[i] == S(0));
          continue;
        }
        REQUIRE(factor.unknown(frees++) == i);
        worst = std::max(worst, std::abs(first[i]));
      }
      for (Index i = 0; i < m; ++i) {
        REQUIRE(factor.has_row(i) == is_active(i));
        if (!is_active(i)) {
          REQUIRE(delta[i] == S(0));
          continue;
        }
        REQUIRE(factor.row(actives++) == i);
        worst = std::max(worst, std::abs(second[i]));
      }
      REQUIRE(factor.free_size() == frees);
      REQUIRE(factor.row_size() == actives);
      const S size = S(1) + p.cwiseAbs().sum() + (m > 0 ? S(delta.cwiseAbs().sum()) : S(0));
      CHECK(worst < S(1e3) * scalar_traits<S>::epsilon() * size / S(1e-2));
      bool again = true;
      REQUIRE(factor.sync(rho, mu, is_free, is_active, again));
      CHECK_FALSE(again);
    }
  }
}

TEST_CASE("columns with the same structure are eliminated together with the same result", "[qp]") {
  // One row with all unknowns couples all of them, so that all columns have the same structure.
  for (const Index n : {Index(2), Index(3), Index(4), Index(5), Index(9), Index(14)}) {
    MatrixX<double> H = MatrixX<double>::Zero(4 * n, 4 * n), A = MatrixX<double>::Zero(4, 4 * n);
    for (Index i = 0; i < 4 * n; ++i) H(i, i) = 1.0 + 0.1 * static_cast<double>(i);
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < n; ++j) H(i, j) += 0.3 / (1.0 + static_cast<double>(std::abs(i - j)));
    }
    for (Index i = 0; i < 4; ++i) A(i, i * n) = 1.0;
    const ListedMatrices<double> q(H, A);
    SparseLdlt<double> factor;
    factor.reserve(4 * n, 4);
    REQUIRE(factor.analyse(q.h, q.a, q.at, 1e18));
    bool changed = false;
    REQUIRE(factor.sync(
        1e-3, 1e-2, [](Index) { return true; }, [](Index i) { return i != 2; }, changed));
    VectorX<double> r1 = VectorX<double>::LinSpaced(4 * n, -1.0, 1.0),
                    r2 = VectorX<double>::Ones(4);
    VectorX<double> p(4 * n), delta = VectorX<double>::Zero(4);
    factor.solve(r1, r2, p, delta);
    CHECK((H * p + 1e-3 * p - q.At * delta + r1).norm() < 1e-12);
    const VectorX<double> second = A * p + 1e-2 * delta + r2;
    for (Index i : {0, 1, 3}) CHECK(std::abs(second[i]) < 1e-12);
  }
}

TEST_CASE("negative curvature and numbers that are not finite are reported with their place",
          "[qp]") {
  std::mt19937 random(4);
  ListedMatrices<double> q = drawn_matrices<double>(50, 20, random);
  const auto all = [](Index) { return true; };
  SparseLdlt<double> factor;
  factor.reserve(50, 20);
  bool changed = false;
  q.H(7, 7) = -5.0;
  q.A.col(7).setZero();
  q.list();
  REQUIRE(factor.analyse(q.h, q.a, q.at, 1e18));
  CHECK_FALSE(factor.sync(1e-3, 1e-2, all, all, changed));
  CHECK(factor.free_failed());
  factor.clear();
  CHECK(factor.sync(10.0, 1e-2, all, all, changed));  // a large enough weight makes it definite
  factor.touch();
  CHECK_FALSE(factor.sync(10.0, std::numeric_limits<double>::quiet_NaN(), all, all, changed));
  factor.clear();
  CHECK(factor.sync(10.0, 1e-2, all, all, changed));
}

TEST_CASE("sparse factors refuse what costs too much, and neither analyse nor sync allocates",
          "[qp]") {
  std::mt19937 random(5);
  const ListedMatrices<double> q = drawn_matrices<double>(80, 30, random);
  SparseLdlt<double> factor;
  factor.reserve(80, 30);
  const long before = clothctl_test::allocations();
  const bool good = factor.analyse(q.h, q.a, q.at, 1e18);
  bool changed = false;
  const bool made = factor.sync(
      1e-3, 1e-2, [](Index) { return true; }, [](Index) { return true; }, changed);
  const long taken = clothctl_test::allocations() - before;
  REQUIRE(good);
  REQUIRE(made);
  if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
  CHECK_FALSE(factor.analyse(q.h, q.a, q.at, factor.work() / 2));
}
