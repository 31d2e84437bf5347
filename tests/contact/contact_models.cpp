// The contact models of fingers: the laws of all of them, and the properties of each.

#include "clothctl/contact/contact_models.hpp"

#include <cmath>
#include <string>
#include <type_traits>

#include "laws/contact_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::contact_forces;
using clothctl_test::contact_patch;
using clothctl_test::ContactPatch;

static_assert(ContactModel<Frictionless<float>, float> && ContactModel<HardFinger<float>, float> &&
              ContactModel<SoftFinger<float>, float> && ContactModel<AdhesiveFinger<float>, float>);
static_assert(ContactModel<Frictionless<double>> && ContactModel<HardFinger<double>> &&
              ContactModel<SoftFinger<double>> && ContactModel<AdhesiveFinger<double>>);
static_assert(!ContactModel<HardFinger<float>, double> && !ContactModel<SoftFinger<double>, float>);

namespace {

// Torsion of forces about the patch's centroid, along (0, 0, 1), N m.
double torsion(const ContactPatch<double>& patch, const Points<double>& forces) {
  const Vector3<double> centre = patch.points.rowwise().mean();
  double sum = 0;
  for (Index j = 0; j < forces.cols(); ++j) {
    const Vector3<double> arm = patch.points.col(j) - centre, f = forces.col(j);
    sum += arm.cross(f)[2];
  }
  return sum;
}

VectorX<double> unit(Index count, Index i, double value) {
  VectorX<double> d = VectorX<double>::Zero(count);
  d[i] = value;
  return d;
}

}  // namespace

TEMPLATE_TEST_CASE("every contact model obeys the laws", "[contact]", float, double) {
  using S = TestType;
  const S tolerance = std::is_same_v<S, float> ? S(2e-5) : S(1e-13);
  clothctl_test::check_contact_laws<S>(Frictionless<S>(), tolerance);
  for (const S friction : {S(0), S(0.5), S(3)}) {
    for (const int pyramid : {4, 7}) {
      CAPTURE(static_cast<double>(friction), pyramid);
      const HardFinger<S> hard{friction, pyramid};
      clothctl_test::check_contact_laws<S>(hard, tolerance);
      clothctl_test::check_contact_laws<S>(AdhesiveFinger<S>{hard, S(2)}, tolerance);
      clothctl_test::check_contact_laws<S>(AdhesiveFinger<S>{hard, S(0)}, tolerance);
      for (const S e : {S(0), S(0.004)})
        clothctl_test::check_contact_laws<S>(SoftFinger<S>{friction, e, pyramid}, tolerance);
    }
  }
}

TEST_CASE("a frictionless finger transmits no tangential force", "[contact]") {
  const Frictionless<double> model;
  const ContactPatch<double> patch = contact_patch<double>(1, false);
  const auto violation = [&](double tangential, double normal) {
    Points<double> f(3, 1);
    f << tangential, 0, normal;
    return model.violation(patch.points, patch.normals, f, 5.0);
  };
  CHECK(violation(0, 2) == 0.0);
  CHECK(violation(0.25, 2) == Approx(0.25));
  CHECK(violation(0, -0.5) == Approx(0.5));
}

TEST_CASE("a hard finger keeps Coulomb's law at each vertex", "[contact]") {
  const HardFinger<double> model{0.5, 4};
  const ContactPatch<double> patch = contact_patch<double>(2, false);
  Points<double> f(3, 2);
  f << 0.5, 0, 0, 0, 1, 3;  // on the surface of the cone, and inside it
  CHECK(model.violation(patch.points, patch.normals, f, 5.0) <= 1e-15);
  f(0, 0) = 0.6;  // the second vertex's normal force would suffice for both, but does not count
  CHECK(model.violation(patch.points, patch.normals, f, 5.0) == Approx(0.1));
  f(0, 0) = 0;
  CHECK(model.violation(patch.points, patch.normals, f, 3.5) == Approx(0.5));  // 4 N in total
}

TEST_CASE("a soft finger transmits a torsion of up to e f_n about the normal", "[contact]") {
  const double e = 0.004;
  const SoftFinger<double> model{0.5, e, 4};
  for (const Index m : {2, 4, 6}) {
    CAPTURE(m);
    const ContactPatch<double> patch = contact_patch<double>(m, false);
    REQUIRE(model.generators(m) == 6);
    for (const Index i : {4, 5}) {
      const Points<double> f = contact_forces<double>(model, patch, unit(6, i, 3.0));
      CHECK(torsion(patch, f) == Approx((i == 4 ? 1 : -1) * e * 3.0));
      const Vector3<double> total = f.rowwise().sum();
      CHECK((total - Vector3<double>(0, 0, 3)).norm() <= 1e-14);
      CHECK(model.violation(patch.points, patch.normals, f, 3.0) <= 1e-14);
    }
    // The couple of the two: torsion without a net force.
    MatrixX<double> G(3 * m, 6);
    model.fill(patch.points, patch.normals, G);
    const VectorX<double> couple = G.col(4) - G.col(5);
    Vector3<double> net = Vector3<double>::Zero();
    for (Index j = 0; j < m; ++j) net += couple.segment<3>(3 * j);
    CHECK(net.norm() <= 1e-14);
    CHECK(couple.norm() > 0.1);
  }
}

TEST_CASE("a soft finger without friction transmits torsion up to e f_n and no more", "[contact]") {
  const double e = 0.005;
  const SoftFinger<double> model{0.0, e, 4};
  const ContactPatch<double> patch = contact_patch<double>(4, false);
  Points<double> f = contact_forces<double>(model, patch, unit(6, 4, 2.0));
  CHECK(model.violation(patch.points, patch.normals, f, 5.0) <= 1e-14);
  // Ten times the torsion. The vertices lie √½ · 10 mm from the centroid.
  f.topRows(2) *= 10;
  CHECK(torsion(patch, f) == Approx(10 * e * 2.0));
  CHECK(model.violation(patch.points, patch.normals, f, 5.0) ==
        Approx(9 * e * 2.0 / (0.01 * std::sqrt(0.5))));
}

TEST_CASE("vertices of a soft finger cannot pull against each other", "[contact]") {
  const SoftFinger<double> model{0.5, 0.004, 4};
  const ContactPatch<double> patch = contact_patch<double>(2, false);
  for (const Index c : {0, 1, 2}) {
    CAPTURE(c);
    Points<double> f = Points<double>::Zero(3, 2);
    f.row(2).setConstant(1.0);
    CHECK(model.violation(patch.points, patch.normals, f, 5.0) == 0.0);
    f(c, 0) += 100.0;
    f(c, 1) -= 100.0;  // neither a net force nor, along x and z, a torsion
    CHECK(model.violation(patch.points, patch.normals, f, 5.0) >= 99.0);
  }
}

TEST_CASE("friction and torsion of a soft finger are limited by one ellipsoid", "[contact]") {
  const double mu = 0.5, e = 0.004;
  const SoftFinger<double> model{mu, e, 4};
  const ContactPatch<double> patch = contact_patch<double>(4, false);
  // Half of the normal force at a torsional generator: with τ = e/2 f_n, |f_t| is at most √(3/4) μ
  // f_n.
  Points<double> f = contact_forces<double>(model, patch, unit(6, 4, 1.0));
  f.row(2).array() += 1.0 / 4;
  f.row(0).array() += 0.99 * std::sqrt(0.75) * mu * 2.0 / 4;
  CHECK(torsion(patch, f) == Approx(e));
  CHECK(model.violation(patch.points, patch.normals, f, 5.0) == 0.0);
  f.row(0) *= 1.02 / 0.99;
  CHECK(model.violation(patch.points, patch.normals, f, 5.0) > 0.005);
}

TEST_CASE("a soft finger on one vertex transmits no torsion", "[contact]") {
  const SoftFinger<double> model{0.5, 0.004, 4};
  const ContactPatch<double> patch = contact_patch<double>(1, false);
  MatrixX<double> G(3, 6);
  model.fill(patch.points, patch.normals, G);
  for (const Index i : {4, 5}) CHECK((G.col(i) - patch.normals.col(0)).norm() == 0.0);
}

TEST_CASE("an adhesive finger pulls up to its adhesion", "[contact]") {
  const AdhesiveFinger<double> model{{0.5, 4}, 2.0};
  CHECK(contact_traits<AdhesiveFinger<double>>::adhesion(model) == 2.0);
  for (const Index m : {1, 3}) {
    CAPTURE(m);
    const ContactPatch<double> patch = contact_patch<double>(m, false);
    const VectorX<double> none = VectorX<double>::Zero(model.generators(m));
    const Points<double> apex = contact_forces<double>(model, patch, none);
    CHECK(apex.row(2).sum() == Approx(-2.0));
    CHECK(model.violation(patch.points, patch.normals, apex, 5.0) <= 1e-15);
    // Without pressure, friction μ a remains: |f_t| <= μ (f_n + a/m).
    Points<double> f = Points<double>::Zero(3, m);
    f.row(0).setConstant(0.5 * 2.0 / static_cast<double>(m));
    CHECK(model.violation(patch.points, patch.normals, f, 5.0) <= 1e-15);
    f.row(0) *= 1.5;
    CHECK(model.violation(patch.points, patch.normals, f, 5.0) ==
          Approx(0.5 / static_cast<double>(m)));
    CHECK(HardFinger<double>{0.5, 4}.violation(patch.points, patch.normals, apex, 5.0) > 0.5);
  }
}

TEST_CASE("a bad parameter of a contact is named with its value", "[contact]") {
  const double nan = std::nan("");
  CHECK(HardFinger<double>{-0.5, 4}.validate().find("friction coefficient -0.5") !=
        std::string::npos);
  CHECK(HardFinger<double>{0.5, 3}.validate() == "3 generators, must be 4 to 1024");
  CHECK(HardFinger<double>{nan, 4}.validate() != "");
  CHECK(SoftFinger<double>{0.5, -1.0, 4}.validate().find("torsional friction -1") !=
        std::string::npos);
  CHECK(SoftFinger<double>{0.5, 0.01, 3}.validate() != "");
  CHECK(AdhesiveFinger<double>{{0.5, 4}, -2.0}.validate().find("adhesion -2") != std::string::npos);
  CHECK(AdhesiveFinger<double>{{0.5, 2}, 2.0}.validate() != "");
  CHECK(AdhesiveFinger<double>{{0.5, 4}, nan}.validate() != "");
}
