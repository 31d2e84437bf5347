// One contact by itself: its solution obeys Coulomb's law.

#include "clothctl/contact/detail/single_contact.hpp"

#include <Eigen/Dense>
#include <cmath>

#include "support/catch.hpp"
#include "support/sweeps.hpp"
#include "support/tier.hpp"

using namespace clothctl;

namespace {

/// The largest violation of Coulomb's law, relative to the data.
template <class S>
S violation(const Matrix3<S>& D, const Vector3<S>& b, S mu, const Vector3<S>& lambda) {
  const Vector3<S> u = D * lambda + b;
  const S p_t = detail::tangential_length<S>(lambda), u_t = detail::tangential_length<S>(u);
  const S size = b.norm(), reach = size / D.trace();
  S worst = std::max(-lambda[0] / reach, (p_t - mu * lambda[0]) / reach);
  worst = std::max(worst, -u[0] / size);
  const S work = std::abs((u[0] + mu * u_t) * lambda[0] + u[1] * lambda[1] + u[2] * lambda[2]);
  return std::max(worst, work / (size * (lambda.norm() + reach)));
}

}  // namespace

TEMPLATE_TEST_CASE("single contacts obey Coulomb's law", "[contact]", float, double) {
  using S = TestType;
  clothctl_test::Numbers random(5);
  S worst(0);
  int open = 0, stick = 0, slip = 0;
  for (int k = 0; k < clothctl_test::trials(3000, 100000); ++k) {
    Matrix3<S> G;
    Vector3<S> b;
    for (Index i = 0; i < 9; ++i) G(i) = static_cast<S>(random(-1, 1));
    for (Index i = 0; i < 3; ++i) b[i] = static_cast<S>(random(-1, 1));
    const Matrix3<S> D = G * G.transpose() + S(0.05) * Matrix3<S>::Identity();
    const S mu = k % 10 == 0 ? S(0) : static_cast<S>(random(0, 1.5));
    const Vector3<S> lambda = detail::solve_single_contact<S>(D, b, mu);
    worst = std::max(worst, violation<S>(D, b, mu, lambda));
    if (lambda.norm() == S(0))
      ++open;
    else if (detail::tangential_length<S>(lambda) < mu * lambda[0] * S(0.9999))
      ++stick;
    else
      ++slip;
  }
  CHECK(worst < S(3000) * scalar_traits<S>::epsilon());  // D is conditioned up to 60
  CHECK((open > 100 && stick > 100 && slip > 100));
}

TEST_CASE("a contact that two bodies hold in two directions only is solved", "[contact]") {
  // S is singular: t2 does not move. It slips or sticks along t1.
  Matrix3<double> D = Matrix3<double>::Zero();
  D(0, 0) = 2;
  D(1, 1) = 1;
  const Vector3<double> b(-1, 3, 0);
  const Vector3<double> lambda = detail::solve_single_contact<double>(D, b, 0.5);
  CHECK(lambda[0] == Approx(0.5));
  CHECK(lambda[1] == Approx(-0.25));
  CHECK(std::abs(lambda[2]) < 1e-9);
}
