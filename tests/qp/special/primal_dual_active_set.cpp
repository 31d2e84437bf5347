#include "clothctl/qp/detail/special/primal_dual_active_set.hpp"

#include <Eigen/Dense>
#include <limits>
#include <random>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

// Computes x and z for an active set by a dense solve.
struct DenseMinimiser {
  MatrixX<double> H;
  int calls = 0;
  bool able = true;

  template <class SideOf>
  bool minimise(const VectorX<double>& g, const VectorX<double>& lo, const VectorX<double>& hi,
                SideOf side_of, double, VectorX<double>& x, VectorX<double>& z) {
    ++calls;
    const Index n = H.rows();
    MatrixX<double> M = H;
    VectorX<double> right = -g.head(n);
    for (Index i = 0; i < n; ++i) {
      if (side_of(i) == QpSide::Between) continue;
      M.row(i).setZero();
      M(i, i) = 1.0;
      right[i] = side_of(i) == QpSide::Lower ? lo[i] : hi[i];
    }
    x.head(n) = M.partialPivLu().solve(right);
    z.head(n) = H * x.head(n) + g.head(n);
    return able;
  }
};

detail::Budget rounds(int most) {
  QpSettings<double> settings;
  settings.max_iterations = most;
  return detail::Budget(settings, 1);
}

}  // namespace

TEST_CASE("rounds that converge give the minimiser, from any active set", "[qp]") {
  std::mt19937 random(6);
  std::normal_distribution<double> normal;
  int ended = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Index n = 1 + trial % 12;
    MatrixX<double> J(n, n);
    for (Index k = 0; k < J.size(); ++k) J.data()[k] = normal(random);
    DenseMinimiser minimiser{J.transpose() * J + 0.5 * MatrixX<double>::Identity(n, n)};
    VectorX<double> g(n + 2), lo(n + 2), hi(n + 2);  // longer than the number of unknowns
    for (Index i = 0; i < n + 2; ++i) {
      g[i] = 3.0 * normal(random);
      lo[i] = -std::abs(normal(random));
      hi[i] = i % 5 == 4 ? lo[i] : std::abs(normal(random));
    }
    detail::PrimalDualActiveSet<double> rounds_of;
    rounds_of.reserve(n + 2);
    const unsigned guess = static_cast<unsigned>(random());
    const auto side_of = [&](Index i) {
      return !(lo[i] < hi[i])
                 ? QpSide::Lower
                 : static_cast<QpSide>(static_cast<int>(guess >> (2 * i) & 3u) % 3 - 1);
    };
    int iterations = 0;
    REQUIRE(rounds_of.find(minimiser, n, g, lo, hi, side_of, 1e-12, rounds(1000), iterations));
    CHECK(iterations <= minimiser.calls);
    const VectorX<double> x = rounds_of.x().head(n), q = minimiser.H * x + g.head(n);
    for (Index i = 0; i < n; ++i) {
      CHECK(x[i] >= lo[i]);
      CHECK(x[i] <= hi[i]);
    }
    if (!rounds_of.ended()) continue;
    ++ended;
    CHECK(iterations == minimiser.calls - 1);
    for (Index i = 0; i < n; ++i) {
      if (x[i] > lo[i]) CHECK(q[i] < 1e-9);
      if (x[i] < hi[i]) CHECK(q[i] > -1e-9);
      const QpSide side = rounds_of.side(i);
      if (!(lo[i] < hi[i])) CHECK(side != QpSide::Between);  // fixed unknowns stay active
      if (lo[i] < hi[i]) CHECK((side == QpSide::Between) == (x[i] > lo[i] && x[i] < hi[i]));
    }
    int again = 0;
    const auto same = [&](Index i) { return rounds_of.side(i); };
    detail::PrimalDualActiveSet<double> second = rounds_of;
    REQUIRE(second.find(minimiser, n, g, lo, hi, same, 1e-12, rounds(1000), again));
    CHECK(again == 0);
  }
  CHECK(ended > 180);
}

TEST_CASE("rounds that cycle, reach their limit or fail return", "[qp]") {
  // Three unknowns that push each other out in a circle: with this asymmetric matrix the rounds
  // cycle.
  DenseMinimiser circle{MatrixX<double>::Identity(3, 3)};
  circle.H << 1.0, 4.0, 0.0, 0.0, 1.0, 4.0, 4.0, 0.0, 1.0;
  const VectorX<double> g = VectorX<double>::Constant(3, -1.0), lo = VectorX<double>::Zero(3),
                        hi = VectorX<double>::Constant(3, 1e3);
  detail::PrimalDualActiveSet<double> rounds_of;
  rounds_of.reserve(3);
  const auto first = [](Index i) { return i == 0 ? QpSide::Between : QpSide::Lower; };
  int iterations = 0;
  CHECK(rounds_of.find(circle, 3, g, lo, hi, first, 1e-12, rounds(1000), iterations));
  CHECK_FALSE(rounds_of.ended());
  CHECK(circle.calls < 8);
  CHECK(rounds_of.x().minCoeff() >= 0.0);

  iterations = 0;
  circle.calls = 0;
  CHECK(rounds_of.find(circle, 3, g, lo, hi, first, 1e-12, rounds(1), iterations));
  CHECK(circle.calls == 1);
  CHECK(iterations == 1);

  circle.able = false;
  CHECK_FALSE(rounds_of.find(circle, 3, g, lo, hi, first, 1e-12, rounds(1000), iterations));
  circle.able = true;
  circle.H.setConstant(std::numeric_limits<double>::quiet_NaN());
  CHECK_FALSE(rounds_of.find(circle, 3, g, lo, hi, first, 1e-12, rounds(1000),
                             iterations));  // a number became infinite or NaN
}
