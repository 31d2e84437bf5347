// Rows of joints against differences of their errors, and the mobility of bodies.

#include "clothctl/sim/detail/rigid_state.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;
using M = Matrix3<double>;
using Joint = detail::JointState<double>;
using Body = detail::SolverBody<double>;

namespace {

struct Pair {
  Body A, B;
  M R_a = M::Identity(), R_b = M::Identity();
  Joint joint;

  explicit Pair(JointKind kind, unsigned seed) {
    std::mt19937 random(seed);
    const auto draw = [&] { return static_cast<double>(random()) / 4294967296.0 - 0.5; };
    const auto vector = [&] { return V(draw(), draw(), draw()); };
    joint.kind = kind;
    joint.a = 0;
    joint.b = 1;
    joint.anchor_a = vector();
    joint.anchor_b = vector();
    joint.axis_a = joint.axis_b = V(0, 0, 1);
    A.x = vector();
    R_a = rotation_exp<double>(0.2 * vector());
    R_b = rotation_exp<double>(0.02 * vector()) * R_a;
    // The anchors nearly meet, as those of a joint that holds.
    B.x = A.x + R_a * joint.anchor_a - R_b * joint.anchor_b + 1e-3 * vector();
    for (Body* b : {&A, &B}) {
      b->v = vector();
      b->w = vector();
      b->lightness = 2;
      b->inverse = V(1, 2, 3).asDiagonal();
    }
  }
  Joint::Column error(double h) {
    const double share = 1;
    joint.update(A, R_a, B, R_b, h, share, 1e9);
    return h * joint.bias;
  }
};

}  // namespace

TEST_CASE("the rows of a joint are the derivatives of its error") {
  for (const JointKind kind : {JointKind::Ball, JointKind::Hinge, JointKind::Fixed}) {
    for (unsigned seed = 0; seed < 10; ++seed) {
      Pair p(kind, seed);
      const double h = 1e-6;
      const Joint::Column before = p.error(h);
      const Joint::Column rate = p.joint.velocity(p.A, p.B);
      for (Body* b : {&p.A, &p.B}) b->x += h * b->v;
      p.R_a = rotation_exp<double>(h * p.A.w) * p.R_a;
      p.R_b = rotation_exp<double>(h * p.B.w) * p.R_b;
      const Joint::Column after = p.error(h);
      const int n = p.joint.rows();
      CHECK(((after - before) / h - rate).head(n).norm() < 0.05);
    }
  }
}

TEST_CASE("impulses of a joint change velocities by its coupling") {
  for (const JointKind kind : {JointKind::Ball, JointKind::Hinge, JointKind::Fixed}) {
    Pair p(kind, 5);
    p.error(0.01);
    Joint::Block K = Joint::Block::Zero();
    Joint::add_coupling(p.joint, p.joint, 0, p.A, K);
    Joint::add_coupling(p.joint, p.joint, 1, p.B, K);
    Joint::add_coupling(p.joint, p.joint, -1, p.B, K);
    const Joint::Column before = p.joint.velocity(p.A, p.B);
    Joint::Column mu;
    mu << 1, -2, 0.5, 0.3, 0.2, -0.7;
    const V momentum = p.A.v / p.A.lightness + p.B.v / p.B.lightness;
    p.joint.push(mu, p.A, p.B);
    CHECK((p.joint.velocity(p.A, p.B) - before - K * mu).norm() < 1e-12);
    CHECK((p.A.v / p.A.lightness + p.B.v / p.B.lightness - momentum).norm() < 1e-12);
    CHECK((K - K.transpose()).norm() < 1e-12);
  }
}

TEST_CASE("an error beyond reach counts as the reach") {
  Pair p(JointKind::Ball, 1);
  p.B.x += V(100, -100, 0);
  p.joint.update(p.A, p.R_a, p.B, p.R_b, 0.01, 0.2, 0.5);
  CHECK(p.joint.bias.cwiseAbs().maxCoeff() == Approx(0.2 * 0.5 / 0.01));
}

TEST_CASE("a body answers to an impulse by its mobility") {
  Body b;
  b.lightness = 0.5;
  b.inverse = V(1, 2, 3).asDiagonal();
  const V r_i(0.1, 0.2, 0.3), r_j(-0.4, 0.1, 0.2), p(1, 2, -1);
  M W = M::Zero();
  b.add_mobility(r_i, r_j, 1.0, W);
  const V before = b.at(r_i);
  b.push(p, r_j, V(0, 0, 0));
  CHECK((b.at(r_i) - before - W * p).norm() < 1e-14);
}
