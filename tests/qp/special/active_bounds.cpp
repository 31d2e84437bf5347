#include "clothctl/qp/detail/special/active_bounds.hpp"

#include <Eigen/Dense>
#include <random>

#include "qp/curvatures.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using Mode = detail::ActiveBounds<double>;

namespace {

MatrixX<double> definite(Index n, unsigned seed) {
  return clothctl_test::FactoredHessian<double>(n, n, seed).dense();
}
Eigen::Map<const MatrixX<double>> map(const MatrixX<double>& H) {
  return {H.data(), H.rows(), H.cols()};
}

}  // namespace

TEST_CASE("on changing active sets, the minimiser solves the optimality equations", "[qp]") {
  std::mt19937 random(9);
  for (const Index n : {3, 12, 65, 140}) {
    const MatrixX<double> H = definite(n, static_cast<unsigned>(n));
    Mode mode;
    mode.reserve(n + 5);
    MatrixX<double> scratch(n + 8, n + 5);
    VectorX<double> x(n + 5), z(n + 5), p(n + 5);
    const VectorX<double> lo = -VectorX<double>::Random(n).cwiseAbs(),
                          hi = VectorX<double>::Random(n).cwiseAbs();
    std::vector<QpSide> sides(static_cast<std::size_t>(n), QpSide::Between);
    const auto side_of = [&](Index i) { return sides[static_cast<std::size_t>(i)]; };
    const long before = clothctl_test::allocations();
    mode.prepare(map(H), scratch);
    long taken = clothctl_test::allocations() - before;
    REQUIRE(mode.known());
    Index active = 0;
    for (int step = 0; step < 60; ++step) {
      const int flips = step % 20 == 19 ? static_cast<int>(n) / 4 : 1;  // one by one, and in blocks
      for (int k = 0; k < flips; ++k) {
        QpSide& side = sides[random() % static_cast<unsigned>(n)];
        if (side != QpSide::Between) {
          side = QpSide::Between;
          --active;
        } else if (Mode::suits(active + 1, n)) {
          side = random() % 2 == 0 ? QpSide::Lower : QpSide::Upper;
          ++active;
        }
      }
      const VectorX<double> g = VectorX<double>::Random(n);
      const long start = clothctl_test::allocations();
      mode.start_rounds(g);
      const bool done = mode.minimise(g, lo, hi, side_of, 1e-14, x, z);
      taken += clothctl_test::allocations() - start;
      REQUIRE(done);
      const VectorX<double> q = H * x.head(n) + g;
      for (Index i = 0; i < n; ++i) {
        if (side_of(i) == QpSide::Between) CHECK(std::abs(q[i]) < 1e-9);
        if (side_of(i) == QpSide::Lower) CHECK(x[i] == lo[i]);
        if (side_of(i) == QpSide::Upper) CHECK(x[i] == hi[i]);
        if (side_of(i) != QpSide::Between) CHECK(z[i] == Approx(q[i]).margin(1e-9));
      }
      mode.newton(g, p);  // -H_FF⁻¹ g_F
      const VectorX<double> back = H * p.head(n) + g;
      for (Index i = 0; i < n; ++i) {
        if (side_of(i) == QpSide::Between) CHECK(std::abs(back[i]) < 1e-9);
        if (side_of(i) != QpSide::Between) CHECK(p[i] == 0.0);
      }
    }
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
  }
}

TEST_CASE("the active-set mode declines problems that it is not meant for", "[qp]") {
  const Index n = 12;
  MatrixX<double> H = definite(n, 4), scratch(n, n);
  Mode mode;
  mode.reserve(n);
  CHECK_FALSE(mode.ready());
  const MatrixX<double> J = H.topRows(n - 1), singular = J.transpose() * J;
  mode.prepare(map(singular), scratch);
  CHECK(mode.ready());
  CHECK_FALSE(mode.known());
  mode.prepare(map(H), scratch);
  REQUIRE(mode.known());
  VectorX<double> x(n), z(n);
  const VectorX<double> g = VectorX<double>::Ones(n), lo = -g, hi = g;
  mode.start_rounds(g);
  const auto first = [](Index count) {
    return [count](Index i) { return i < count ? QpSide::Lower : QpSide::Between; };
  };
  CHECK(mode.minimise(g, lo, hi, first(n / 3), 1e-14, x, z));
  CHECK_FALSE(mode.minimise(g, lo, hi, first(n / 3 + 1), 1e-14, x, z));  // too many
  CHECK(mode.minimise(g, lo, hi, first(2), 1e-14, x, z));
  mode.forget();
  CHECK_FALSE(mode.ready());
  CHECK(Mode::suits(0, Mode::kMostUnknowns));
  CHECK_FALSE(Mode::suits(0, Mode::kMostUnknowns + 1));
  MatrixX<double> nearly = singular;
  nearly.diagonal().array() += 1e-9 * singular.diagonal().maxCoeff();
  mode.prepare(map(nearly), scratch);
  CHECK_FALSE(mode.known());
  mode.reserve(Mode::kMostUnknowns + 100);  // reserved for many unknowns, used by few
  mode.prepare(map(H), scratch);
  REQUIRE(mode.known());
  mode.start_rounds(g);
  CHECK(mode.minimise(g, lo, hi, first(1), 1e-14, x, z));
}
