#include "clothctl/qp/detail/refinement_step.hpp"

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("refinement steps solve the equations of the sets without their weights", "[qp]") {
  // min ½|x|² over x0 + x1 ≥ 2: x = (1, 1), y = 1.
  detail::ProximalProblem<double> p;
  p.reserve(2, 1);
  p.resize(2, 1);
  p.H().setIdentity();
  p.A().setOnes();
  p.At().setOnes();
  p.lo.setConstant(-detail::no_bound<double>());
  p.hi.setConstant(detail::no_bound<double>());
  p.rl[0] = 2.0;
  p.ru[0] = detail::no_bound<double>();
  p.rho = 0.01;
  p.mu = 0.1;
  for (auto& state : p.state) state = detail::ProximalProblem<double>::State::Free;
  p.refresh_products();
  REQUIRE(p.sync_rows([](Index) { return true; }));
  VectorX<double> gradient(2), rows(1), step(2), delta(1);
  for (int k = 0; k < 30; ++k) {
    p.refresh_products();
    p.reduced_gradient(gradient);
    detail::take_refinement_step(p, gradient, rows, step, delta);
  }
  CHECK(p.x[0] == Approx(1.0).epsilon(1e-13));
  CHECK(p.x[1] == Approx(1.0).epsilon(1e-13));
  CHECK(p.y[0] == Approx(1.0).epsilon(1e-13));

  p.hi.setConstant(0.5);  // x stays within its bounds
  p.refresh_products();
  p.reduced_gradient(gradient);
  detail::take_refinement_step(p, gradient, rows, step, delta);
  CHECK(p.x.maxCoeff() <= 0.5);
}
