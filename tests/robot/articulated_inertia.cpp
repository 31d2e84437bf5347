// Articulated inertias by 3×3 blocks, compared with dense 6×6 spatial algebra. A spatial vector is
// (angular, linear), so that the wrench of an acceleration is [A B; Bᵀ C] (α, A) + (N, F).

#include "clothctl/robot/detail/articulated_inertia.hpp"

#include <random>

#include <Eigen/LU>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using V = Vector3<double>;

Matrix3<double> skew(const V& v) {
  Matrix3<double> m;
  m << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0;
  return m;
}

Matrix6 dense(const ArticulatedInertia<double>& a) {
  Matrix6 m;
  m << a.A.matrix3(), a.B.matrix3(), a.G.matrix3(), a.C.matrix3();
  return m;
}
Vector6 wrench(const ArticulatedInertia<double>& a) {
  Vector6 p;
  p << a.N.head<3>(), a.F.head<3>();
  return p;
}

struct Random {
  std::mt19937 engine{11};
  std::uniform_real_distribution<double> uniform{-1.0, 1.0};

  V vector() { return {uniform(engine), uniform(engine), uniform(engine)}; }

  // A body with a positive definite inertia about a centre of mass away from its origin.
  BodyMotion<double> body() {
    BodyMotion<double> motion{};
    Inertia<double> inertia;
    inertia.mass = 2.0 + uniform(engine);
    inertia.com = vector();
    const Matrix3<double> m =
        Matrix3<double>::NullaryExpr([&](Index, Index) { return uniform(engine); });
    inertia.about_com = m * m.transpose() + 0.3 * Matrix3<double>::Identity();
    motion.inertia = BodyInertia<double>(inertia);
    motion.N = vector();
    motion.F = vector();
    return motion;
  }
  ArticulatedInertia<double> articulated() {
    ArticulatedInertia<double> a;
    a.clear();
    a.add(body());
    return a;
  }
};

}  // namespace

TEST_CASE("a body's own inertia is [I h×; -h× m]", "[robot]") {
  Random random;
  const BodyMotion<double> body = random.body();
  ArticulatedInertia<double> a;
  a.clear();
  a.add(body);
  Matrix3<double> moments;
  moments << body.inertia.moments.col(0), body.inertia.moments.col(1), body.inertia.moments.col(2);
  Matrix6 expected;
  expected << moments, skew(body.inertia.h), -skew(body.inertia.h),
      body.inertia.mass * Matrix3<double>::Identity();
  CHECK((dense(a) - expected).norm() <= 1e-15);
  CHECK((wrench(a).head<3>() - body.N).norm() == 0.0);
  CHECK((wrench(a).tail<3>() - body.F).norm() == 0.0);
  a.add(body);
  CHECK((dense(a) - 2.0 * expected).norm() <= 1e-14);
}

TEST_CASE("a shift to the parent is Xᵀ I X and keeps the parent's own", "[robot]") {
  Random random;
  for (int trial = 0; trial < 20; ++trial) {
    const ArticulatedInertia<double> child = random.articulated();
    ArticulatedInertia<double> parent = random.articulated();
    const V r = random.vector();
    // A point at r from the parent's origin accelerates by A + α × r.
    Matrix6 X = Matrix6::Identity();
    X.block<3, 3>(3, 0) = -skew(r);
    const Matrix6 expected = dense(parent) + X.transpose() * dense(child) * X;
    const Vector6 expected_wrench = wrench(parent) + X.transpose() * wrench(child);
    add_to_parent<double>(r, child, parent);
    CHECK((dense(parent) - expected).norm() <= 1e-13);
    CHECK((wrench(parent) - expected_wrench).norm() <= 1e-13);
  }
}

TEST_CASE("an eliminated joint transmits no wrench along its own direction but its torque",
          "[robot]") {
  Random random;
  for (int trial = 0; trial < 40; ++trial) {
    const bool turns = trial % 2 == 0;
    const V axis = random.vector().normalized();
    Vector6 S = Vector6::Zero();
    S.segment<3>(turns ? 0 : 3) = axis;
    ArticulatedInertia<double> a = random.articulated();
    const Matrix6 before = dense(a);
    const Vector6 p = wrench(a);
    const double torque = 0.7, diagonal = trial % 4 < 2 ? 0.0 : 0.4;
    EliminatedJoint<double> joint;
    REQUIRE(eliminate_joint<double>(turns, axis, torque, diagonal, a, joint));
    const double D = S.dot(before * S) + diagonal;
    const Vector6 U = before * S;
    CHECK((dense(a) - (before - U * U.transpose() / D)).norm() <= 1e-13);
    CHECK((wrench(a) - (p + U * (torque - S.dot(p)) / D)).norm() <= 1e-13);
    CHECK(joint.inverse == Approx(1.0 / D));
    CHECK(joint.u == Approx(torque - S.dot(p)));
    if (diagonal == 0.0) {
      CHECK((dense(a) * S).norm() <= 1e-13);
      CHECK(S.dot(wrench(a)) == Approx(torque));
    }
  }
}

TEST_CASE("a joint with neither inertia nor diagonal is not eliminated", "[robot]") {
  ArticulatedInertia<double> a;
  a.clear();
  EliminatedJoint<double> joint;
  for (const bool turns : {true, false})
    CHECK_FALSE(eliminate_joint<double>(turns, V::UnitX(), 0.0, 0.0, a, joint));
  CHECK(eliminate_joint<double>(true, V::UnitX(), 1.0, 0.5, a, joint));
  CHECK(joint.inverse == 2.0);
}

TEST_CASE("an eliminated free joint leaves no inertia but what its diagonal holds", "[robot]") {
  Random random;
  const V turn = random.vector();
  const Matrix3<double> axes = Eigen::AngleAxisd(turn.norm(), turn.normalized()).matrix();
  Matrix6 S = Matrix6::Zero();  // linear coordinates first
  S.block<3, 3>(3, 0) = axes;
  S.block<3, 3>(0, 3) = axes;
  VectorX<double> torques(8), diagonal(8), none(0);
  for (Index i = 0; i < 8; ++i) {
    torques[i] = random.uniform(random.engine);
    diagonal[i] = 0.5 + 0.1 * static_cast<double>(i);
  }
  for (const bool damped : {false, true}) {
    ArticulatedInertia<double> a = random.articulated();
    const Matrix6 before = dense(a);
    const Vector6 p = wrench(a), tau = torques.segment<6>(2);
    Matrix6 U, D = S.transpose() * before * S;
    if (damped) D.diagonal() += diagonal.segment<6>(2);
    Eigen::Matrix<double, 6, 7> solved;
    REQUIRE(eliminate_free_joint<double>(axes, torques, damped ? diagonal : none, 2, U, solved, a));
    const Matrix6 inverse = D.inverse();
    const Matrix6 expected = before - before * S * inverse * S.transpose() * before;
    CHECK((dense(a) - expected).norm() <= 1e-11);
    const Vector6 expected_wrench = p + before * S * inverse * (tau - S.transpose() * p);
    CHECK((wrench(a) - expected_wrench).norm() <= 1e-11);
    if (!damped) CHECK(dense(a).norm() <= 1e-11);
  }
  ArticulatedInertia<double> empty;
  empty.clear();
  Matrix6 U;
  Eigen::Matrix<double, 6, 7> solved;
  CHECK_FALSE(eliminate_free_joint<double>(axes, torques, none, 2, U, solved, empty));
}
