// Which entries of a gradient count as zero.

#include "clothctl/qp/detail/zero_gradient.hpp"

#include <random>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

constexpr double kRelative = 1e-12;

struct Problem {
  MatrixX<double> H;
  VectorX<double> g, x;

  explicit Problem(int seed) {
    std::mt19937 random(static_cast<unsigned>(seed));
    std::normal_distribution<double> normal;
    const MatrixX<double> M = MatrixX<double>::NullaryExpr(6, 6, [&] { return normal(random); });
    H = M * M.transpose();
    g = VectorX<double>::NullaryExpr(6, [&] { return normal(random); });
    x = VectorX<double>::NullaryExpr(6, [&] { return normal(random); });
  }

  detail::ZeroGradient<double> thresholds() const {
    detail::ZeroGradient<double> zero;
    zero.reserve(6);
    zero.set_diagonal(6, [&](Index j) { return H(j, j); });
    zero.update(6, g, x, H * x, kRelative);
    return zero;
  }
};

}  // namespace

TEST_CASE("a threshold is at least rounding of its own terms, and relative to its own size",
          "[qp]") {
  const double rounding =
      detail::ZeroGradient<double>::kRounding * scalar_traits<double>::epsilon();
  for (int seed = 0; seed < 20; ++seed) {
    const Problem p(seed);
    const detail::ZeroGradient<double> zero = p.thresholds();
    const VectorX<double> product = p.H * p.x;
    const double largest =
        std::max({1.0, p.g.cwiseAbs().maxCoeff(), product.cwiseAbs().maxCoeff()});
    for (Index i = 0; i < 6; ++i) {
      // The sum of the magnitudes of the terms of this entry, capped as the threshold is.
      const double terms = std::abs(p.g[i]) + p.H.row(i).cwiseAbs() * p.x.cwiseAbs();
      const double own = std::max(std::abs(p.g[i]), std::abs(product[i]));
      CHECK(zero[i] >= rounding * std::min(terms, largest) * (1.0 - 1e-12));
      CHECK(zero[i] >= kRelative * own * (1.0 - 1e-12));
      CHECK(zero[i] <= kRelative * own + rounding * largest);
      CHECK(zero.largest_terms() >= (p.H.row(i).cwiseAbs() * p.x.cwiseAbs())(0, 0) * (1.0 - 1e-12));
    }
  }
}

TEST_CASE("the threshold of a small entry does not grow with a huge one", "[qp]") {
  Problem p(4);
  p.H.setIdentity();
  p.g[0] = -1e9;
  p.x[0] = 1e9;
  CHECK(p.thresholds()[2] <= 1e-2 * kRelative * 1e9);
  CHECK(p.thresholds()[0] == Approx(kRelative * 1e9));
  p.g[2] = p.x[2] = 0.0;  // no size of its own
  CHECK(p.thresholds()[2] == Approx(kRelative * 1e9));
}

TEST_CASE("a change of an unknown's unit scales its threshold alone", "[qp]") {
  Problem p(3);
  p.g[0] = 1e4;        // the largest term of all; the others' thresholds are their own
  Problem scaled = p;  // x_2 counted in thousandths of its unit
  const double unit = 1e-3;
  scaled.H.row(2) *= unit;
  scaled.H.col(2) *= unit;
  scaled.g[2] *= unit;
  scaled.x[2] /= unit;
  const detail::ZeroGradient<double> before = p.thresholds(), after = scaled.thresholds();
  CHECK(after[2] == Approx(unit * before[2]).epsilon(1e-9));
  CHECK(after.scale(2) == Approx(before.scale(2) / unit).epsilon(1e-12));
  for (const Index i : {0, 1, 3, 4, 5}) {
    CHECK(after[i] == Approx(before[i]).epsilon(1e-9));
    CHECK(after.scale(i) == before.scale(i));
  }
}

TEST_CASE("an unknown without curvature has scale 1 and a threshold above zero", "[qp]") {
  Problem p(5);
  p.H.row(4).setZero();
  p.H.col(4).setZero();
  p.g[4] = 0.0;
  const detail::ZeroGradient<double> zero = p.thresholds();
  CHECK(zero.scale(4) == 1.0);
  CHECK(zero[4] == 1e-30);
}

TEST_CASE("where all terms are small, a threshold is relative to 1", "[qp]") {
  Problem p(6);
  p.H *= 1e-6;
  p.g *= 1e-6;
  p.x.setZero();
  p.x[0] = 1e10;  // the bound on the terms of an entry is large, the terms themselves are not
  p.H.row(0).tail(5).setZero();
  p.H.col(0).tail(5).setZero();
  p.H(0, 0) = 1e-12;
  const detail::ZeroGradient<double> zero = p.thresholds();
  for (Index i = 1; i < 6; ++i) CHECK(zero[i] <= kRelative * (1.0 + 1e-12));
}
