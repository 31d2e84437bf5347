#include "clothctl/qp/problem.hpp"

#include <limits>
#include <random>

#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("validate names the first bad setting", "[qp]", float, double) {
  QpSettings<TestType> s;
  CHECK(s.validate().empty());
  CHECK(s.stationarity_tolerance < TestType(2e-4));
  s.max_iterations = -1;
  CHECK(s.validate() == "max_iterations is negative");
  s.complementarity_tolerance = TestType(0);
  CHECK(s.validate() == "complementarity_tolerance is not a positive number");
  s.feasibility_tolerance = std::numeric_limits<TestType>::quiet_NaN();
  CHECK(s.validate() == "feasibility_tolerance is not a positive number");
  s.stationarity_tolerance = std::numeric_limits<TestType>::infinity();
  CHECK(s.validate() == "stationarity_tolerance is not a positive number");
}

TEMPLATE_TEST_CASE("good bounds are loaded, bad ones are refused with their index", "[qp]", float,
                   double) {
  using S = TestType;
  const S inf = std::numeric_limits<S>::infinity(), nan = std::numeric_limits<S>::quiet_NaN();
  const auto load = [](S l, S u) {
    const VectorX<S> lower = (VectorX<S>(2) << S(0), l).finished(),
                     upper = (VectorX<S>(2) << S(0), u).finished();
    VectorX<S> lo(2), hi(2);
    const detail::BoundRefusal refusal = detail::load_bounds<S>(lower, upper, lo, hi);
    CHECK(refusal.index == (std::string(refusal.bound).empty() ? -1 : 1));
    CHECK(std::string(refusal.row).empty() == std::string(refusal.bound).empty());
    return std::string(refusal.bound);
  };
  CHECK(load(S(-1), S(1)) == "");
  CHECK(load(S(1), S(1)) == "");
  CHECK(load(-inf, inf) == "");
  CHECK(load(S(-1e30), S(1e25)) == "");
  CHECK(load(S(1), S(-1)) == "lower bound is above the upper one");
  CHECK(load(nan, S(1)) == "lower bound is NaN");
  CHECK(load(S(0), nan) == "upper bound is NaN");
  CHECK(load(inf, inf) == "lower bound is +infinite");
  CHECK(load(-inf, -inf) == "upper bound is -infinite");
}

TEMPLATE_TEST_CASE("bounds beyond 1e20 are open, and smaller ones stay bounds under any scaling",
                   "[qp]", float, double) {
  using S = TestType;
  const VectorX<S> lower = (VectorX<S>(2) << S(-1e21), S(-0.99e20)).finished(), upper = -lower;
  VectorX<S> lo(2), hi(2);
  REQUIRE(detail::load_bounds<S>(lower, upper, lo, hi).index == -1);
  CHECK_FALSE(detail::has_bound(lo[0]));
  CHECK_FALSE(detail::has_bound(hi[0]));
  CHECK(detail::has_bound(lo[1]));
  CHECK(detail::has_bound(S(lo[1] * S(1152921504606846976.0))));  // 2^60
  CHECK(is_finite(detail::no_bound<S>()));
}

TEST_CASE("one entry that differs from its mirror image is found wherever it is", "[qp]") {
  // Sizes around those of the tiles that are compared.
  for (const Index n : {1, 15, 16, 17, 33, 48}) {
    MatrixX<double> H = MatrixX<double>::Constant(n, n, 0.25) + MatrixX<double>::Identity(n, n);
    REQUIRE(detail::validate_hessian<double>(H).status == QpStatus::Solved);
    for (Index j = 0; j < n; ++j) {
      for (Index i = 0; i < n; ++i) {
        if (i == j) continue;
        H(i, j) = 0.3;
        const QpRefusal refusal = detail::validate_hessian<double>(H);
        CHECK(refusal.status == QpStatus::InvalidData);
        CHECK(refusal.index == (std::max)(i, j) + (std::min)(i, j) * n);
        H(i, j) = 0.25;
      }
    }
  }
}

TEMPLATE_TEST_CASE("an entry too large for its diagonal is found wherever it is", "[qp]", float,
                   double) {
  using S = TestType;
  for (const Index n : {63, 64, 65, 130}) {
    MatrixX<S> H = MatrixX<S>::Identity(n, n);
    REQUIRE(detail::validate_hessian<S>(H).status == QpStatus::Solved);
    for (const Index j : {Index(0), n / 2, n - 2}) {
      for (const Index i : {j + 1, n - 1}) {
        CAPTURE(n, i, j);
        H(i, j) = H(j, i) = S(-1.5);
        CHECK(detail::validate_hessian<S>(H).status == QpStatus::NonConvex);
        CHECK(detail::validate_hessian<S>(H).index == i + j * n);
        H(i, i) = S(4);
        CHECK(detail::validate_hessian<S>(H).status == QpStatus::Solved);
        H(i, i) = S(1);
        H(i, j) = H(j, i) = scalar_traits<S>::infinity();
        CHECK(detail::validate_hessian<S>(H).index == i + j * n);
        CHECK(std::string(detail::validate_hessian<S>(H).message) == "Hessian entry is not finite");
        H(i, j) = H(j, i) = S(0);
      }
    }
    const S tiny = sizeof(S) == 4 ? S(1e-25) : S(1e-170);  // products of two are zero
    MatrixX<S> small = tiny * H;
    CHECK(detail::validate_hessian<S>(small).status == QpStatus::Solved);
    small(1, 0) = small(0, 1) = S(2) * tiny;
    CHECK(detail::validate_hessian<S>(small).status == QpStatus::NonConvex);
    H(0, 0) = H(n - 1, n - 1) = S(-2);  // their product is positive
    CHECK(detail::validate_hessian<S>(H).status == QpStatus::NonConvex);
    CHECK(detail::validate_hessian<S>(H).index == 0);
    H.topLeftCorner(n - 1, n - 1).setIdentity();
    CHECK(detail::validate_hessian<S>(H).index == n - 1 + (n - 1) * n);
  }
}

TEMPLATE_TEST_CASE("Hessians with asymmetry beyond rounding or with negative minors are refused",
                   "[qp]", float, double) {
  using S = TestType;
  const S eps = std::numeric_limits<S>::epsilon(), nan = std::numeric_limits<S>::quiet_NaN();
  MatrixX<S> H = MatrixX<S>::Identity(3, 3);
  H(0, 2) = H(2, 0) = S(0.5);
  CHECK(detail::validate_hessian<S>(H).status == QpStatus::Solved);
  H(0, 2) = S(0.5) + S(4) * eps;
  CHECK(detail::validate_hessian<S>(H).status == QpStatus::Solved);
  H(0, 2) = S(0.5) + S(200) * eps;
  CHECK(detail::validate_hessian<S>(H).status == QpStatus::InvalidData);
  CHECK(detail::validate_hessian<S>(H).index == 2);
  CHECK(std::string(detail::validate_hessian<S>(H).message) == "Hessian is not symmetric");
  H(1, 2) = nan;
  CHECK(detail::validate_hessian<S>(H).index == 7);
  CHECK(std::string(detail::validate_hessian<S>(H).message) == "Hessian entry is not finite");
  H.setIdentity();
  H(2, 2) = S(-1e-3);
  CHECK(detail::validate_hessian<S>(H).status == QpStatus::NonConvex);
  CHECK(detail::validate_hessian<S>(H).index == 8);
  H.setZero();
  H(0, 1) = H(1, 0) = S(1);  // a saddle
  CHECK(detail::validate_hessian<S>(H).status == QpStatus::NonConvex);
  CHECK(detail::validate_hessian<S>(H).index == 1);
  H << S(4), S(0), S(2), S(0), S(0), S(0), S(2), S(0), S(1);  // singular, which is allowed
  CHECK(detail::validate_hessian<S>(H).status == QpStatus::Solved);
  H(0, 2) = H(2, 0) = S(2) * (S(1) + S(4) * eps);  // as asymmetric as rounded products can be
  CHECK(detail::validate_hessian<S>(H).status == QpStatus::Solved);
  H(0, 2) = H(2, 0) = S(2.01);
  CHECK(detail::validate_hessian<S>(H).status == QpStatus::NonConvex);
  CHECK(detail::validate_hessian<S>(MatrixX<S>::Zero(2, 3)).status == QpStatus::InvalidData);
  H.resize(0, 0);
  CHECK(detail::validate_hessian<S>(H).status == QpStatus::InvalidData);
}

TEMPLATE_TEST_CASE(
    "an entry too large for its diagonal is detected even if products overflow or underflow",
    "[qp]", float, double) {
  using S = TestType;
  for (const S size : {S(1), std::sqrt(std::numeric_limits<S>::max()) * S(8),
                       std::sqrt(std::numeric_limits<S>::min()) / S(8)}) {
    MatrixX<S> H(2, 2);
    H << size, S(1.01) * size, S(1.01) * size, size;
    CHECK(detail::validate_hessian<S>(H).status == QpStatus::NonConvex);
    H << size, S(0.99) * size, S(0.99) * size, size;
    CHECK(detail::validate_hessian<S>(H).status == QpStatus::Solved);
  }
}

TEMPLATE_TEST_CASE("products of a factor are accepted as Hessians at any rank and scale", "[qp]",
                   float, double) {
  using S = TestType;
  std::mt19937 random(51);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 40; ++trial) {
    const Index n = 2 + trial % 37, rank = 1 + trial % 5;
    MatrixX<S> J(rank, n);
    for (Index k = 0; k < J.size(); ++k) J.data()[k] = S(normal(random));
    for (Index j = 0; j < n; ++j)
      J.col(j) *= S(std::ldexp(1.0, static_cast<int>(random() % 31) - 15));
    const MatrixX<S> H = J.transpose() * J;
    INFO("trial " << trial << " " << detail::validate_hessian<S>(H).message);
    CHECK(detail::validate_hessian<S>(H).status == QpStatus::Solved);
  }
}

TEST_CASE("a tolerance of zero is refused", "[qp]") {
  QpSettings<double> s;
  s.stationarity_tolerance = 0.0;
  CHECK_FALSE(s.validate().empty());
  s = {};
  s.feasibility_tolerance = 0.0;
  CHECK_FALSE(s.validate().empty());
}
