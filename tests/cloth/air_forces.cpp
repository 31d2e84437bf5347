#include "clothctl/cloth/detail/air_forces.hpp"

#include <cmath>
#include <random>

#include <Eigen/Eigenvalues>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

template <class Scalar>
AirSettings<Scalar> some_air() {
  AirSettings<Scalar> air;
  air.normal_coefficient = Scalar(1.3);
  air.tangent_coefficient = Scalar(0.07);
  return air;
}

const std::vector<std::array<int, 3>> kSquare = {{0, 1, 2}, {0, 2, 3}};

/// The unit square in the plane z = 0.
Points<double> square() {
  Points<double> x(3, 4);
  x << 0, 1, 1, 0, 0, 0, 1, 1, 0, 0, 0, 0;
  return x;
}

Points<double> random_points(std::mt19937& random, Index n, double scale) {
  std::uniform_real_distribution<double> uniform(-scale, scale);
  return Points<double>::NullaryExpr(3, n, [&]() { return uniform(random); });
}

Points<double> forces_of(const Points<double>& x, const Points<double>& v,
                         const Vector3<double>& wind, const AirSettings<double>& air) {
  Points<double> forces = Points<double>::Zero(3, x.cols());
  add_air_forces(kSquare, x, v, wind, air, forces);
  return forces;
}

}  // namespace

TEST_CASE("a plate facing the wind feels ½ ρ A C_n v²", "[air]") {
  const AirSettings<double> air = some_air<double>();
  const Points<double> still = Points<double>::Zero(3, 4);
  for (double speed : {-7.0, -0.3, 0.0, 2.0}) {
    const Vector3<double> total =
        forces_of(square(), still, Vector3<double>(0, 0, speed), air).rowwise().sum();
    CHECK(total.z() == Approx(0.5 * 1.2 * 1.3 * speed * std::abs(speed)).margin(1e-15));
    CHECK(std::hypot(total.x(), total.y()) < 1e-15);
  }
}

TEST_CASE("wind along a plate causes friction only", "[air]") {
  const Vector3<double> total =
      forces_of(square(), Points<double>::Zero(3, 4), Vector3<double>(3, 4, 0), some_air<double>())
          .rowwise()
          .sum();
  CHECK(total.x() == Approx(0.5 * 1.2 * 0.07 * 5 * 3));
  CHECK(total.y() == Approx(0.5 * 1.2 * 0.07 * 5 * 4));
  CHECK(std::abs(total.z()) < 1e-15);
}

TEST_CASE("air that moves with the sheet exerts no force", "[air]") {
  const Vector3<double> wind(1.5, -2.0, 0.25);
  const Points<double> v = wind.replicate(1, 4);
  CHECK(forces_of(square(), v, wind, some_air<double>()).isZero(0.0));
}

TEST_CASE(
    "air forces dissipate energy, are invariant under velocity and rotation, and treat both sides "
    "alike",
    "[air]") {
  std::mt19937 random(3);
  const AirSettings<double> air = some_air<double>();
  for (int trial = 0; trial < 50; ++trial) {
    const Points<double> x = random_points(random, 4, 1.0);
    const Points<double> v = random_points(random, 4, 3.0);
    const Vector3<double> wind = random_points(random, 1, 4.0);
    const Points<double> forces = forces_of(x, v, wind, air);

    for (const std::array<int, 3>& t : kSquare) {
      Points<double> alone = Points<double>::Zero(3, 4);
      add_air_forces({t}, x, v, wind, air, alone);
      double power = 0;
      for (int i : t) power += alone.col(i).dot(v.col(i) - wind);
      CHECK(power <= 1e-14);
      Points<double> turned_over = Points<double>::Zero(3, 4);
      add_air_forces({{t[1], t[0], t[2]}}, x, v, wind, air, turned_over);
      CHECK((turned_over - alone).norm() < 1e-13);
    }

    const Vector3<double> shift = random_points(random, 1, 5.0);
    const Points<double> moving = forces_of(x, v.colwise() + shift, wind + shift, air);
    CHECK((moving - forces).norm() < 1e-12 * (1 + forces.norm()));

    const Matrix3<double> R =
        Eigen::Quaterniond(0.2, 0.5, -0.7, 0.1 * trial).normalized().toRotationMatrix();
    const Points<double> rotated = forces_of(R * x, R * v, R * wind, air);
    CHECK((rotated - R * forces).norm() < 1e-12 * (1 + forces.norm()));
  }
}

TEST_CASE("the drag matrix is symmetric positive semidefinite and gives the force", "[air]") {
  std::mt19937 random(4);
  const AirSettings<double> air = some_air<double>();
  for (int trial = 0; trial < 50; ++trial) {
    const Points<double> x = random_points(random, 3, 1.0);
    const Points<double> v = random_points(random, 3, 3.0);
    const Vector3<double> wind = random_points(random, 1, 4.0);
    const Vector3<double> v_mean = v.rowwise().mean();
    const Matrix3<double> C = air_drag_matrix(x.col(0), x.col(1), x.col(2), v_mean, wind, air);
    CHECK((C - C.transpose()).norm() < 1e-15);
    CHECK(Eigen::SelfAdjointEigenSolver<Matrix3<double>>(C).eigenvalues().minCoeff() > -1e-15);
    Points<double> forces = Points<double>::Zero(3, 3);
    add_air_forces({{0, 1, 2}}, x, v, wind, air, forces);
    for (Index i = 0; i < 3; ++i) CHECK((forces.col(i) - C * (wind - v_mean) / 3).norm() < 1e-13);
  }
}

TEMPLATE_TEST_CASE("a triangle without area feels no force", "[air]", float, double) {
  using Scalar = TestType;
  const Vector3<Scalar> a(Scalar(0.1), Scalar(0.2), Scalar(0.3)),
      b(Scalar(0.4), Scalar(0.1), Scalar(0.7));
  const Vector3<Scalar> wind(Scalar(5), Scalar(-3), Scalar(2)), zero = Vector3<Scalar>::Zero();
  const AirSettings<Scalar> air = some_air<Scalar>();
  CHECK(air_drag_matrix(a, a, a, zero, wind, air).isZero(Scalar(0)));
  CHECK(air_drag_matrix(a, b, a, zero, wind, air).isZero(Scalar(0)));
  CHECK(all_finite(air_drag_matrix(a, b, Vector3<Scalar>((a + b) / Scalar(2)), zero, wind, air)));
}

TEST_CASE("air impulses tend to force times time and lose energy for any time step", "[air]") {
  std::mt19937 random(5);
  const AirSettings<double> air = some_air<double>();
  VectorX<double> w(4);
  w << 10, 1e6, 0, 500;
  for (int trial = 0; trial < 20; ++trial) {
    const Points<double> x = random_points(random, 4, 1.0);
    const Points<double> v = random_points(random, 4, 3.0);
    const Vector3<double> wind = random_points(random, 1, 4.0);

    const double h = 1e-12;
    Points<double> after = v;
    apply_air_impulses(kSquare, x, w, wind, h, air, after);
    const Points<double> expected = h * forces_of(x, v, wind, air) * w.asDiagonal();
    CHECK((after - v - expected).norm() < 2e-5 * expected.norm());
    CHECK(after.col(2) == v.col(2));

    for (double step : {1e-3, 1.0, 1e6}) {
      after = v;
      const auto energy = [&](const Points<double>& u) {
        double sum = 0;
        for (Index i = 0; i < 4; ++i)
          sum += w[i] > 0 ? 0.5 / w[i] * (u.col(i) - wind).squaredNorm() : 0.0;
        return sum;
      };
      // A held vertex would add energy, so here it moves with the air.
      after.col(2) = wind;
      for (int repeat = 0; repeat < 5; ++repeat) {
        const double before = energy(after);
        apply_air_impulses(kSquare, x, w, wind, step, air, after);
        CHECK(energy(after) <= before * (1 + 1e-14));
      }
    }
  }
}

TEST_CASE("air is off by default, and bad settings are named", "[air]") {
  AirSettings<double> air;
  CHECK_FALSE(air.enabled());
  CHECK(air.validate().empty());
  CHECK(forces_of(square(), Points<double>::Zero(3, 4), Vector3<double>(0, 0, 9), air).isZero(0.0));
  air.normal_coefficient = -1;
  CHECK(air.validate() == "normal air coefficient is negative or not finite: -1");
  air.normal_coefficient = 1;
  CHECK(air.enabled());
  air.tangent_coefficient = std::nan("");
  CHECK(air.validate() == "tangent air coefficient is negative or not finite: nan");
  air.tangent_coefficient = 0;
  air.density = -0.5;
  CHECK(air.validate() == "air density is negative or not finite: -0.5");
  CHECK_FALSE(air.enabled());
}
