#include "clothctl/linalg/row_factor.hpp"

#include <random>

#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("the row factor solves the regularised optimality system on changing sets",
                   "[qp]", float, double) {
  using S = TestType;
  const Index n = 40, m = 25;
  std::mt19937 random(8);
  std::normal_distribution<double> normal;
  const auto draw = [&](Index r, Index c) {
    MatrixX<S> M(r, c);
    for (Index k = 0; k < M.size(); ++k) M.data()[k] = static_cast<S>(normal(random));
    return M;
  };
  const MatrixX<S> J = draw(2 * n, n), A = draw(m, n), At = A.transpose();
  const MatrixX<S> H = J.transpose() * J / S(n);
  const S rho = S(1e-3), mu = S(1e-2);
  RowFactor<S> factor;
  factor.reserve(n, m);
  std::vector<bool> free(static_cast<std::size_t>(n)), active(static_cast<std::size_t>(m));
  for (int round = 0; round < 30; ++round) {
    // First many changes, then single ones, then changes of rows only.
    const int changes = round < 5 ? 20 : round < 15 ? 1 : 0;
    for (int k = 0; k < changes; ++k) free[random() % free.size()].flip();
    for (int k = 0; k < 3; ++k) active[random() % active.size()].flip();
    bool changed = false;
    REQUIRE(factor.sync(
        H, At, rho, mu, [&](Index i) { return bool(free[static_cast<std::size_t>(i)]); },
        [&](Index i) { return bool(active[static_cast<std::size_t>(i)]); }, changed));
    const VectorX<S> r1 = draw(n, 1), r2 = draw(m, 1);
    VectorX<S> p = VectorX<S>::Zero(n), delta = VectorX<S>::Zero(m);
    factor.solve(r1, r2, p, delta);
    const VectorX<S> first = H * p + rho * p - At * delta + r1;
    const VectorX<S> second = A * p + mu * delta + r2;
    S worst(0);
    for (Index i = 0; i < n; ++i) {
      REQUIRE(factor.has_unknown(i) == free[static_cast<std::size_t>(i)]);
      if (free[static_cast<std::size_t>(i)]) worst = std::max(worst, std::abs(first[i]));
    }
    for (Index i = 0; i < m; ++i) {
      REQUIRE(factor.has_row(i) == active[static_cast<std::size_t>(i)]);
      if (active[static_cast<std::size_t>(i)]) worst = std::max(worst, std::abs(second[i]));
    }
    // Both equations hold, to rounding times the size of the terms.
    const S size = S(1) + p.cwiseAbs().maxCoeff() + S(n) * delta.cwiseAbs().maxCoeff();
    CHECK(worst < S(5e3) * scalar_traits<S>::epsilon() * size);
    bool again = true;
    REQUIRE(factor.sync(
        H, At, rho, mu, [&](Index i) { return bool(free[static_cast<std::size_t>(i)]); },
        [&](Index i) { return bool(active[static_cast<std::size_t>(i)]); }, again));
    CHECK_FALSE(again);
  }
}
