// Points of rigid sides, and inverses of inertias.

#include "clothctl/contact/detail/side_points.hpp"

#include <limits>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("an inertia is inverted", "[contact]", float, double) {
  using S = TestType;
  clothctl_test::Numbers random(1);
  for (int k = 0; k < 50; ++k) {
    Matrix3<S> G;
    for (Index i = 0; i < 9; ++i) G(i) = static_cast<S>(random(-1, 1));
    const S size = static_cast<S>(std::pow(10.0, random(-6, 3)));
    const Matrix3<S> I = size * (G * G.transpose() + S(0.05) * Matrix3<S>::Identity());
    Matrix3<S> inverse;
    REQUIRE(detail::invert_inertia<S>(I, inverse));
    CHECK((I * inverse - Matrix3<S>::Identity()).norm() < S(1000) * scalar_traits<S>::epsilon());
    CHECK(inverse == inverse.transpose());
  }
}

TEST_CASE("what is no inertia is refused", "[contact]") {
  Matrix3<double> inverse = Matrix3<double>::Constant(7.0), I = Matrix3<double>::Identity();
  const auto refused = [&] {
    return !detail::invert_inertia<double>(I, inverse) && inverse(0, 0) == 7.0;
  };
  I(0, 1) = 0.5;  // not symmetric
  CHECK(refused());
  I(0, 1) = std::numeric_limits<double>::quiet_NaN();
  CHECK(refused());
  I.setIdentity();
  I(2, 2) = 0;
  CHECK(refused());
  I(2, 2) = I(1, 1) = -1;  // the determinant is positive
  CHECK(refused());
  I.setConstant(1.0);  // of rank one
  CHECK(refused());
}

TEST_CASE("fewer points need no memory", "[contact]") {
  detail::SidePoints<double> points(4);
  const Points<double> four = Points<double>::Ones(3, 4), five = Points<double>::Ones(3, 5);
  const long before = clothctl_test::allocations();
  CHECK(points.set(four) == QueryStatus::Answered);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(points.set(five) == QueryStatus::Answered);
  CHECK(points.count() == 5);
  CHECK(points.set(four) == QueryStatus::Answered);
  CHECK(points.count() == 4);
}
