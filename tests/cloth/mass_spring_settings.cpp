#include "clothctl/cloth/mass_spring_settings.hpp"

#include <limits>
#include <string>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// Returns what validate() says about the defaults after `change`.
template <class Scalar, class Change>
std::string said(Change change) {
  MassSpringSettings<Scalar> settings;
  change(settings);
  return settings.validate();
}

const std::string kGravity[] = {"gravity x", "gravity y", "gravity z"};

template <class Scalar>
using Limits = std::numeric_limits<Scalar>;

}  // namespace

TEMPLATE_TEST_CASE("mass-spring settings: the defaults are valid and as documented",
                   "[mass_spring_settings]", float, double) {
  using Scalar = TestType;
  const MassSpringSettings<Scalar> settings;
  CHECK(settings.validate().empty());
  CHECK(settings.integration == Integration::LinearlyImplicit);
  CHECK(settings.gravity == Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-9.81)));
  CHECK(settings.drag == Scalar(0));
  CHECK_FALSE(settings.air.enabled());
  CHECK(settings.velocity_tolerance == Scalar(0));
  CHECK(settings.max_iterations >= 1);
  CHECK(settings.pinned.empty());
  CHECK(settings.limit_energy);
  CHECK(settings.linear_solver == LinearSolver::Factor);
  CHECK(settings.max_linear_iterations >= 1);
}

TEMPLATE_TEST_CASE("mass-spring settings: extreme but valid values are accepted",
                   "[mass_spring_settings]", float, double) {
  using Scalar = TestType;
  using Settings = MassSpringSettings<Scalar>;
  CHECK(said<Scalar>([](Settings& s) { s.integration = Integration::Newton; }).empty());
  CHECK(said<Scalar>([](Settings& s) { s.gravity.setZero(); }).empty());
  CHECK(said<Scalar>([](Settings& s) { s.gravity.setConstant(Limits<Scalar>::max()); }).empty());
  CHECK(said<Scalar>([](Settings& s) { s.gravity.setConstant(Limits<Scalar>::lowest()); }).empty());
  for (const Scalar good : {Scalar(0), Limits<Scalar>::min(), Scalar(0.3), Limits<Scalar>::max()}) {
    CHECK(said<Scalar>([&](Settings& s) { s.drag = good; }).empty());
    CHECK(said<Scalar>([&](Settings& s) { s.velocity_tolerance = good; }).empty());
    CHECK(said<Scalar>([&](Settings& s) { s.air = {good, good, good}; }).empty());
  }
  CHECK(said<Scalar>([](Settings& s) { s.max_iterations = 1; }).empty());
}

TEMPLATE_TEST_CASE("mass-spring settings: a bad value is named", "[mass_spring_settings]", float,
                   double) {
  using Scalar = TestType;
  using Settings = MassSpringSettings<Scalar>;
  const Scalar nan = Limits<Scalar>::quiet_NaN(), infinity = Limits<Scalar>::infinity();
  for (Index axis = 0; axis < 3; ++axis) {
    for (const Scalar bad : {nan, infinity, -infinity}) {
      CHECK(said<Scalar>([&](Settings& s) { s.gravity[axis] = bad; }) ==
            bad_number_line(kGravity[static_cast<std::size_t>(axis)], "is not finite", bad));
    }
  }
  for (const Scalar bad : {-Limits<Scalar>::min(), Scalar(-1), nan, infinity, -infinity}) {
    CHECK(said<Scalar>([&](Settings& s) { s.drag = bad; }) ==
          "drag is negative or not finite: " + number_text(bad));
    CHECK(said<Scalar>([&](Settings& s) { s.velocity_tolerance = bad; }) ==
          "velocity_tolerance is negative or not finite: " + number_text(bad));
    CHECK(said<Scalar>([&](Settings& s) { s.air.density = bad; }) ==
          "air density is negative or not finite: " + number_text(bad));
    CHECK(said<Scalar>([&](Settings& s) { s.air.normal_coefficient = bad; }) ==
          "normal air coefficient is negative or not finite: " + number_text(bad));
    CHECK(said<Scalar>([&](Settings& s) { s.air.tangent_coefficient = bad; }) ==
          "tangent air coefficient is negative or not finite: " + number_text(bad));
  }
  CHECK(said<Scalar>([](Settings& s) { s.max_iterations = 0; }) ==
        "max_iterations is 0, must be at least 1");
  CHECK(said<Scalar>([](Settings& s) { s.max_iterations = -1; }) ==
        "max_iterations is -1, must be at least 1");
  CHECK(said<Scalar>([](Settings& s) { s.max_linear_iterations = 0; }) ==
        "max_linear_iterations is 0, must be at least 1");
}

TEST_CASE("mass-spring settings: the first of several bad values is named",
          "[mass_spring_settings]") {
  MassSpringSettings<double> settings;
  settings.air.density = -1;
  settings.max_iterations = 0;
  CHECK(settings.validate() == "max_iterations is 0, must be at least 1");
  settings.velocity_tolerance = -1;
  CHECK(settings.validate() == "velocity_tolerance is negative or not finite: -1");
  settings.drag = -1;
  CHECK(settings.validate() == "drag is negative or not finite: -1");
  settings.gravity[2] = std::numeric_limits<double>::quiet_NaN();
  CHECK(settings.validate() == "gravity z is not finite: nan");
}

TEST_CASE(
    "mass-spring settings of a material take its drag, and its air coefficients if there is wind",
    "[mass_spring_settings]") {
  Material<double> material;
  material.drag = 0.7;
  material.air_normal = 1.3;
  material.air_tangent = 0.2;
  const MassSpringSettings<double> calm = MassSpringSettings<double>::of(material),
                                   windy = MassSpringSettings<double>::of(material, true);
  CHECK((calm.drag == 0.7 && windy.drag == 0.7));
  CHECK_FALSE(calm.air.enabled());
  CHECK((windy.air.density == 1.2 && windy.air.normal_coefficient == 1.3 &&
         windy.air.tangent_coefficient == 0.2));
  CHECK(windy.validate().empty());
}
