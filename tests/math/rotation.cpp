#include "clothctl/math/rotation.hpp"

#include <cmath>
#include <random>

#include <Eigen/Geometry>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class S>
Vector3<S> random_axis(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const Vector3<double> v(normal(random), normal(random), normal(random));
  return v.normalized().cast<S>();
}

template <class S>
double rounding() {
  return static_cast<double>(scalar_traits<S>::epsilon());
}

}  // namespace

TEMPLATE_TEST_CASE("the cross-product matrix multiplies like the cross product", "[rotation]",
                   float, double) {
  using S = TestType;
  std::mt19937 random(1);
  for (int trial = 0; trial < 20; ++trial) {
    const Vector3<S> v = random_axis<S>(random), u = random_axis<S>(random);
    CHECK(cross_matrix<S>(v) * u == v.cross(u));
    CHECK(cross_matrix<S>(v).transpose() == -cross_matrix<S>(v));
  }
}

TEMPLATE_TEST_CASE("exp agrees with Rodrigues' formula and is a rotation at every angle",
                   "[rotation]", float, double) {
  using S = TestType;
  std::mt19937 random(2);
  const double pi = std::acos(-1.0);
  for (const double angle :
       {0.0, 1e-300, 1e-30, 1e-12, 1e-6, 1e-4, 1e-3, 0.03, 0.7, 2.0, 3.1, pi, 4.5, 6.2, 20.0}) {
    for (int k = 0; k < 10; ++k) {
      const Vector3<S> axis = random_axis<S>(random);
      const Vector3<S> w = static_cast<S>(angle) * axis;
      const Matrix3<S> R = rotation_exp<S>(w);
      const Vector3<double> exact = w.template cast<double>();
      const Matrix3<double> K = cross_matrix<double>(Vector3<double>(axis.template cast<double>()));
      const double theta = exact.norm();
      const Matrix3<double> rodrigues =
          Matrix3<double>::Identity() + std::sin(theta) * K + (1 - std::cos(theta)) * K * K;
      CHECK((R.template cast<double>() - rodrigues).norm() < 16 * (1 + theta) * rounding<S>());
      CHECK(static_cast<double>((R.transpose() * R - Matrix3<S>::Identity()).norm()) <
            8 * rounding<S>());
      CHECK(static_cast<double>(R.determinant()) > 0);
    }
  }
}

TEST_CASE("exp of a small rotation vector has its first order accurate to the last digit",
          "[rotation]") {
  for (const double angle : {1e-4, 1e-5, 1e-8, 1e-15, 1e-100}) {
    const Vector3<double> w = angle * Vector3<double>(0.6, 0.0, 0.8);
    const Matrix3<double> R = rotation_exp<double>(w);
    // Half of R - Rᵀ is sinc(θ) [w].
    CHECK(std::abs(0.5 * (R(1, 0) - R(0, 1)) / (0.8 * angle) - (1 - angle * angle / 6)) < 4e-16);
    CHECK(std::abs(0.5 * (R(2, 1) - R(1, 2)) / (0.6 * angle) - (1 - angle * angle / 6)) < 4e-16);
  }
}

TEST_CASE("the series of exp meets the closed form at the switch", "[rotation]") {
  const double limit =
      2 * std::pow(scalar_traits<double>::epsilon(), 0.25);  // the full angle, not half of it
  for (const double angle : {limit * (1 - 1e-12), limit * (1 + 1e-12)}) {
    const QuaternionWxyz<double> q = quaternion_exp<double>(Vector3<double>(angle, 0, 0));
    CHECK(std::abs(q[1] / std::sin(0.5 * angle) - 1.0) < 4e-16);
  }
}

TEMPLATE_TEST_CASE("log inverts exp up to half a turn, also near zero and near pi", "[rotation]",
                   float, double) {
  using S = TestType;
  std::mt19937 random(3);
  const double pi = std::acos(-1.0);
  const double near_pi = sizeof(S) == sizeof(float) ? 1e-3 : 1e-7;
  for (const double angle : {0.0, 1e-12, 1e-5, 1e-3, 0.7, 2.0, 3.1, pi - near_pi}) {
    for (int k = 0; k < 12; ++k) {
      const Vector3<S> axis = k < 3 ? Vector3<S>(Vector3<S>::Unit(k)) : random_axis<S>(random);
      const Vector3<S> w = static_cast<S>(angle) * axis;
      const Vector3<S> back = rotation_log<S>(rotation_exp<S>(w));
      CHECK(static_cast<double>((back - w).norm()) < 16 * rounding<S>());
      const Vector3<S> through_quaternion = quaternion_log<S>(quaternion_exp<S>(w));
      CHECK(static_cast<double>((through_quaternion - w).norm()) <= 8 * angle * rounding<S>());
    }
  }
}

TEMPLATE_TEST_CASE("log of a half turn is one of its two vectors", "[rotation]", float, double) {
  using S = TestType;
  std::mt19937 random(4);
  const double pi = std::acos(-1.0);
  for (int k = 0; k < 40; ++k) {
    const Vector3<S> a = k < 3 ? Vector3<S>(Vector3<S>::Unit(k)) : random_axis<S>(random);
    const Matrix3<S> half_turn = S(2) * a * a.transpose() - Matrix3<S>::Identity();
    const Vector3<S> w = rotation_log<S>(half_turn);
    CHECK(std::abs(static_cast<double>(w.norm()) - pi) < 8 * rounding<S>());
    CHECK(static_cast<double>((rotation_exp<S>(w) - half_turn).norm()) < 32 * rounding<S>());
  }
}

TEST_CASE("log takes the shorter rotation and accepts a quaternion of any length", "[rotation]") {
  const double pi = std::acos(-1.0);
  const Vector3<double> w(0, 0, 1.5 * pi);
  const QuaternionWxyz<double> q = quaternion_exp<double>(w);
  CHECK((quaternion_log<double>(q) - Vector3<double>(0, 0, -0.5 * pi)).norm() < 1e-15);
  CHECK(
      (quaternion_log<double>(QuaternionWxyz<double>(-7.0 * q)) - Vector3<double>(0, 0, -0.5 * pi))
          .norm() < 1e-15);
  CHECK(quaternion_log<double>(QuaternionWxyz<double>::Zero()) == Vector3<double>::Zero());
}

TEMPLATE_TEST_CASE("matrices and quaternions convert into each other", "[rotation]", float,
                   double) {
  using S = TestType;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (int k = 0; k < 200; ++k) {
    QuaternionWxyz<S> q(S(normal(random)), S(normal(random)), S(normal(random)), S(normal(random)));
    if (k % 4 == 1) q[0] = S(0);
    if (k % 8 == 2) q.template tail<2>() *= S(1e-6);
    const Matrix3<S> R = rotation_from_quaternion<S>(q);
    const Eigen::Quaternion<S> peer(q[0], q[1], q[2], q[3]);
    CHECK(static_cast<double>((R - peer.normalized().toRotationMatrix()).norm()) <
          16 * rounding<S>());
    const QuaternionWxyz<S> back = quaternion_from_rotation<S>(R);
    CHECK(back[0] >= S(0));
    CHECK(std::abs(static_cast<double>(back.norm()) - 1.0) < 8 * rounding<S>());
    CHECK(std::abs(std::abs(static_cast<double>(back.dot(q) / q.norm())) - 1.0) <
          8 * rounding<S>());
  }
}

TEST_CASE("products compose rotations and the conjugate inverts them", "[rotation]") {
  std::mt19937 random(6);
  for (int k = 0; k < 20; ++k) {
    const QuaternionWxyz<double> a = quaternion_exp<double>(2.0 * random_axis<double>(random)),
                                 b = quaternion_exp<double>(random_axis<double>(random));
    const Matrix3<double> product =
        rotation_from_quaternion<double>(a) * rotation_from_quaternion<double>(b);
    CHECK((rotation_from_quaternion<double>(quaternion_product<double>(a, b)) - product).norm() <
          4e-15);
    CHECK((quaternion_product<double>(a, quaternion_conjugate<double>(a)) -
           QuaternionWxyz<double>(1, 0, 0, 0))
              .norm() < 1e-15);
  }
}

TEMPLATE_TEST_CASE("the shortest rotation maps one direction to the other, also opposite ones",
                   "[rotation]", float, double) {
  using S = TestType;
  std::mt19937 random(7);
  for (int k = 0; k < 60; ++k) {
    const Vector3<S> from = random_axis<S>(random);
    const Vector3<S> to = k % 3 == 0   ? Vector3<S>(-from)
                          : k % 3 == 1 ? from
                                       : random_axis<S>(random);
    const Vector3<S> w = shortest_rotation<S>(from, to);
    CHECK(static_cast<double>((rotation_exp<S>(w) * from - to).norm()) < 32 * rounding<S>());
    CHECK(static_cast<double>(w.norm()) < 3.1416);
  }
}

TEST_CASE("roll, pitch and yaw rotate about fixed x, y and z", "[rotation]") {
  const double roll = 0.3, pitch = -0.8, yaw = 2.1;
  const Matrix3<double> wanted = rotation_exp<double>(Vector3<double>(0, 0, yaw)) *
                                 rotation_exp<double>(Vector3<double>(0, pitch, 0)) *
                                 rotation_exp<double>(Vector3<double>(roll, 0, 0));
  CHECK((rotation_from_roll_pitch_yaw<double>(roll, pitch, yaw) - wanted).norm() < 1e-15);
  const Vector3<double> angles = roll_pitch_yaw_from_rotation<double>(wanted);
  CHECK((angles - Vector3<double>(roll, pitch, yaw)).norm() < 1e-14);
  // At a quarter turn of the pitch there is no yaw, and the rotation is the same.
  const double quarter = 0.5 * std::acos(-1.0);
  for (const double up : {quarter, -quarter}) {
    const Matrix3<double> R = rotation_from_roll_pitch_yaw<double>(roll, up, yaw);
    const Vector3<double> a = roll_pitch_yaw_from_rotation<double>(R);
    CHECK(a[2] == 0);
    CHECK((rotation_from_roll_pitch_yaw<double>(a[0], a[1], a[2]) - R).norm() < 1e-7);
  }
}

TEST_CASE("rotations are told from other matrices", "[math]") {
  const Matrix3<double> R = rotation_exp<double>(Vector3<double>(0.3, -1, 2));
  CHECK(is_rotation<double>(R, 1e-14));
  CHECK_FALSE(is_rotation<double>(-R, 1e-2));  // a mirror
  CHECK_FALSE(is_rotation<double>(1.01 * R, 1e-2));
  CHECK(is_rotation<double>(1.001 * R, 1e-2));
  Matrix3<double> spoilt = R;
  spoilt(1, 2) = std::nan("");
  CHECK_FALSE(is_rotation<double>(spoilt, 1e-2));
  CHECK_FALSE(is_rotation<double>(Matrix3<double>::Zero(), 1e-2));
}
