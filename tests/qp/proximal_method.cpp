#include "clothctl/qp/detail/proximal_method.hpp"

#include <random>

#include "support/catch.hpp"

using namespace clothctl;
using detail::ProximalStart;

namespace {

// min ½ xᵀHx + gᵀx over lb ≤ x ≤ ub, rl ≤ A x ≤ ru, loaded into the method in the way of ActiveSet.
struct Scene {
  QpSettings<double> settings;
  detail::ProblemData<double> data;
  detail::ProximalMethod<double> method{settings};
  QpResult<double> result;
  VectorX<double> x, y;

  Scene(const MatrixX<double>& H, const MatrixX<double>& A)
      : x(VectorX<double>::Zero(H.rows())), y(VectorX<double>::Zero(A.rows())) {
    data.reserve(H.rows(), A.rows());
    REQUIRE(data.validate_hessian(H) == QpStatus::Solved);
    data.take(H);
    REQUIRE(data.validate_rows(A) == QpStatus::Solved);
    data.take_rows(A);
    method.reserve(H.rows(), A.rows());
    method.scale(data);
  }

  QpStatus run(const VectorX<double>& g, const VectorX<double>& lb, const VectorX<double>& ub,
               const VectorX<double>& rl, const VectorX<double>& ru, ProximalStart start,
               int& iterations) {
    REQUIRE(data.load("", g, lb, ub, rl, ru, result));
    x = x.cwiseMax(data.lo()).cwiseMin(data.hi());
    auto& state = method.problem().state;
    using State = detail::ProximalMethod<double>::State;
    for (Index j = 0; j < x.size(); ++j) {
      state[static_cast<std::size_t>(j)] = !(x[j] > data.lo()[j])   ? State::Lower
                                           : !(x[j] < data.hi()[j]) ? State::Upper
                                                                    : State::Free;
    }
    method.forget_best();
    method.load(data, x, y, start);
    const detail::Budget budget(settings, x.size() + y.size());
    const QpStatus status = method.settle(data, method.run(budget, iterations));
    x = method.D().cwiseProduct(method.problem().x);
    y = method.E().cwiseProduct(method.problem().y);
    return status;
  }
};

}  // namespace

TEST_CASE(
    "the proximal method satisfies the optimality conditions in the caller's units, and keeps its "
    "result",
    "[qp]") {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 30; ++trial) {
    const Index n = 8, m = 6;
    const auto draw = [&](Index r, Index c) {
      MatrixX<double> M(r, c);
      for (Index k = 0; k < M.size(); ++k) M.data()[k] = normal(random);
      return M;
    };
    const MatrixX<double> J = draw(n / 2, n);
    MatrixX<double> H = J.transpose() * J, A = draw(m, n);
    for (Index j = 0; j < n; ++j) {  // unknowns and rows of very different scales
      const double size = std::ldexp(1.0, static_cast<int>(random() % 21) - 10);
      H.row(j) *= size;
      H.col(j) *= size;
      A.col(j) *= size;
    }
    A.row(2) *= 1024.0;
    Scene scene(H, A);
    const VectorX<double> lb = VectorX<double>::Constant(n, -1.0),
                          ub = VectorX<double>::Constant(n, 2.0);
    const VectorX<double> middle = A * VectorX<double>::Constant(n, 0.5),
                          rl = middle - draw(m, 1).cwiseAbs(), ru = middle;
    const VectorX<double> g = 10.0 * draw(n, 1);
    int iterations = 0;
    REQUIRE(scene.run(g, lb, ub, rl, ru, ProximalStart::Cold, iterations) == QpStatus::Solved);
    CHECK(iterations > 0);
    const VectorX<double> gradient = H * scene.x + g - A.transpose() * scene.y, ax = A * scene.x;
    const double slope =
        1.0 + g.cwiseAbs().maxCoeff() + (A.transpose() * scene.y).cwiseAbs().maxCoeff();
    CHECK(
        (gradient - scene.method.gradient().cwiseQuotient(scene.method.D())).cwiseAbs().maxCoeff() <
        1e-11 * slope);
    for (Index j = 0; j < n; ++j) {
      CHECK(scene.x[j] >= lb[j]);
      CHECK(scene.x[j] <= ub[j]);
      if (scene.x[j] > lb[j]) CHECK(gradient[j] < 1e-7 * slope);
      if (scene.x[j] < ub[j]) CHECK(gradient[j] > -1e-7 * slope);
    }
    for (Index i = 0; i < m; ++i) {
      const double size = 1.0 + std::abs(rl[i]) + std::abs(ru[i]);
      CHECK(ax[i] > rl[i] - 1e-7 * size);
      CHECK(ax[i] < ru[i] + 1e-7 * size);
      if (ax[i] > rl[i] + 1e-6 * size) CHECK(scene.y[i] <= 0.0);
      if (ax[i] < ru[i] - 1e-6 * size) CHECK(scene.y[i] >= 0.0);
    }
    int again = 0;
    CHECK(scene.run(g, lb, ub, rl, ru, ProximalStart::Warm, again) == QpStatus::Solved);
    CHECK(again == 0);
  }
}

TEST_CASE("the proximal method ends with a certificate if there is no solution", "[qp]") {
  const double inf = scalar_traits<double>::infinity();
  const VectorX<double> open = VectorX<double>::Constant(2, inf), none(0),
                        one = VectorX<double>::Ones(1);
  MatrixX<double> A(2, 2);
  A << 1.0, 1.0, 2.0, 2.0;
  Scene apart(MatrixX<double>::Identity(2, 2), A);
  VectorX<double> rl(2), ru(2);
  rl << 3.0, -inf;
  ru << inf, 4.0;
  int iterations = 0;
  CHECK(apart.run(VectorX<double>::Zero(2), -open, open, rl, ru, ProximalStart::Cold, iterations) ==
        QpStatus::PrimalInfeasible);
  const VectorX<double> y =
      apart.method.certificates().farkas_rows().cwiseProduct(apart.method.E());
  CHECK(y[0] < 0.0);
  CHECK(y[0] == Approx(-2.0 * y[1]));

  Scene falling(MatrixX<double>::Zero(2, 2), MatrixX<double>::Ones(1, 2));
  VectorX<double> g(2);
  g << -1.0, 0.0;
  CHECK(falling.run(g, -open, open, -one, one, ProximalStart::Cold, iterations) ==
        QpStatus::DualInfeasible);
  const VectorX<double> d = falling.method.certificates().direction();
  CHECK(d[0] > 0.0);
  CHECK(d[0] == Approx(-d[1]));
}

TEST_CASE("a run without iterations returns its best iterate, and replaces one that is not finite",
          "[qp]") {
  std::mt19937 random(8);
  std::normal_distribution<double> normal;
  const Index n = 20, m = 10;
  MatrixX<double> J(n, n), A(m, n);
  for (Index k = 0; k < J.size(); ++k) J.data()[k] = normal(random);
  for (Index k = 0; k < A.size(); ++k) A.data()[k] = normal(random);
  Scene scene(J.transpose() * J, A);
  const VectorX<double> lb = VectorX<double>::Constant(n, 0.5),
                        ub = VectorX<double>::Constant(n, 1.0);
  const VectorX<double> ax = A * VectorX<double>::Constant(n, 0.75),
                        g = VectorX<double>::Constant(n, -3.0);
  scene.settings.max_iterations = 1;
  int iterations = 0;
  CHECK(scene.run(g, lb, ub, ax, ax, ProximalStart::Cold, iterations) == QpStatus::IterationLimit);
  CHECK(iterations <= 1);
  CHECK(scene.x.minCoeff() >= 0.5);
  CHECK(scene.x.maxCoeff() <= 1.0);

  scene.method.forget_best();
  scene.method.problem().y[3] = std::numeric_limits<double>::quiet_NaN();
  CHECK(scene.method.settle(scene.data, QpStatus::Solved) == QpStatus::IterationLimit);
  CHECK(scene.method.problem().y.isZero(0.0));
  const VectorX<double> x = scene.method.D().cwiseProduct(scene.method.problem().x);
  CHECK((x - lb).cwiseAbs().maxCoeff() < 1e-15);
}
