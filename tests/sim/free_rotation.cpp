// Free rotation: energy and momentum stay, a spin about a principal axis is exact, and Poinsot's
// motion of a symmetric body.

#include "clothctl/sim/detail/free_rotation.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;
using M = Matrix3<double>;

namespace {

struct Spin {
  M I = M::Identity(), R = M::Identity();
  V w = V::Zero();
  void step(double h) { detail::rotate_freely<double>(I, I.inverse(), h, R, w); }
  V momentum() const { return R * (I * (R.transpose() * w)); }
  double energy() const { return 0.5 * w.dot(momentum()); }
};

}  // namespace

TEST_CASE("energy and angular momentum stay over long times") {
  std::mt19937 random(2);
  const auto draw = [&] { return static_cast<double>(random()) / 4294967296.0; };
  for (int trial = 0; trial < 20; ++trial) {
    Spin s;
    s.I = V(0.2 + draw(), 0.2 + draw(), 0.2 + draw()).asDiagonal();
    s.w = 10 * V(draw() - 0.5, draw() - 0.5, draw() - 0.5);
    const V L = s.momentum();
    const double E = s.energy();
    for (int k = 0; k < 5000; ++k) s.step(1.0 / 60);
    CHECK((s.momentum() - L).norm() < 1e-9 * L.norm());
    CHECK(s.energy() == Approx(E).epsilon(1e-9));
  }
}

TEST_CASE("any step and speed keeps the momentum and never adds energy") {
  std::mt19937 random(3);
  const auto draw = [&] { return static_cast<double>(random()) / 4294967296.0; };
  for (int trial = 0; trial < 200; ++trial) {
    Spin s;
    s.I = V(1e-3 + draw(), 1e-3 + draw(), 1 + draw()).asDiagonal();
    s.w = std::pow(10, 6 * draw() - 1) * V(draw() - 0.5, draw() - 0.5, draw() - 0.5);
    const double E = s.energy(), L = s.momentum().norm();
    for (int k = 0; k < 100; ++k) s.step(1.0 / 60);
    CHECK(all_finite(s.w));
    CHECK(s.energy() < E * (1 + 1e-9));
    CHECK(s.momentum().norm() < L * (1 + 1e-9));
  }
}

TEST_CASE("a spin about a principal axis turns by the angle of its speed") {
  for (const double speed : {0.5, 10.0, 60.0, 100.0}) {
    Spin s;
    s.I = V(1, 2, 3).asDiagonal();
    s.w = V(0, 0, speed);
    for (int k = 0; k < 10; ++k) s.step(1.0 / 60);
    CHECK((s.R - rotation_exp<double>(V(0, 0, speed / 6))).norm() < 1e-9);
  }
}

TEST_CASE("a symmetric body precesses about its momentum at |L| over its inertia across") {
  Spin s;
  s.I = V(1, 1, 2).asDiagonal();
  s.w = V(0.3, 0, 2);
  const V L = s.momentum();
  const double h = 1.0 / 1000, rate = L.norm() / 1.0;
  const V axis = s.R.col(2);
  for (int k = 0; k < 1000; ++k) s.step(h);
  const V expected = rotation_exp<double>(V(rate * L.normalized())) * axis;
  CHECK((V(s.R.col(2)) - expected).norm() < 1e-4);
}

TEST_CASE("a block without an inverse is refused") {
  V x;
  CHECK(!detail::solve_3x3<double>(M::Zero(), V(1, 2, 3), x));
  CHECK(detail::solve_3x3<double>(2 * M::Identity(), V(1, 2, 3), x));
  CHECK((x - V(0.5, 1, 1.5)).norm() < 1e-15);
}
