#include "clothctl/qp/detail/box_warm_start.hpp"

#include "clothctl/qp/detail/special/low_rank_curvature.hpp"
#include "qp/curvatures.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::FactoredHessian;

namespace {

const detail::Budget kRounds{QpSettings<double>{}, 100};

template <class Curvature>
struct Scene {
  Curvature curvature;
  detail::BoxWarmStart<double, Curvature> guess;
  VectorX<double> g, lo, hi;
  int iterations = 0;

  explicit Scene(Index n)
      : g(VectorX<double>::Random(n)), lo(VectorX<double>::Constant(n, -0.05)), hi(-lo) {
    guess.reserve(n);
  }
  bool find(bool warm, Index active) {
    const auto free = [](Index) { return QpSide::Between; };
    return guess.find(curvature, warm, active, g, lo, hi, free, 1e-12, kRounds, iterations);
  }
};

}  // namespace

TEST_CASE("a dense Hessian gives guesses if it is kept and few bounds are active", "[qp]") {
  for (const Index n : {30, 210}) {  // for the smaller one, cold solves prepare this mode
    const MatrixX<double> H = FactoredHessian<double>(n, n, 3).dense(),
                          other = FactoredHessian<double>(n, n, 4).dense();
    Scene<detail::DenseCurvature<double>> scene(n);
    scene.curvature.reserve(n);
    scene.curvature.attach({H.data(), n, n});
    const auto ready = [&] { return scene.curvature.active_bounds().ready(); };
    scene.hi.setConstant(10.0);
    scene.lo.setConstant(-10.0);
    CHECK_FALSE(scene.find(true, 0));  // a new Hessian may change again in the next solve
    scene.guess.end_solve(scene.curvature, false, true, n);
    CHECK_FALSE(ready());  // every bound is active
    scene.guess.forget(scene.curvature);
    scene.guess.end_solve(scene.curvature, false, true, 0);
    CHECK_FALSE(ready());  // the previous Hessian was not kept
    for (Index k = 1; k < 8 + n / 10; ++k) {
      CHECK_FALSE(scene.find(true, 0));
      scene.guess.end_solve(scene.curvature, true, true, 0);
    }
    CHECK_FALSE(scene.find(true, n / 3 + 1));
    CHECK_FALSE(scene.find(false, 0));
    CHECK_FALSE(ready());
    CHECK(scene.find(true, 0));
    scene.guess.forget(scene.curvature);
    scene.guess.end_solve(scene.curvature, false, false, 0);
    CHECK_FALSE(ready());  // after a solve that failed
    scene.guess.end_solve(scene.curvature, false, true, 0);
    CHECK(ready() == (n < 200));
    scene.guess.reserve(n);  // the first Hessian counts as kept
    scene.curvature.active_bounds().forget();
    scene.guess.end_solve(scene.curvature, false, true, 0);
    CHECK(ready() == (n < 200));
    for (Index k = 0; k < 8 + n / 10; ++k) scene.guess.end_solve(scene.curvature, true, true, 0);
    scene.guess.skip_next();
    CHECK_FALSE(scene.find(true, 0));
    CHECK(scene.find(true, 0));
    CHECK(scene.guess.rounds().ended());
    CHECK((H * scene.guess.rounds().x() + scene.g).norm() < 1e-9);
    // An inaccurate gradient is refined.
    VectorX<double> p(n), x = 1.001 * scene.guess.rounds().x();
    REQUIRE(scene.guess.refine(scene.curvature, H * x + scene.g, p));
    x += p;
    CHECK((H * x + scene.g).norm() < 1e-9);
    scene.guess.forget(scene.curvature);
    scene.curvature.attach({other.data(), n, n});
    CHECK_FALSE(scene.find(true, 0));
  }
}

TEST_CASE("a low-rank Hessian always gives guesses", "[qp]") {
  const Index n = 40, r = 5;
  const FactoredHessian<double> given(n, r, 7);
  const MatrixX<double> H = given.dense();
  Scene<detail::LowRankCurvature<double>> scene(n);
  scene.curvature.reserve(n, r);
  given.fill(scene.curvature);
  scene.hi.setConstant(2.0);
  scene.lo.setConstant(-2.0);
  REQUIRE(scene.find(false, n));
  REQUIRE(scene.guess.rounds().ended());
  const VectorX<double> x = scene.guess.rounds().x(), q = H * x + scene.g;
  Index active = 0;
  for (Index i = 0; i < n; ++i) {
    if (x[i] > scene.lo[i]) CHECK(q[i] < 1e-10);
    if (x[i] < scene.hi[i]) CHECK(q[i] > -1e-10);
    active += x[i] > scene.lo[i] && x[i] < scene.hi[i] ? 0 : 1;
  }
  CHECK(active > 0);
  VectorX<double> p(n);
  CHECK_FALSE(scene.guess.refine(scene.curvature, q, p));
}
