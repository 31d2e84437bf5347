#include "clothctl/qp/kkt.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

// min ½ x² - 2x + ½ y² with x ≤ 1, y free, x + y ≥ 3. Solution x = 1, y = 2, row multiplier 2,
// bound multiplier 1 - 2 - 2 = -3.
template <class S>
struct Small {
  S inf = std::numeric_limits<S>::infinity();
  MatrixX<S> H = MatrixX<S>::Identity(2, 2);
  MatrixX<S> A = MatrixX<S>::Ones(1, 2);
  VectorX<S> g = (VectorX<S>(2) << S(-2), S(0)).finished();
  VectorX<S> lb = VectorX<S>::Constant(2, -inf);
  VectorX<S> ub = (VectorX<S>(2) << S(1), inf).finished();
  VectorX<S> rl = VectorX<S>::Constant(1, S(3));
  VectorX<S> ru = VectorX<S>::Constant(1, inf);
  VectorX<S> x = (VectorX<S>(2) << S(1), S(2)).finished();
  VectorX<S> y = VectorX<S>::Constant(1, S(2));
  VectorX<S> z = (VectorX<S>(2) << S(-3), S(0)).finished();

  KktResiduals<S> judge() const { return kkt_residuals(H, g, A, rl, ru, lb, ub, x, y, z); }
};

}  // namespace

TEMPLATE_TEST_CASE("an optimum computed by hand has zero residuals", "[qp]", float, double) {
  const Small<TestType> q;
  const auto r = q.judge();
  CHECK(r.stationarity == TestType(0));
  CHECK(r.feasibility == TestType(0));
  CHECK(r.complementarity == TestType(0));
  CHECK(r.objective == TestType(0.5));
  CHECK(r.worst() == TestType(0));
}

TEST_CASE("each kind of error changes its own residual by its own size", "[qp]") {
  Small<double> q;
  SECTION("wrong multiplier") {
    q.z[0] = -2.5;
    CHECK(q.judge().stationarity == Approx(0.5));
    CHECK(q.judge().relative_stationarity == Approx(0.25));  // |Hx| = |g| = 2
  }
  SECTION("violated row") {
    q.rl[0] = 3.25;
    CHECK(q.judge().feasibility == Approx(0.25));
    CHECK(q.judge().relative_feasibility == Approx(0.25 / 3.0));
  }
  SECTION("violated bound") {
    q.ub[0] = 0.875;
    CHECK(q.judge().feasibility == Approx(0.125));
  }
  SECTION("multiplier on a slack row") {
    q.rl[0] = 2.5;
    CHECK(q.judge().complementarity == Approx(2.0 * 0.5));
    CHECK(q.judge().feasibility == 0.0);
  }
  SECTION("multiplier with the wrong sign counts the distance to the other side") {
    q.ru[0] = 10.0;
    q.y[0] = -2.0;
    CHECK(q.judge().complementarity == Approx(2.0 * 7.0));
  }
  SECTION("multiplier on an infinite side counts fully as a stationarity error") {
    q.z << 1.5, 0.0;  // no lower bound on x
    q.g[0] = -2.0 + 4.5;
    CHECK(q.judge().stationarity == Approx(1.5));
    Small<double> p;
    p.y[0] = -2.0;  // no upper side of the row
    CHECK(p.judge().stationarity >= 2.0);
  }
  SECTION("large numbers that mean infinity count as infinite") {
    q.lb.setConstant(-1e30);
    q.z[0] = 1.0;
    CHECK(q.judge().stationarity >= 1.0);
    CHECK(q.judge().complementarity == 0.0);
  }
}

TEST_CASE("multipliers that cancel do not make an error relatively smaller", "[qp]") {
  Small<double> q;
  q.ru[0] = 3.0;  // an equality, so that its multiplier and that of the bound may have any size
  q.y[0] += 1e12;
  q.z[0] -= 1e12;
  q.A(0, 1) = 0.0;
  q.rl[0] = q.ru[0] = 1.0;
  q.x[1] = 0.5;  // the minimum is at 0
  CHECK(q.judge().relative_stationarity == Approx(0.25));
}

TEST_CASE("problems without rows accept empty matrices", "[qp]") {
  const MatrixX<double> H = MatrixX<double>::Identity(1, 1), A(0, 1);
  const VectorX<double> g = VectorX<double>::Constant(1, -1.0), one = VectorX<double>::Ones(1),
                        none(0);
  const VectorX<double> lb = VectorX<double>::Zero(1), ub = VectorX<double>::Constant(1, 9.0),
                        z = VectorX<double>::Zero(1);
  CHECK(kkt_residuals(H, g, A, none, none, lb, ub, one, none, z).worst() == 0.0);
}

TEMPLATE_TEST_CASE("a value that is not finite makes residuals infinite", "[qp]", float, double) {
  using S = TestType;
  const auto infinite = [](const S& value) { return is_unbounded(value); };
  const Small<S> good;
  for (const S value : {std::numeric_limits<S>::quiet_NaN(), good.inf, -good.inf}) {
    for (int place = 0; place < 7; ++place) {
      Small<S> q;
      if (place == 0) q.x[1] = value;
      if (place == 1) q.z[0] = value;
      if (place == 2) q.y[0] = value;
      if (place == 3) q.g[1] = value;
      if (place == 4) q.H(0, 1) = value;
      if (place == 5) q.A(0, 0) = value;
      if (place == 6) q.x.setConstant(value), q.z.setConstant(value);
      INFO("place " << place << " value " << static_cast<double>(value));
      CHECK(infinite(q.judge().worst()));
      if (place != 2 && place != 5) CHECK(infinite(q.judge().relative_stationarity));
      if (place == 0 || place == 5 || place == 6) CHECK(infinite(q.judge().relative_feasibility));
    }
  }
  Small<S> q;
  q.lb[1] = std::numeric_limits<S>::quiet_NaN();
  CHECK(infinite(q.judge().relative_feasibility));
  q = {};
  q.x *= S(0.9) * std::numeric_limits<S>::max();  // finite, but the objective overflows
  CHECK(infinite(q.judge().worst()));
}

TEST_CASE("vectors of wrong sizes make every residual infinite, and nothing is read", "[qp]") {
  const auto broken = [](auto change) {
    Small<double> q;
    change(q);
    return !is_finite(q.judge().worst()) && !is_finite(q.judge().stationarity);
  };
  const VectorX<double> longer = VectorX<double>::Zero(7);
  CHECK_FALSE(broken([](Small<double>&) {}));
  CHECK(broken([&](Small<double>& q) { q.x = longer; }));
  CHECK(broken([&](Small<double>& q) { q.y = longer; }));
  CHECK(broken([&](Small<double>& q) { q.z = longer; }));
  CHECK(broken([&](Small<double>& q) { q.g = longer; }));
  CHECK(broken([&](Small<double>& q) { q.rl = longer; }));
  CHECK(broken([&](Small<double>& q) { q.ub = longer; }));
  CHECK(broken([](Small<double>& q) { q.A = MatrixX<double>::Zero(1, 1); }));
  CHECK(broken([](Small<double>& q) { q.H = MatrixX<double>::Zero(2, 1); }));
}
