#include "clothctl/linalg/updatable_cholesky.hpp"

#include <random>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl::UpdatableCholesky;

namespace {

template <class S>
MatrixX<S> random_hessian(Index n, Index rank, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  MatrixX<double> J(rank, n);
  for (Index k = 0; k < J.size(); ++k) J.data()[k] = normal(random);
  MatrixX<double> H = J.transpose() * J;
  if (rank >= n) H.diagonal().array() += 1.0;
  return H.cast<S>();
}

// Largest difference between L Lᵀ and the submatrix of the factor's set.
template <class S>
S factor_error(const UpdatableCholesky<S>& factor, const MatrixX<S>& H, S shift) {
  const Index f = factor.size();
  MatrixX<S> wanted(f, f);
  for (Index a = 0; a < f; ++a) {
    for (Index b = 0; b < f; ++b) wanted(a, b) = H(factor.order(a), factor.order(b));
    wanted(a, a) += shift;
    CHECK(factor.place(factor.order(a)) == a);
  }
  const MatrixX<S> L = MatrixX<S>(factor.lower()).template triangularView<Eigen::Lower>();
  return (L * L.transpose() - wanted).cwiseAbs().maxCoeff() / wanted.cwiseAbs().maxCoeff();
}

}  // namespace

TEMPLATE_TEST_CASE("appending and removing in any order keeps L Lᵀ = H_FF + s I", "[qp]", float,
                   double) {
  using S = TestType;
  const Index n = 90;
  const MatrixX<S> H = random_hessian<S>(n, 2 * n, 3);
  const S shift(0.25), tolerance = S(200) * scalar_traits<S>::epsilon();
  UpdatableCholesky<S> factor;
  factor.reserve(n);
  std::mt19937 random(4);
  const bool counting = clothctl_test::allocation_counting_works();
  const long before = clothctl_test::allocations();
  long spent = 0;
  for (int change = 0; change < 600; ++change) {
    const Index i = static_cast<Index>(random() % static_cast<unsigned>(n));
    const Index k = factor.place(i);
    if (k < 0) {
      REQUIRE(factor.append(H, i, shift, tolerance));
    } else {
      factor.remove(k);
      REQUIRE(factor.place(i) == -1);
    }
    spent = clothctl_test::allocations() - before;
    if (change == 20 && counting) CHECK(spent == 0);
  }
  CHECK(factor.size() > 20);
  CHECK(factor_error(factor, H, shift) < tolerance);
}

TEMPLATE_TEST_CASE("rebuilding in tiles gives the factor of the new set and solves with it", "[qp]",
                   float, double) {
  using S = TestType;
  const Index n = 200;
  const MatrixX<S> H = random_hessian<S>(n, 2 * n, 5);
  UpdatableCholesky<S> factor;
  factor.reserve(n);
  for (Index count : {Index(0), Index(1), Index(63), Index(64), Index(65), Index(150)}) {
    std::vector<Index> wanted;
    for (Index k = 0; k < count; ++k) wanted.push_back((k * 7 + 3) % n);
    wanted.resize(static_cast<std::size_t>(n));
    factor.rebuild(H, wanted, count, S(0), S(0));
    REQUIRE(factor.size() == count);
    if (count == 0) continue;
    CHECK(factor_error(factor, H, S(0)) < S(200) * scalar_traits<S>::epsilon());
    VectorX<S> v = VectorX<S>::Ones(n), product = VectorX<S>::Zero(n);
    factor.solve_lower(v);
    factor.solve_upper(v);
    for (Index a = 0; a < count; ++a) {
      for (Index b = 0; b < count; ++b) product[a] += H(factor.order(a), factor.order(b)) * v[b];
    }
    CHECK((product.head(count).array() - S(1)).abs().maxCoeff() <
          S(2e4) * scalar_traits<S>::epsilon());
  }
}

TEST_CASE("dependent unknowns are refused, and negative curvature shows in the pivot", "[qp]") {
  const Index n = 100, rank = 70;
  const MatrixX<double> H = random_hessian<double>(n, rank, 6);
  UpdatableCholesky<double> factor;
  factor.reserve(n);
  std::vector<Index> wanted(static_cast<std::size_t>(n));
  for (Index k = 0; k < n; ++k) wanted[static_cast<std::size_t>(k)] = k;
  factor.rebuild(H, wanted, n, 0.0, 1e-11);
  CHECK(factor.size() == rank);
  CHECK(factor_error(factor, H, 0.0) < 1e-12);
  MatrixX<double> saddle = MatrixX<double>::Identity(2, 2);
  saddle(0, 1) = saddle(1, 0) = 2.0;
  factor.clear();
  CHECK(factor.append(saddle, 0, 0.0, 1e-12));
  CHECK_FALSE(factor.append(saddle, 1, 0.0, 1e-12));
  CHECK(factor.pivot() == Approx(-3.0));
}
