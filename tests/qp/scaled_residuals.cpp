#include "clothctl/qp/detail/scaled_residuals.hpp"

#include <random>

#include "clothctl/qp/detail/scaling.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("the scaled residuals agree with their definition on the caller's data", "[qp]") {
  std::mt19937 random(14);
  std::normal_distribution<double> normal;
  const auto draw = [&](Index rows, Index columns) {
    MatrixX<double> M(rows, columns);
    for (Index k = 0; k < M.size(); ++k) M.data()[k] = normal(random);
    return M;
  };
  const Index n = 9, m = 5;
  for (int trial = 0; trial < 50; ++trial) {
    MatrixX<double> H = draw(n, n), A = draw(m, n);
    H = (H.transpose() * H).eval();
    for (Index j = 0; j < n; ++j) {
      const double scale = std::ldexp(1.0, static_cast<int>(random() % 30u) - 15);
      H.row(j) *= scale;
      H.col(j) *= scale;
      A.col(j) *= scale;
    }
    VectorX<double> g = draw(n, 1), lb = -draw(n, 1).cwiseAbs(), ub = draw(n, 1).cwiseAbs(),
                    rl = draw(m, 1);
    VectorX<double> ru = rl + draw(m, 1).cwiseAbs(), x = draw(n, 1).cwiseMax(lb).cwiseMin(ub),
                    y = draw(m, 1);
    x[2] = lb[2];
    x[3] = ub[3];
    detail::ProximalProblem<double> p;
    p.reserve(n, m);
    p.resize(n, m);
    p.H() = H;
    p.A() = A;
    VectorX<double> D = VectorX<double>::Ones(n), E = VectorX<double>::Ones(m),
                    gradient = VectorX<double>::Zero(n);
    detail::equilibrate<double>(p.H(), p.A(), D, E);
    p.At() = p.A().transpose();
    p.g = D.cwiseProduct(g);
    p.x = x.cwiseQuotient(D);
    p.lo = lb.cwiseQuotient(D);
    p.hi = ub.cwiseQuotient(D);
    p.rl = E.cwiseProduct(rl);
    p.ru = E.cwiseProduct(ru);
    p.y = y.cwiseQuotient(E);
    p.refresh_products();
    p.reduced_gradient(gradient);
    const KktResiduals<double> scaled = detail::scaled_residuals(p, D, E, gradient);
    const VectorX<double> slope = H * x + g - A.transpose() * y;
    VectorX<double> z(n);
    for (Index j = 0; j < n; ++j) z[j] = detail::bound_multiplier(slope[j], x[j], lb[j], ub[j]);
    const KktResiduals<double> r = kkt_residuals(H, g, A, rl, ru, lb, ub, x, y, z);
    CHECK(scaled.relative_stationarity == Approx(r.relative_stationarity));
    CHECK(scaled.relative_feasibility == Approx(r.relative_feasibility).margin(1e-15));
    CHECK(scaled.relative_complementarity == Approx(r.relative_complementarity));
    CHECK(scaled.objective == Approx(r.objective));
  }
}

TEST_CASE("residuals are relative to the caller's units, and a point beyond 1e20 has none",
          "[qp]") {
  detail::ProximalProblem<double> p;
  p.reserve(2, 0);
  p.resize(2, 0);
  p.H() << 1.0, 0.0, 0.0, 1.0;  // scaled; the caller's H is diag(1, 2^-60)
  VectorX<double> D(2), E(0), gradient = VectorX<double>::Zero(2);
  D << 1.0, std::ldexp(1.0, 30);
  p.g << -1.0, -1.0;
  p.lo.setConstant(-detail::no_bound<double>());
  p.hi.setConstant(detail::no_bound<double>());
  p.x << 1.0, 0.5;
  p.refresh_products();
  p.reduced_gradient(gradient);
  CHECK(detail::scaled_residuals(p, D, E, gradient).relative_stationarity < 1e-9);
  p.x << 1.0, 1e12;  // 1e21 in the caller's units
  p.refresh_products();
  p.reduced_gradient(gradient);
  CHECK_FALSE(is_finite(detail::scaled_residuals(p, D, E, gradient).relative_feasibility));
}

TEST_CASE("rounding counts if terms cancel to a tolerance, in each product", "[qp]") {
  const QpSettings<double> settings;
  const double edge = settings.stationarity_tolerance / (2 * scalar_traits<double>::epsilon());
  VectorX<double> D = VectorX<double>::Ones(2), E = VectorX<double>::Ones(1);
  const auto counts = [&](detail::ProximalProblem<double>& p) {
    p.At() = p.A().transpose();
    p.refresh_products();
    return detail::rounding_counts(p, D, E, settings);
  };
  for (const double size : {0.1 * edge, 10 * edge}) {
    detail::ProximalProblem<double> p;
    p.reserve(2, 1);
    p.resize(2, 1);
    p.x << 1.0, 1.0;
    p.H() << size, -size, -size, size;
    CHECK(counts(p) == (size > edge));
    p.H().setConstant(0.0);
    p.A() << size, -size;
    CHECK(counts(p) == (size > edge));  // violation
    p.A() << 1.0, 1.0;
    p.x << 0.5, 0.5;
    p.y[0] = size;  // slack times multiplier; the gradient is scaled by the row's own part
    CHECK(counts(p) == (size > edge));
  }
}
