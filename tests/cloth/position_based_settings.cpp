#include "clothctl/cloth/position_based_settings.hpp"

#include <limits>
#include <string>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// Four vertices in a row, three springs.
template <class Scalar>
SpringNetwork<Scalar> row_of_four() {
  SpringNetwork<Scalar> network;
  network.rest_positions.setZero(3, 4);
  network.mass.setConstant(4, Scalar(0.1));
  for (int i = 0; i < 4; ++i) network.rest_positions(0, i) = Scalar(i);
  for (int i = 0; i < 3; ++i)
    network.springs.push_back({i, i + 1, Scalar(1), Scalar(10), Scalar(0)});
  return network;
}

/// Returns what validate() says about the defaults after `change`, for the row of four vertices.
template <class Scalar, class Change>
std::string said(Change change) {
  PositionBasedSettings<Scalar> settings;
  change(settings);
  return settings.validate(row_of_four<Scalar>());
}

const std::string kGravity[] = {"gravity x", "gravity y", "gravity z"};

template <class Scalar>
using Limits = std::numeric_limits<Scalar>;

}  // namespace

TEMPLATE_TEST_CASE("position-based settings: the defaults are valid and as documented",
                   "[position_based_settings]", float, double) {
  using Scalar = TestType;
  const PositionBasedSettings<Scalar> settings;
  CHECK(settings.validate(row_of_four<Scalar>()).empty());
  CHECK(settings.scheme == PositionScheme::Xpbd);
  CHECK(settings.substeps == 20);
  CHECK(settings.iterations == 2);
  CHECK(settings.gravity == Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-9.81)));
  CHECK(settings.drag == Scalar(0));
  CHECK(settings.stretch_limit == Scalar(0));
  CHECK(settings.free_compression == Scalar(0.1));
  CHECK(settings.compression == Scalar(0.1));
  CHECK(settings.extra_sweeps == 60);
  CHECK(settings.verlet_damping == Scalar(0.01));
  CHECK(settings.bend_relaxation == Scalar(0.2));
  CHECK_FALSE(settings.air.enabled());
  CHECK(settings.spring_relaxation.empty());
  CHECK(settings.pinned.empty());
}

TEMPLATE_TEST_CASE("position-based settings: verlet() is the scheme of [Toh 2011] and valid",
                   "[position_based_settings]", float, double) {
  using Scalar = TestType;
  const PositionBasedSettings<Scalar> settings = PositionBasedSettings<Scalar>::verlet();
  CHECK(settings.validate(row_of_four<Scalar>()).empty());
  CHECK(settings.scheme == PositionScheme::Verlet);
  CHECK(settings.substeps == 1);
  CHECK(settings.iterations == 15);
  CHECK(settings.verlet_damping == Scalar(0.01));
  // All other values are the defaults.
  const PositionBasedSettings<Scalar> defaults;
  CHECK(settings.gravity == defaults.gravity);
  CHECK(settings.drag == defaults.drag);
  CHECK(settings.bend_relaxation == defaults.bend_relaxation);
  CHECK(settings.spring_relaxation.empty());
  CHECK_FALSE(settings.air.enabled());
  CHECK(settings.pinned.empty());
}

TEMPLATE_TEST_CASE("position-based settings: extreme but valid values are accepted",
                   "[position_based_settings]", float, double) {
  using Scalar = TestType;
  using Settings = PositionBasedSettings<Scalar>;
  CHECK(said<Scalar>([](Settings& s) { s.substeps = 1; }).empty());
  CHECK(said<Scalar>([](Settings& s) { s.iterations = 1; }).empty());
  CHECK(said<Scalar>([](Settings& s) { s.gravity.setZero(); }).empty());
  CHECK(said<Scalar>([](Settings& s) { s.pinned = {0, 1, 2, 3}; }).empty());
  for (const Scalar good : {Scalar(0), Limits<Scalar>::min(), Scalar(0.3), Limits<Scalar>::max()}) {
    CHECK(said<Scalar>([&](Settings& s) { s.drag = good; }).empty());
    CHECK(said<Scalar>([&](Settings& s) { s.stretch_limit = good; }).empty());
    CHECK(said<Scalar>([&](Settings& s) { s.air = {good, good, good}; }).empty());
  }
  for (const Scalar part : {Scalar(0), Limits<Scalar>::min(), Scalar(0.3), Scalar(1)}) {
    CHECK(said<Scalar>([&](Settings& s) { s.verlet_damping = part; }).empty());
    CHECK(said<Scalar>([&](Settings& s) { s.bend_relaxation = part; }).empty());
    CHECK(said<Scalar>([&](Settings& s) { s.compression = part; }).empty());
    CHECK(said<Scalar>([&](Settings& s) { s.free_compression = part; }).empty() ==
          (part < Scalar(1)));
    CHECK(said<Scalar>([&](Settings& s) { s.spring_relaxation.assign(3, part); }).empty());
  }
}

TEMPLATE_TEST_CASE("position-based settings: a bad value is named", "[position_based_settings]",
                   float, double) {
  using Scalar = TestType;
  using Settings = PositionBasedSettings<Scalar>;
  const Scalar nan = Limits<Scalar>::quiet_NaN(), infinity = Limits<Scalar>::infinity();
  CHECK(said<Scalar>([&](Settings& s) { s.substeps = 1000001; }) ==
        "substeps is 1000001, must be 1 to 1000000");
  for (const int bad : {0, -1}) {
    const std::string tail = " is " + std::to_string(bad) + ", must be at least 1";
    CHECK(said<Scalar>([&](Settings& s) { s.substeps = bad; }) ==
          "substeps is " + std::to_string(bad) + ", must be 1 to 1000000");
    CHECK(said<Scalar>([&](Settings& s) { s.iterations = bad; }) == "iterations" + tail);
  }
  for (Index axis = 0; axis < 3; ++axis) {
    for (const Scalar bad : {nan, infinity, -infinity}) {
      CHECK(said<Scalar>([&](Settings& s) { s.gravity[axis] = bad; }) ==
            bad_number_line(kGravity[static_cast<std::size_t>(axis)], "is not finite", bad));
    }
  }
  for (const Scalar bad : {-Limits<Scalar>::min(), Scalar(-1), nan, infinity, -infinity}) {
    CHECK(said<Scalar>([&](Settings& s) { s.drag = bad; }) ==
          "drag is negative or not finite: " + number_text(bad));
    CHECK(said<Scalar>([&](Settings& s) { s.stretch_limit = bad; }) ==
          "stretch limit is negative or not finite: " + number_text(bad));
    CHECK(said<Scalar>([&](Settings& s) { s.air.density = bad; }) ==
          "air density is negative or not finite: " + number_text(bad));
    CHECK(said<Scalar>([&](Settings& s) { s.air.normal_coefficient = bad; }) ==
          "normal air coefficient is negative or not finite: " + number_text(bad));
    CHECK(said<Scalar>([&](Settings& s) { s.air.tangent_coefficient = bad; }) ==
          "tangent air coefficient is negative or not finite: " + number_text(bad));
  }
  for (const Scalar bad : {-Limits<Scalar>::min(), Scalar(-1),
                           Scalar(1) + Limits<Scalar>::epsilon(), nan, infinity, -infinity}) {
    CHECK(said<Scalar>([&](Settings& s) { s.verlet_damping = bad; }) ==
          "verlet damping is outside 0 to 1: " + number_text(bad));
    CHECK(said<Scalar>([&](Settings& s) { s.bend_relaxation = bad; }) ==
          "bend relaxation is outside 0 to 1: " + number_text(bad));
    CHECK(said<Scalar>([&](Settings& s) { s.compression = bad; }) ==
          "compression is outside 0 to 1: " + number_text(bad));
    CHECK(said<Scalar>([&](Settings& s) { s.free_compression = bad; }) ==
          "free compression is not from 0 to less than 1: " + number_text(bad));
    for (std::size_t e = 0; e < 3; ++e) {
      CHECK(said<Scalar>([&](Settings& s) {
              s.spring_relaxation.assign(3, Scalar(0.5));
              s.spring_relaxation[e] = bad;
            }) == "relaxation of spring " + std::to_string(e) +
                      " is outside 0 to 1: " + number_text(bad));
    }
  }
  CHECK(said<Scalar>([](Settings& s) { s.extra_sweeps = -1; }) ==
        "extra_sweeps is -1, must be at least 0");
  CHECK(said<Scalar>([](Settings& s) {
          s.scheme = PositionScheme::Verlet;
          s.stretch_limit = Scalar(0.1);
        }) == "stretch limit needs the scheme Xpbd");
  CHECK(said<Scalar>([](Settings& s) { s.spring_relaxation.assign(2, Scalar(1)); }) ==
        "2 spring relaxations for 3 springs");
  CHECK(said<Scalar>([](Settings& s) { s.spring_relaxation.assign(4, Scalar(1)); }) ==
        "4 spring relaxations for 3 springs");
  CHECK(said<Scalar>([](Settings& s) {
          s.pinned = {0, -1};
        }) == "pinned vertex -1 is off the mesh of 4 vertices");
  CHECK(said<Scalar>([](Settings& s) {
          s.pinned = {4, 0};
        }) == "pinned vertex 4 is off the mesh of 4 vertices");
  CHECK(said<Scalar>([](Settings& s) {
          s.pinned = {3, 7, -2};
        }) == "pinned vertex 7 is off the mesh of 4 vertices");
}

TEST_CASE("position-based settings: the first of several bad values is named",
          "[position_based_settings]") {
  PositionBasedSettings<double> settings;
  const SpringNetwork<double> network = row_of_four<double>();
  settings.air.density = -1;
  settings.pinned = {4};
  CHECK(settings.validate(network) == "pinned vertex 4 is off the mesh of 4 vertices");
  settings.spring_relaxation = {1.0, 2.0, 3.0};
  CHECK(settings.validate(network) == "relaxation of spring 1 is outside 0 to 1: 2");
  settings.drag = -1;
  CHECK(settings.validate(network) == "drag is negative or not finite: -1");
  settings.substeps = 0;
  CHECK(settings.validate(network) == "substeps is 0, must be 1 to 1000000");
}

TEST_CASE("position-based settings: verlet() is validated in the same way",
          "[position_based_settings]") {
  PositionBasedSettings<double> settings = PositionBasedSettings<double>::verlet();
  settings.iterations = 0;
  CHECK(settings.validate(row_of_four<double>()) == "iterations is 0, must be at least 1");
}

TEST_CASE(
    "position-based settings of a material take its drag and, if there is wind, its air "
    "coefficients",
    "[position_based_settings]") {
  Material<double> material;
  material.drag = 0.7;
  material.air_normal = 1.3;
  material.air_tangent = 0.2;
  const PositionBasedSettings<double> calm = PositionBasedSettings<double>::of(material),
                                      windy = PositionBasedSettings<double>::of(material, true);
  CHECK((calm.drag == 0.7 && windy.drag == 0.7));
  CHECK_FALSE(calm.air.enabled());
  CHECK((windy.air.density == 1.2 && windy.air.normal_coefficient == 1.3 &&
         windy.air.tangent_coefficient == 0.2));
}
