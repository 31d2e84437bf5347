// The equations of Alart and Curnier: zero exactly at solutions, and their derivative.

#include "clothctl/contact/detail/alart_curnier.hpp"

#include <cmath>

#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;

TEST_CASE("the equations hold where a contact obeys Coulomb's law", "[contact]") {
  const auto size = [](const Vector3<double>& l, const Vector3<double>& u, ContactState branch) {
    const auto e = detail::contact_equation<double>(l, u, 0.5, 0.3, 0.7);
    CHECK(e.branch == branch);
    return e.F.norm();
  };
  CHECK(size({0, 0, 0}, {0.1, 2, 3}, ContactState::Open) == 0);
  CHECK(size({2, 0, -1}, {0, 0, 0}, ContactState::Stick) == 0);  // on the cone's edge
  CHECK(size({2, 0.1, 0.2}, {0, 0, 0}, ContactState::Stick) == 0);
  CHECK(size({2, 0.6, -0.8}, {0, -1.2, 1.6}, ContactState::Slip) < 1e-15);
  CHECK(size({0, 0, 0}, {-0.1, 0, 0}, ContactState::Stick) > 0.01);      // sinks in
  CHECK(size({2, 0, 0}, {0.1, 0, 0}, ContactState::Stick) > 0.01);       // pushed off
  CHECK(size({2, 0.6, 0.8}, {0, 1.2, 1.6}, ContactState::Stick) > 0.1);  // slips backwards
  CHECK(size({2, 0.1, 0.1}, {0, -1.2, 1.6}, ContactState::Slip) > 0.1);  // too little friction
  CHECK(detail::contact_equation<double>({2, 0, 0}, {0, 1, 1}, 0.0, 0.3, 0.7).F.norm() == 0);
}

TEST_CASE("the derivative of the equations is that of a difference", "[contact]") {
  clothctl_test::Numbers random(3);
  double worst = 0;
  int branches[3] = {0, 0, 0};
  for (int k = 0; k < 500; ++k) {
    Vector3<double> l, u;
    for (Index i = 0; i < 3; ++i) {
      l[i] = random(-1, 1);
      u[i] = random(-1, 1);
    }
    const double mu = random(0, 1), n = random(0.5, 2), t = random(0.5, 2);
    const auto e = detail::contact_equation<double>(l, u, mu, n, t);
    const auto d = detail::contact_derivative<double>(e.branch, l, u, mu, n, t);
    ++branches[static_cast<int>(e.branch)];
    for (Index i = 0; i < 3; ++i) {
      const Vector3<double> step = 1e-6 * Vector3<double>::Unit(i);
      for (const bool first : {true, false}) {
        const Vector3<double> zero = Vector3<double>::Zero();
        const Vector3<double> dl = first ? step : zero, du = first ? zero : step;
        const auto up = detail::contact_equation<double>(l + dl, u + du, mu, n, t);
        const auto down = detail::contact_equation<double>(l - dl, u - du, mu, n, t);
        if (up.branch != e.branch || down.branch != e.branch) continue;
        const Vector3<double> slope = (up.F - down.F) / 2e-6;
        const Vector3<double> claimed = first ? d.A.col(i) : d.G.col(i);
        // The second derivative grows with 1/|y|².
        const double y = std::hypot(l[1] - t * u[1], l[2] - t * u[2]);
        worst = std::max(worst, (slope - claimed).norm() * std::min(1.0, y * y * y));
      }
    }
  }
  CHECK(worst < 1e-8);
  CHECK((branches[0] > 50 && branches[1] > 5 && branches[2] > 50));
}
