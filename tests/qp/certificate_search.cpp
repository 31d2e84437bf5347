#include "clothctl/qp/detail/certificate_search.hpp"

#include <cmath>
#include <limits>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl::detail::CertificateSearch;
using clothctl::detail::RayStatus;

namespace {

// Two unknowns and two rows at an iterate (x, y), reached from (xk, yk) = 0, with the solver's
// weights.
template <class S>
struct Scene {
  detail::ProximalProblem<S> p;
  CertificateSearch<S> proofs;

  explicit Scene(const MatrixX<double>& H, const MatrixX<double>& A) {
    p.reserve(2, 2);
    p.resize(2, 2);
    proofs.reserve(2, 2);
    p.H() = H.cast<S>();
    p.A() = A.cast<S>();
    p.At() = p.A().transpose();
    const S none = detail::no_bound<S>();
    p.lo.setConstant(-none);
    p.hi.setConstant(none);
    p.rl.setConstant(-none);
    p.ru.setConstant(none);
    p.rho = sizeof(S) == sizeof(float) ? S(1e-3) : S(1e-7);
    p.mu = S(1e-2);
    p.state.assign(2, detail::ProximalProblem<S>::State::Free);
  }
};

MatrixX<double> matrix(double a, double b, double c, double d) {
  return (MatrixX<double>(2, 2) << a, b, c, d).finished();
}

}  // namespace

TEMPLATE_TEST_CASE(
    "an inaccurate Farkas direction is refined to rounding, and a wrong one is rejected", "[qp]",
    float, double) {
  using S = TestType;
  const double rough = sizeof(S) == sizeof(float) ? 1e-3 : 1e-6;
  for (double e :
       {0.0, sizeof(S) == sizeof(float) ? 1e-5 : 1e-12}) {  // x0 + x1 ≥ 1, x0 + (1 - e) x1 ≤ 0
    Scene<S> scene(matrix(1, 0, 0, 1), matrix(1, 1, 1, 1.0 - e));
    scene.p.rl[0] = S(1);
    scene.p.ru[1] = S(0);
    scene.p.x << S(0.25), S(0.25);
    scene.p.y << S(50), S(-50.0 * (1.0 + rough));
    scene.p.refresh_products();
    const long before = clothctl_test::allocations();
    const bool proven = scene.proofs.infeasible(scene.p);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    CHECK(proven == (e == 0.0));
    if (!proven) continue;
    CHECK(scene.proofs.farkas_rows()[0] < S(0));
    const double ratio =
        static_cast<double>(scene.proofs.farkas_rows()[0] / scene.proofs.farkas_rows()[1]);
    CHECK(std::abs(ratio + 1.0) <= 8.0 * static_cast<double>(std::numeric_limits<S>::epsilon()));
    CHECK(scene.proofs.farkas_bounds().isZero(S(0)));
  }
  Scene<S> still(matrix(1, 0, 0, 1), matrix(1, 1, 1, 1));  // no motion, so nothing to prove
  CHECK_FALSE(still.proofs.infeasible(still.p));
  CHECK(still.proofs.unbounded(still.p) == RayStatus::NotFound);
}

TEMPLATE_TEST_CASE("rays, far minima and other directions are distinguished", "[qp]", float,
                   double) {
  using S = TestType;
  const double rough = sizeof(S) == sizeof(float) ? 1e-5 : 1e-11;
  const double nearly = sizeof(S) == sizeof(float) ? 1e-4 : 1e-11;
  const auto verdict = [&](double corner, double d0, double d1) {
    Scene<S> scene(matrix(1, -1, -1, corner), matrix(1, -1, 0, 0));
    scene.p.rl[0] = scene.p.ru[0] = S(0);
    scene.p.g << S(-1), S(-1);
    scene.p.x << S(d0), S(d1);
    scene.p.refresh_products();
    const RayStatus answer = scene.proofs.unbounded(scene.p);
    if (answer == RayStatus::Proven) {
      const double ratio =
          static_cast<double>(scene.proofs.direction()[0] / scene.proofs.direction()[1]);
      CHECK(std::abs(ratio - 1.0) <= 8.0 * static_cast<double>(std::numeric_limits<S>::epsilon()));
    }
    if (answer == RayStatus::FarMinimum) {
      scene.proofs.go_to_far_minimum(scene.p);
      const double e = static_cast<double>(S(corner)) - 1.0;
      CHECK(static_cast<double>(scene.p.x[1]) == Approx(2.0 / e).epsilon(0.1));
    }
    return answer;
  };
  CHECK(verdict(1.0, 1.0, 1.0) == RayStatus::Proven);
  CHECK(verdict(1.0, 1.0, 1.0 + rough) == RayStatus::Proven);
  CHECK(verdict(1.0, -1.0, -1.0) == RayStatus::NotFound);  // rises
  CHECK(verdict(1.0, 1.0, 0.5) !=
        RayStatus::FarMinimum);  // curved, and leaves the row: refined to the ray, or none found
  CHECK(verdict(1.0 + nearly, 1.0, 1.0) == RayStatus::FarMinimum);
  CHECK(verdict(1.5, 1.0, 1.0) == RayStatus::NotFound);
}

TEMPLATE_TEST_CASE("small motions of uninvolved unknowns and rows do not hide a certificate",
                   "[qp]", float, double) {
  using S = TestType;
  const double trace = sizeof(S) == sizeof(float) ? 1e-4 : 1e-8;
  {  // x0 falls without limit; x1 is held by its own curvature and moves a little
    Scene<S> scene(matrix(0, 0, 0, 2), matrix(0, 0, 0, 0));
    scene.p.g << S(-1), S(0);
    scene.p.x << S(1), S(trace);
    scene.p.refresh_products();
    CHECK(scene.proofs.unbounded(scene.p) == RayStatus::Proven);
    CHECK(scene.proofs.direction()[1] == S(0));
  }
}
