// Woodbury solves, rank-one changes and walks of D + NᵀN, compared with the dense matrix.

#include "clothctl/qp/detail/special/low_rank_curvature.hpp"

#include <Eigen/Dense>

#include "clothctl/qp/detail/special/active_bounds.hpp"
#include "clothctl/qp/detail/special/primal_dual_active_set.hpp"
#include "qp/curvatures.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::FactoredHessian;

TEMPLATE_TEST_CASE(
    "a rank-one change gives the factor of the changed matrix, or reports that there is none",
    "[qp][low_rank]", float, double) {
  using S = TestType;
  const S tolerance = S(200) * scalar_traits<S>::epsilon();
  for (const Index n : {1, 2, 7, 40}) {
    const MatrixX<S> B = MatrixX<S>::Random(n, n);
    const MatrixX<S> A = B * B.transpose() + MatrixX<S>::Identity(n, n);
    const VectorX<S> v = VectorX<S>::Random(n);
    MatrixX<S> L = Eigen::LLT<MatrixX<S>>(A).matrixL();
    VectorX<S> d = L.diagonal().array().square();
    for (Index j = 0; j < n; ++j) L.col(j) /= S(L(j, j));
    const auto product = [&] {
      const MatrixX<S> lower = L.template triangularView<Eigen::UnitLower>();
      return MatrixX<S>(lower * d.asDiagonal() * lower.transpose());
    };
    VectorX<S> work = v;
    REQUIRE(detail::rank_one_change<S>(L, d, work, S(0.7)));
    CHECK((product() - A - S(0.7) * v * v.transpose()).norm() < tolerance * A.norm());
    work = v;
    REQUIRE(detail::rank_one_change<S>(L, d, work, S(-0.7)));
    CHECK((product() - A).norm() < S(20) * tolerance * A.norm());
    work = S(100) * v;
    CHECK_FALSE(detail::rank_one_change<S>(L, d, work, S(-1)));
  }
}

TEST_CASE("Newton steps and products agree with the dense matrix after any changes of the free set",
          "[qp][low_rank]") {
  const Index n = 60, r = 9;
  const FactoredHessian<double> given(n, r, 3);
  const MatrixX<double> H = given.dense();
  detail::LowRankCurvature<double> curvature;
  curvature.reserve(n + 5, r + 3);
  given.fill(curvature);
  CHECK(curvature.unknowns() == n);
  for (Index i = 0; i < n; ++i) REQUIRE(curvature.diagonal(i) == Approx(H(i, i)));
  std::mt19937 random(4);
  const VectorX<double> q = VectorX<double>::Random(n), x = VectorX<double>::Random(n);
  VectorX<double> p = VectorX<double>::Zero(n);
  double worst = 0;
  std::vector<Index> wanted(static_cast<std::size_t>(n));
  long inside = 0;
  for (int step = 0; step < 400; ++step) {
    const Index i = static_cast<Index>(random() % static_cast<unsigned>(n));
    const long start = clothctl_test::allocations();
    if (step % 97 == 96) {
      Index count = 0;
      for (Index k = 0; k < n; k += 3) wanted[static_cast<std::size_t>(count++)] = (7 * k) % n;
      curvature.renew(wanted, count);
    } else if (curvature.place(i) >= 0) {
      curvature.remove(curvature.place(i));
    } else {
      curvature.append(i);
    }
    p.setZero();
    curvature.newton(q, p);
    inside += clothctl_test::allocations() - start;
    for (Index k = 0; k < curvature.size(); ++k) REQUIRE(curvature.place(curvature.order(k)) == k);
    const VectorX<double> back = H * p + q;  // zero on the free set
    for (Index k = 0; k < curvature.size(); ++k)
      worst = std::max(worst, std::abs(back[curvature.order(k)]));
  }
  CHECK(worst < 1e-10);
  VectorX<double> product = q;
  curvature.add_product(x, product);
  CHECK((product - q - H * x).norm() < 1e-12 * (H * x).norm());
  if (clothctl_test::allocation_counting_works()) CHECK(inside == 0);
}

TEST_CASE("on changing active sets, the low-rank minimiser solves the optimality equations",
          "[qp][low_rank]") {
  const Index n = 50, r = 8;
  const FactoredHessian<double> given(n, r, 21);
  const MatrixX<double> H = given.dense();
  detail::LowRankCurvature<double> curvature;
  curvature.reserve(n + 2, r + 1);
  given.fill(curvature);
  std::mt19937 random(5);
  const VectorX<double> lo = -VectorX<double>::Random(n).cwiseAbs(),
                        hi = VectorX<double>::Random(n).cwiseAbs();
  VectorX<double> x(n + 2), z(n + 2);
  std::vector<QpSide> sides(static_cast<std::size_t>(n), QpSide::Between);
  const auto side_of = [&](Index i) { return sides[static_cast<std::size_t>(i)]; };
  for (int frame = 0; frame < 20; ++frame) {
    const VectorX<double> g = VectorX<double>::Random(n);
    curvature.start_rounds(g);
    for (int round = 0; round < 5; ++round) {
      for (int k = 0; k < (round == 4 ? n / 2 : 2); ++k) {
        sides[random() % static_cast<unsigned>(n)] =
            static_cast<QpSide>(static_cast<int>(random() % 3u) - 1);
      }
      const long before = clothctl_test::allocations();
      const bool done = curvature.minimise(g, lo, hi, side_of, 1e-14, x, z);
      const long taken = clothctl_test::allocations() - before;
      REQUIRE(done);
      if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
      const VectorX<double> q = H * x.head(n) + g;
      for (Index i = 0; i < n; ++i) {
        if (side_of(i) == QpSide::Between) CHECK(std::abs(q[i]) < 1e-10);
        if (side_of(i) == QpSide::Lower) CHECK(x[i] == lo[i]);
        if (side_of(i) == QpSide::Upper) CHECK(x[i] == hi[i]);
        if (side_of(i) != QpSide::Between) CHECK(z[i] == Approx(q[i]).margin(1e-10));
      }
    }
  }
}

TEST_CASE("degenerate bounds settle at once: x at a bound with z = 0 up to rounding",
          "[qp][low_rank]") {
  std::mt19937 random(31);
  std::normal_distribution<double> normal;
  int late = 0;
  for (unsigned seed = 0; seed < 40; ++seed) {
    const Index n = 30, r = 6;
    const FactoredHessian<double> given(n, r, seed);
    const MatrixX<double> H = given.dense();
    VectorX<double> lo(n), hi(n), x(n), z = VectorX<double>::Zero(n);
    for (Index i = 0; i < n; ++i) {
      lo[i] = -std::abs(normal(random)) - 0.3;
      hi[i] = std::abs(normal(random)) + 0.3;
      x[i] = i % 3 == 0 ? lo[i] : i % 3 == 1 ? hi[i] : 0.1 * lo[i];
      if (i % 6 == 0) z[i] = 1.0;  // every second active bound has a zero multiplier
    }
    const VectorX<double> g = z - H * x;
    detail::LowRankCurvature<double> low;
    low.reserve(n, r);
    given.fill(low);
    detail::ActiveBounds<double> dense;
    dense.reserve(n);
    MatrixX<double> scratch(n, n);
    dense.prepare(Eigen::Map<const MatrixX<double>>(H.data(), n, n), scratch);
    REQUIRE(dense.known());
    detail::PrimalDualActiveSet<double> rounds;
    rounds.reserve(n);
    const detail::Budget budget(QpSettings<double>{}, n);
    // Bounds with a zero multiplier may be in the set or not.
    for (const bool in : {true, false}) {
      const auto side_of = [&](Index i) {
        return i % 6 == 0          ? QpSide::Lower
               : !in || i % 3 == 2 ? QpSide::Between
               : i % 3 == 0        ? QpSide::Lower
                                   : QpSide::Upper;
      };
      const auto settles = [&](auto& minimiser) {
        int iterations = 0;
        minimiser.start_rounds(g);
        REQUIRE(rounds.find(minimiser, n, g, lo, hi, side_of, 1e-11, budget, iterations));
        CHECK(rounds.ended());
        late += iterations;
        CHECK(iterations <= 1);
        CHECK((rounds.x() - x).cwiseAbs().maxCoeff() < 1e-11);
      };
      settles(low);
      if (!in) settles(dense);  // with all of them, more than a third are active
    }
  }
  CHECK(late <= 4);  // of 120; rounding may exceed the threshold
}

TEST_CASE("a walk along which unknowns stop one by one agrees with the dense matrix",
          "[qp][low_rank]") {
  const Index n = 20, r = 4;
  const FactoredHessian<double> given(n, r, 8);
  const MatrixX<double> H = given.dense();
  detail::LowRankCurvature<double> curvature;
  curvature.reserve(n, r);
  given.fill(curvature);
  VectorX<double> p = VectorX<double>::Random(n), x = VectorX<double>::Zero(n),
                  q = VectorX<double>::Random(n);
  const VectorX<double> start = q;
  std::vector<Index> moving;
  for (Index i = 0; i < n; ++i) moving.push_back(i);
  curvature.start_walk(moving, n, p, q);
  for (Index stop = 0; stop < n; ++stop) {
    double slope = 0, bend = 0, size = 0;
    curvature.line(moving, n, p, q, slope, bend, size);
    const VectorX<double> here = start + H * x;
    CHECK(slope == Approx(here.dot(p)).margin(1e-11));
    CHECK(bend == Approx(p.dot(H * p)).margin(1e-11));
    x += 0.3 * p;
    curvature.advance(0.3, q);
    curvature.stop(stop, p, q);
    p[stop] = 0;
  }
  curvature.end_walk(moving, n, p, q);
  CHECK((q - start - H * x).norm() < 1e-11 * (H * x).norm());
}

TEST_CASE("a new matrix with the same free set is not mistaken for the old one", "[qp][low_rank]") {
  const Index n = 20, r = 4;
  detail::LowRankCurvature<double> curvature;
  curvature.reserve(n, r);
  std::vector<Index> wanted;
  for (Index i = 0; i < n; i += 2) wanted.push_back(i);
  for (const unsigned seed : {8u, 9u, 10u}) {
    const FactoredHessian<double> given(n, r, seed);
    const MatrixX<double> H = given.dense();
    given.fill(curvature);
    curvature.renew(wanted, static_cast<Index>(wanted.size()));
    const VectorX<double> q = VectorX<double>::LinSpaced(n, -1.0, 1.0);
    VectorX<double> p = VectorX<double>::Zero(n);
    curvature.newton(q, p);
    const VectorX<double> back = H * p + q;
    for (Index i : wanted) CHECK(std::abs(back[i]) < 1e-10);
    const VectorX<double> lo = VectorX<double>::Constant(n, -1.0), hi = -lo;
    VectorX<double> x(n), z(n);
    const auto side_of = [](Index i) { return i % 2 == 0 ? QpSide::Between : QpSide::Lower; };
    curvature.start_rounds(q);
    REQUIRE(curvature.minimise(q, lo, hi, side_of, 1e-14, x, z));
    for (Index i : wanted) CHECK(std::abs((H * x + q)[i]) < 1e-10);
  }
}
