// Equality rows that cannot be satisfied are relaxed by the least amount; the others are satisfied.

#include "clothctl/mpc/detail/relaxed_qp.hpp"

#include "clothctl/qp/active_set.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// min ½ |u - (0.2, 0.4)|², 0 <= u <= 1, a limit u_0 + u_1 <= 1.5 and a patch row u_0 - u_1 = b.
VectorX<double> relaxed(double b) {
  detail::RelaxedQp<double, ActiveSet<double>> qp;
  qp.reserve(2, 2, 1);
  MatrixX<double> rows(2, 2);
  rows << 1, 1, 1, -1;
  VectorX<double> g(2), row_lower(2), row_upper(2);
  g << -0.2, -0.4;
  row_lower << -kInfinity, b;
  row_upper << 1.5, b;
  qp.fill(MatrixX<double>::Identity(2, 2), rows, g, VectorX<double>::Zero(2),
          VectorX<double>::Ones(2), row_lower, row_upper, 1, 1);
  const QpStatus status =
      detail::solve_with_rows(qp.solver, qp.hessian, qp.rows, qp.gradient, qp.lower, qp.upper,
                              row_lower, row_upper, qp.result);
  REQUIRE(status == QpStatus::Solved);
  REQUIRE(qp.result.x.size() == 4);
  CHECK(detail::iterations_of(qp.result) == qp.result.iterations);
  return qp.result.x;
}

}  // namespace

TEST_CASE("rows that can be satisfied hold exactly", "[mpc]") {
  const VectorX<double> x = relaxed(0.5);
  CHECK(x[0] == Approx(0.55));
  CHECK(x[1] == Approx(0.05));
  CHECK(x.tail(2).cwiseAbs().maxCoeff() <= 1e-9);
}

TEST_CASE("a row that contradicts bounds is missed by as little as possible", "[mpc]") {
  const VectorX<double> x = relaxed(3.0);  // u_0 - u_1 is at most 1
  CHECK(x[0] == Approx(1.0));
  CHECK(std::abs(x[1]) <= 1e-9);
  CHECK(x[2] - x[3] == Approx(2.0));
  CHECK(x[0] - x[1] + x[2] - x[3] == Approx(3.0));
}

TEST_CASE("a patch row without bounds gets no slack, and a result without iterations counts none",
          "[mpc]") {
  detail::RelaxedQp<double, ActiveSet<double>> qp;
  qp.reserve(2, 2, 1);
  VectorX<double> open(2);
  open.setConstant(kInfinity);
  qp.fill(MatrixX<double>::Identity(2, 2), MatrixX<double>::Ones(2, 2), VectorX<double>::Zero(2),
          VectorX<double>::Zero(2), VectorX<double>::Ones(2), -open, open, 1, 1);
  CHECK(qp.upper.tail(2).norm() == 0.0);
  CHECK(detail::iterations_of(VectorX<double>()) == 0);
}
