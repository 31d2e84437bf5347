// The contact problem of sides and contacts, against dense products.

#include "clothctl/contact/detail/delassus.hpp"

#include <vector>

#include "support/catch.hpp"
#include "support/pinch.hpp"

using namespace clothctl;

TEST_CASE("the problem is B W Bᵀ and B u", "[contact]") {
  clothctl_test::PinchSettings settings;
  settings.contacts = 6;
  clothctl_test::Pinch<double> pinch = clothctl_test::make_pinch_problem<double>(settings, 2);
  std::vector<ContactSample<double>>& contacts = pinch.contacts;
  contacts[2].drift = {0.3, -0.2, 0.1};
  contacts[4].b = contacts[0].a;  // the sheet touches itself
  const Index c = 6;
  Points<double> frames(3, 3 * c);
  for (Index i = 0; i < c; ++i) {
    const ContactSample<double>& contact = contacts[static_cast<std::size_t>(i)];
    const Matrix3<double> F = detail::contact_frame<double>(contact.normal);
    CHECK((F * F.transpose() - Matrix3<double>::Identity()).norm() < 4e-15);
    CHECK((F.row(0).transpose() - contact.normal).norm() < 1e-15);
    CHECK(F.determinant() > 0.9);
    frames.middleCols<3>(3 * i) = F;
  }
  detail::FrictionProblem<double> problem;
  problem.reserve(c);
  problem.resize(c);
  MatrixX<double> D = MatrixX<double>::Zero(3 * c, 3 * c);
  VectorX<double> b = VectorX<double>::Zero(3 * c);
  const clothctl_test::DenseSide<double>* sides[] = {&pinch.sheet, &pinch.lower, &pinch.upper};
  const double h = pinch.dt;
  for (int s = 0; s < 3; ++s) {
    detail::add_side<double>(contacts, frames, s, sides[s]->W, sides[s]->u, problem);
    MatrixX<double> B = MatrixX<double>::Zero(3 * c, sides[s]->u.size());
    for (Index i = 0; i < c; ++i) {
      const ContactSample<double>& contact = contacts[static_cast<std::size_t>(i)];
      const Matrix3<double> F = frames.middleCols<3>(3 * i);
      for (const auto* place : {&contact.a, &contact.b}) {
        if (place->side != s) continue;
        const double sign = place == &contact.a ? 1.0 : -1.0;
        for (std::size_t k = 0; k < 3 && place->point[k] >= 0; ++k)
          B.block<3, 3>(3 * i, 3 * place->point[k]) +=
              sign * place->weight[static_cast<Index>(k)] * F;
      }
    }
    D += B * sides[s]->W * B.transpose();
    b += B * sides[s]->u;
  }
  detail::complete_problem<double>(contacts, frames, h, problem);
  for (Index i = 0; i < c; ++i) {
    const ContactSample<double>& contact = contacts[static_cast<std::size_t>(i)];
    const Matrix3<double> F = frames.middleCols<3>(3 * i);
    // λ_n = -h k (g + h u_n) - h d u_n, solved for u_n.
    const double k = 1 / contact.compliance, d = contact.damping;
    const Vector3<double> s = F * contact.offset;
    b.segment<3>(3 * i) -= F * contact.drift;
    for (Index j = 0; j < 3; ++j) {
      D(3 * i + j, 3 * i + j) += 1 / (h * (h * k + d));
      b[3 * i + j] += k * (j == 0 ? contact.gap : s[j]) / (h * k + d);
    }
    CHECK(problem.friction(i) == contact.friction);
  }
  CHECK((problem.D() - D).norm() < 1e-12 * D.norm());
  CHECK(problem.D() == problem.D().transpose());
  CHECK((problem.b() - b).norm() < 1e-13 * b.norm());
}
