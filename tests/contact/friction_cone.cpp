#include "clothctl/contact/friction_cone.hpp"

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;

namespace {

template <class S>
Vector3<S> random_unit(std::mt19937& random) {
  std::normal_distribution<double> normal;
  Eigen::Vector3d v;
  do {
    for (int c = 0; c < 3; ++c) v[c] = normal(random);
  } while (v.norm() < 0.1);
  return (v / v.norm()).cast<S>();
}

}  // namespace

TEMPLATE_TEST_CASE("the tangent frame is orthonormal and right-handed for every normal",
                   "[contact]", float, double) {
  using S = TestType;
  std::mt19937 random(11);
  const S near = S(8) * scalar_traits<S>::epsilon();
  std::vector<Vector3<S>> normals;
  for (int c = 0; c < 3; ++c) {
    for (const S sign : {S(1), S(-1)}) {
      normals.push_back(sign * Vector3<S>::Unit(c));
      for (const S tilt : {S(1e-20), S(1e-8), S(1e-3)}) {  // near an axis
        Vector3<S> n = sign * Vector3<S>::Unit(c);
        n[(c + 1) % 3] = tilt;
        normals.push_back(n / n.norm());
      }
    }
  }
  for (const S z : {S(0.8999), S(0.9), S(0.9001)})
    normals.push_back({std::sqrt(S(1) - z * z), S(0), z});  // near the switch between axes
  for (int i = 0; i < 1000; ++i) normals.push_back(random_unit<S>(random));
  for (const Vector3<S>& n : normals) {
    Vector3<S> t1, t2;
    tangent_frame(n, t1, t2);
    Matrix3<S> frame;
    frame << t1, t2, n;
    CAPTURE(n.transpose());
    CHECK((frame.transpose() * frame - Matrix3<S>::Identity()).cwiseAbs().maxCoeff() <= near);
    CHECK(static_cast<double>(frame.determinant()) ==
          Approx(1.0).margin(static_cast<double>(near)));
  }
}

TEMPLATE_TEST_CASE("generators are unit vectors on the cone, evenly spaced about the normal",
                   "[contact]", float, double) {
  using S = TestType;
  std::mt19937 random(12);
  std::uniform_real_distribution<double> uniform(0.0, 3.0);
  const S near = S(16) * scalar_traits<S>::epsilon();
  for (int trial = 0; trial < clothctl_test::trials(200, 5000); ++trial) {
    const Vector3<S> n = random_unit<S>(random);
    const S mu = trial == 0 ? S(0) : S(uniform(random));
    const Index count = 4 + trial % 13;
    CAPTURE(n.transpose(), mu, count);
    Points<S> generators(3, count);
    friction_generators(n, mu, generators);
    for (Index i = 0; i < count; ++i) {
      const Vector3<S> s = generators.col(i);
      const S along = s.dot(n);
      CHECK(std::abs(s.norm() - S(1)) <= near);
      CHECK(std::abs((s - along * n).norm() - mu * along) <= near);  // on the surface of the cone
      CHECK(along > S(0));
      if (mu == S(0)) continue;
      // Neighbours are 1/n turn apart, in the positive sense.
      const Vector3<S> here = (s - along * n).normalized();
      const Vector3<S> there = (generators.col((i + 1) % count) - along * n).normalized();
      const double turn = 2.0 * std::numbers::pi / static_cast<double>(count);
      CHECK(static_cast<double>(here.dot(there)) ==
            Approx(std::cos(turn)).margin(100 * static_cast<double>(near / mu)));
      CHECK(static_cast<double>(here.cross(there).dot(n)) ==
            Approx(std::sin(turn)).margin(100 * static_cast<double>(near / mu)));
    }
  }
}

TEST_CASE(
    "any non-negative combination lies in the true cone, and the pyramid loses 1 - cos(pi/n) of "
    "friction",
    "[contact]") {
  std::mt19937 random(13);
  std::exponential_distribution<double> weight;
  for (int trial = 0; trial < clothctl_test::trials(100, 3000); ++trial) {
    const Eigen::Vector3d n = random_unit<double>(random);
    const double mu = 0.05 + 0.02 * (trial % 60);
    const Index count = 4 + trial % 13;
    Points<double> generators(3, count);
    friction_generators(n, mu, generators);
    Eigen::Vector3d force = Eigen::Vector3d::Zero();
    double normal_part = 0;
    for (Index i = 0; i < count; ++i) {
      const double d = weight(random);
      force += d * generators.col(i);
      normal_part += d / std::sqrt(1 + mu * mu);
    }
    CHECK(force.dot(n) == Approx(normal_part).epsilon(1e-12));
    CHECK(cone_violation(force, n, mu, 1e9) <= 1e-12 * force.norm());
    // Half way between two neighbours the pyramid is narrowest.
    const Eigen::Vector3d between = generators.col(0) + generators.col(1);
    const double reach = (between - between.dot(n) * n).norm() / (mu * between.dot(n));
    CHECK(1 - reach ==
          Approx(1 - std::cos(std::numbers::pi / static_cast<double>(count))).margin(1e-12));
  }
}

TEMPLATE_TEST_CASE("generators are written to a block of a larger matrix without allocating",
                   "[contact]", float, double) {
  using S = TestType;
  MatrixX<S> matrix = MatrixX<S>::Constant(6, 12, S(7));
  const Vector3<S> n(S(0), S(0.6), S(0.8));
  const long before = clothctl_test::allocations();
  friction_generators<S>(n, S(0.5), matrix.block(3, 4, 3, 5));
  const long during = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(during == 0);
  CHECK((matrix.array() != S(7)).count() == 15);
  CHECK((matrix.topRows(3).array() == S(7)).all());
}

TEMPLATE_TEST_CASE("the violation of the cone is measured in newtons", "[contact]", float, double) {
  using S = TestType;
  const Vector3<S> n = Vector3<S>::UnitZ();
  const auto violation = [&](double x, double z) {
    return static_cast<double>(cone_violation<S>({S(x), S(0), S(z)}, n, S(0.5), S(10)));
  };
  CHECK(violation(0, 0) == 0.0);
  CHECK(violation(1, 2) == 0.0);      // on the surface
  CHECK(violation(0.2, 9.9) == 0.0);  // inside
  CHECK(violation(2, 2) == Approx(1.0));
  CHECK(violation(0, 12) == Approx(2.0));
  CHECK(violation(0, -3) == Approx(3.0));  // pulls; -f_n is larger than |f_t| - mu f_n
  CHECK(violation(4, -3) == Approx(5.5));  // pulls; -f_n is smaller
  const S nan = std::numeric_limits<S>::quiet_NaN();
  const S infinity = std::numeric_limits<S>::infinity();
  for (const S bad : {nan, infinity, -infinity}) {
    CHECK(cone_violation<S>({bad, S(0), S(1)}, n, S(0.5), S(10)) > S(1e30));
    CHECK(cone_violation<S>({S(0), S(0), bad}, n, S(0.5), S(10)) > S(1e30));
    CHECK(cone_violation<S>({S(0), S(0), S(1)}, n, S(0.5), bad) > S(1e30));
    CHECK(cone_violation<S>({S(0), S(0), S(1)}, n, bad, S(10)) > S(1e30));
  }
}
