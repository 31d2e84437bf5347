// Impact zones: which vertices they unite, that they move rigidly with their momentum, and follow
// driven vertices.

#include "clothctl/contact/detail/impact_zones.hpp"

#include <cmath>
#include <random>

#include "support/catch.hpp"
#include "support/meshes.hpp"

using namespace clothctl;
using clothctl_test::uniform;

namespace {

struct Scene {
  Points<double> x{3, 12}, wanted{3, 12};
  VectorX<double> inverse_mass{12};
  detail::ImpactZones<double> zones;

  explicit Scene(unsigned seed, double way = 0.1) {
    std::mt19937 random(seed);
    for (Index i = 0; i < x.size(); ++i) {
      x(i) = uniform(random, -1, 1);
      wanted(i) = x(i) + uniform(random, -way, way);
    }
    for (Index i = 0; i < 12; ++i) inverse_mass[i] = uniform(random, 1, 100);
    zones.resize(12);
  }
  Points<double> moved() const {
    Points<double> y = wanted;
    zones.move(x, wanted, inverse_mass, y);
    return y;
  }
};

}  // namespace

TEST_CASE("zones unite and know what is rigid", "[self_contact]") {
  Scene s(61);
  CHECK(s.zones.count() == 0);
  CHECK(s.zones.merge({0, 1, 2, 3}));
  CHECK_FALSE(s.zones.merge({3, 2, 1, 0}));
  CHECK(s.zones.merge({4, 5, 6, 7}));
  CHECK(s.zones.count() == 2);
  CHECK_FALSE(s.zones.rigid({0, 1, 2, 4}));
  CHECK(s.zones.merge({0, 4, 8, 8}));
  CHECK(s.zones.count() == 1);
  CHECK(s.zones.rigid({0, 4, 7, 8}));
  CHECK_FALSE(s.zones.rigid({0, 4, 7, 9}));
  s.zones.clear();
  CHECK(s.zones.count() == 0);
  s.zones.hold(1);
  CHECK(s.zones.merge({0, 1, 2, 3}));
  CHECK_FALSE(s.zones.rigid({0, 1, 2, 3}));
}

TEST_CASE("a zone moves rigidly and keeps momentum and spin", "[self_contact]") {
  Scene s(62, 0.01);
  s.zones.merge({0, 1, 2, 3});
  s.zones.merge({3, 4, 5, 6});
  const Points<double> y = s.moved();
  Vector3<double> before = Vector3<double>::Zero(), after = before, spin = before, spun = before;
  for (Index i = 0; i < 7; ++i) {
    const double m = 1 / s.inverse_mass[i];
    before += m * s.wanted.col(i);
    after += m * y.col(i);
    spin += m * Vector3<double>(s.x.col(i)).cross(Vector3<double>(s.wanted.col(i) - s.x.col(i)));
    spun += m * Vector3<double>(s.x.col(i)).cross(Vector3<double>(y.col(i) - s.x.col(i)));
    for (Index j = 0; j < i; ++j) {
      CHECK((y.col(i) - y.col(j)).norm() == Approx((s.x.col(i) - s.x.col(j)).norm()));
    }
  }
  CHECK((before - after).norm() <= 1e-15);
  // To the square of the angle.
  CHECK((spin - spun).norm() <= 1e-4);
  CHECK(y.rightCols(5) == s.wanted.rightCols(5));
}

TEST_CASE("a rotation that vertices share is kept, also in float", "[self_contact]") {
  Scene s(63);
  Matrix3<double> turn;
  const double a = 0.3;
  turn << std::cos(a), -std::sin(a), 0, std::sin(a), std::cos(a), 0, 0, 0, 1;
  s.wanted = turn * s.x;
  s.wanted.colwise() += Vector3<double>(0.2, 0.1, -0.3);
  s.zones.merge({0, 1, 2, 3});
  s.zones.merge({3, 4, 5, 6});
  // Angular momentum of a straight way gives sin a in place of a.
  CHECK((s.moved() - s.wanted).colwise().norm().maxCoeff() <= 0.02);
  detail::ImpactZones<float> zones;
  zones.resize(12);
  zones.merge({0, 1, 2, 3});
  const Points<float> x = s.x.cast<float>(), wanted = s.wanted.cast<float>();
  Points<float> y = wanted;
  zones.move(x, wanted, s.inverse_mass.cast<float>(), y);
  CHECK((y - wanted).colwise().norm().maxCoeff() <= 0.02F);
}

TEST_CASE("a zone follows its driven vertices, huge motion stays finite", "[self_contact]") {
  Scene s(64);
  for (const int v : {0, 1, 2}) {
    s.inverse_mass[v] = 0;
    s.zones.hold(v);
    s.wanted.col(v) = s.x.col(v) + Vector3<double>(0.3, 0, 0);
  }
  s.zones.merge({0, 1, 2, 3});
  const Points<double> y = s.moved();
  CHECK(y.leftCols(3) == s.wanted.leftCols(3));
  CHECK((y.col(3) - s.x.col(3) - Vector3<double>(0.3, 0, 0)).norm() <= 1e-4);
  Scene wild(65, 1e6);
  wild.zones.merge({0, 1, 2, 3});
  CHECK(wild.moved().allFinite());
  Scene point(66);
  point.x.setZero();
  point.zones.merge({0, 1, 2, 3});
  CHECK(point.moved().allFinite());
}
