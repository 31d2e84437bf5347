#include "clothctl/qp/problem.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("settings name their first bad value", "[qp]", float, double) {
  QpSettings<TestType> s;
  CHECK(s.check().empty());
  CHECK(s.stationarity_tolerance < TestType(2e-4));
  s.max_iterations = -1;
  CHECK(s.check() == "max_iterations is negative");
  s.complementarity_tolerance = TestType(0);
  CHECK(s.check() == "complementarity_tolerance is not a positive number");
  s.feasibility_tolerance = std::numeric_limits<TestType>::quiet_NaN();
  CHECK(s.check() == "feasibility_tolerance is not a positive number");
  s.stationarity_tolerance = std::numeric_limits<TestType>::infinity();
  CHECK(s.check() == "stationarity_tolerance is not a positive number");
}

TEMPLATE_TEST_CASE("bounds are loaded or refused by index", "[qp]", float, double) {
  using S = TestType;
  const S inf = std::numeric_limits<S>::infinity(), nan = std::numeric_limits<S>::quiet_NaN();
  const auto load = [](S l, S u) {
    const VectorX<S> lower = (VectorX<S>(2) << S(0), l).finished(), upper = (VectorX<S>(2) << S(0), u).finished();
    VectorX<S> lo(2), hi(2);
    return detail::load_bounds<S>(lower, upper, lo, hi);
  };
  CHECK(load(S(-1), S(1)) == -1);
  CHECK(load(S(1), S(1)) == -1);
  CHECK(load(-inf, inf) == -1);
  CHECK(load(S(-1e30), S(1e25)) == -1);
  CHECK(load(S(1), S(-1)) == 1);
  CHECK(load(nan, S(1)) == 1);
  CHECK(load(S(0), nan) == 1);
  CHECK(load(inf, inf) == 1);
  CHECK(load(-inf, -inf) == 1);
}

TEST_CASE("bad Hessian entries are found by index, rounding asymmetry is forgiven", "[qp]") {
  const char* message = "";
  MatrixX<double> H = MatrixX<double>::Identity(3, 3);
  H(0, 2) = H(2, 0) = 0.5;
  CHECK(detail::find_bad_hessian_entry<double>(H, message) == -1);
  H(0, 2) += 1e-12;
  CHECK(detail::find_bad_hessian_entry<double>(H, message) == -1);
  H(0, 2) += 1e-3;
  CHECK(detail::find_bad_hessian_entry<double>(H, message) == 2);
  CHECK(std::string(message) == "Hessian is not symmetric");
  H(1, 2) = std::numeric_limits<double>::quiet_NaN();
  CHECK(detail::find_bad_hessian_entry<double>(H, message) == 7);
  CHECK(std::string(message) == "Hessian entry is not finite");
}
