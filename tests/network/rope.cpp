#include "clothctl/network/rope.hpp"

#include <cmath>
#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("a rope hangs from the origin along -z, with mass proportional to its length",
                   "[cloth]", float, double) {
  using S = TestType;
  RopeSettings<S> settings;
  settings.length = S(0.6);
  settings.segments = 15;
  const auto rope = rope_network(settings);
  REQUIRE(rope);
  CHECK(rope->validate().empty());
  CHECK(rope->vertex_count() == 16);
  CHECK(rope->springs.size() == 15);
  CHECK(rope->bends.size() == 14);
  CHECK(rope->triangles.empty());
  CHECK(rope->rest_positions.col(0) == Vector3<S>::Zero());
  CHECK((rope->rest_positions.col(15) - Vector3<S>(S(0), S(0), S(-0.6))).norm() <=
        scalar_traits<S>::epsilon());
  CHECK(static_cast<double>(rope->mass.sum()) == Approx(0.04 * 0.6).epsilon(1e-6));
  CHECK(static_cast<double>(rope->mass[0]) == Approx(0.5 * 0.04 * 0.04).epsilon(1e-6));
  for (int i = 0; i < 15; ++i) {
    const Spring<S>& s = rope->springs[static_cast<std::size_t>(i)];
    CHECK((s.a == i && s.b == i + 1));
    CHECK(static_cast<double>(s.rest_length) == Approx(0.04).epsilon(1e-5));
    CHECK(static_cast<double>(s.damping) ==
          Approx(0.002 * static_cast<double>(s.stiffness)).epsilon(1e-6));
  }
}

TEST_CASE("a rope's stiffness and bending do not depend on the number of segments", "[cloth]") {
  RopeSettings<double> settings;
  for (int segments : {4, 10, 33}) {
    settings.segments = segments;
    const auto rope = rope_network(settings);
    REQUIRE(rope);
    // Springs in a row: 1/k = Σ 1/k_i = length / EA.
    double compliance = 0, rest = 0;
    for (const Spring<double>& s : rope->springs) {
      compliance += 1.0 / s.stiffness;
      rest += s.rest_length;
    }
    CHECK(1.0 / compliance == Approx(settings.stretch / settings.length).epsilon(1e-12));
    CHECK(rest == Approx(settings.length).epsilon(1e-12));
    // A parabola of curvature κ: each inner vertex stands for one segment, with energy ½ EI κ² l.
    const double curvature = 0.7, l = settings.length / segments;
    double energy = 0;
    for (const BendStencil<double>& s : rope->bends) {
      double value = 0;
      for (std::size_t i = 0; i < 3; ++i) {
        const double z = rope->rest_positions(2, s.vertex[i]);
        value += s.weight[i] * 0.5 * curvature * z * z;
      }
      energy += 0.5 * s.stiffness * value * value;
    }
    CHECK(
        energy ==
        Approx(0.5 * settings.bending * curvature * curvature * l * (segments - 1)).epsilon(1e-9));
  }
}

TEMPLATE_TEST_CASE("a straight rope has no bending energy in any direction and at any stretch",
                   "[cloth]", float, double) {
  using S = TestType;
  const auto rope = rope_network(RopeSettings<S>{});
  REQUIRE(rope);
  for (const BendStencil<S>& s : rope->bends) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < 3; ++i) {
      const double z = static_cast<double>(rope->rest_positions(2, s.vertex[i]));
      sum += static_cast<double>(s.weight[i]) * Eigen::Vector3d(0.3 + 1.4 * z, -0.7 * z, 0.2 * z);
    }
    CHECK(sum.norm() < (std::is_same_v<S, float> ? 1e-6 : 1e-14));
  }
}

TEST_CASE("the shortest rope has one spring and no bending", "[cloth]") {
  RopeSettings<double> settings;
  settings.segments = 1;
  const auto rope = rope_network(settings);
  REQUIRE(rope);
  CHECK(rope->springs.size() == 1);
  CHECK(rope->bends.empty());
}

TEMPLATE_TEST_CASE("bad ropes are refused with a message", "[cloth]", float, double) {
  using S = TestType;
  RopeSettings<S> settings;
  settings.segments = 0;
  CHECK(rope_network(settings).error() == "rope needs at least 1 segment, got 0");
  settings = RopeSettings<S>();
  settings.length = S(-2);
  CHECK(rope_network(settings).error() == "rope length must be positive, got -2");
  settings = RopeSettings<S>();
  settings.bending = S(-1);
  CHECK(rope_network(settings).error() == "rope bending must not be negative, got -1");
  settings = RopeSettings<S>();
  settings.stretch = std::numeric_limits<S>::quiet_NaN();
  CHECK(rope_network(settings).error() == "rope stretch is not a finite number");
  settings = RopeSettings<S>();
  settings.mass_per_length = S(0);
  CHECK(rope_network(settings).error() == "rope mass_per_length must be positive, got 0");
  settings = RopeSettings<S>();
  settings.damping_time = std::numeric_limits<S>::infinity();
  CHECK_FALSE(rope_network(settings));
}
