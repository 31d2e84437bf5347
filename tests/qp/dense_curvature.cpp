// The dense Hessian in the box method: products, Newton steps on a changing set, line searches.

#include "clothctl/qp/detail/dense_curvature.hpp"

#include "qp/curvatures.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("dense curvature multiplies, solves on the free set and excludes dependent unknowns",
          "[qp][dense_curvature]") {
  const Index n = 12;
  MatrixX<double> H = clothctl_test::FactoredHessian<double>(n, 5, 2).dense();
  H.row(11) = H.row(3);  // unknown 11 repeats unknown 3
  H.col(11) = H.col(3);
  H(11, 11) = H(3, 3);
  detail::DenseCurvature<double> curvature;
  curvature.reserve(n);
  curvature.attach({H.data(), n, n});
  const VectorX<double> q = VectorX<double>::Random(n), x = VectorX<double>::Random(n);
  VectorX<double> product = q;
  curvature.add_product(x, product);
  CHECK((product - q - H * x).norm() < 1e-13 * (H * x).norm());
  for (Index i : {3, 0, 7, 11, 5}) curvature.append(i);
  CHECK(curvature.size() == 4);
  CHECK(curvature.place(11) == -1);
  curvature.remove(curvature.place(0));
  VectorX<double> p = VectorX<double>::Zero(n);
  curvature.newton(q, p);
  const VectorX<double> back = H * p + q;
  for (Index i : {3, 5, 7}) CHECK(std::abs(back[i]) < 1e-12);
  CHECK(p[0] == 0.0);
  const std::vector<Index> wanted{11, 2, 3};
  curvature.renew(wanted, 3);
  CHECK(curvature.size() == 2);
  CHECK(curvature.place(3) == -1);
}

TEST_CASE("the line of a dense walk uses the unknowns that still move", "[qp][dense_curvature]") {
  const Index n = 9;
  const MatrixX<double> H = clothctl_test::FactoredHessian<double>(n, 3, 5).dense();
  detail::DenseCurvature<double> curvature;
  curvature.reserve(n);
  curvature.attach({H.data(), n, n});
  VectorX<double> p = VectorX<double>::Random(n), q = VectorX<double>::Random(n),
                  x = VectorX<double>::Zero(n);
  const VectorX<double> start = q;
  std::vector<Index> moving{0, 1, 2, 3, 4, 5, 6, 7, 8};
  curvature.start_walk(moving, n, p, q);
  for (Index stop = 0; stop < n; ++stop) {
    double slope = 0, bend = 0, size = 0;
    curvature.line(moving, n, p, q, slope, bend, size);
    CHECK(slope == Approx((start + H * x).dot(p)).margin(1e-12));
    CHECK(bend == Approx(p.dot(H * p)).margin(1e-12));
    CHECK(size == Approx((H.diagonal().array() * p.array().square()).sum()).margin(1e-12));
    x += 0.4 * p;
    curvature.advance(0.4, q);
    curvature.stop(stop, p, q);
    p[stop] = 0;
  }
  curvature.end_walk(moving, n, p, q);
  CHECK((q - start - H * x).norm() < 1e-12 * (H * x).norm());
}
