// The solver of an island: Newton's method and sweeps agree, joints are part of the contacts'
// mobility, and the dense factor.

#include "clothctl/sim/detail/island_solver.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <numeric>
#include <vector>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using V = Vector3<double>;
using M = Matrix3<double>;

namespace {

/// Two unit boxes side by side on a floor, each on four corners, perhaps fixed to each other.
struct Scene {
  std::vector<SolverBody<double>> bodies{2};
  std::vector<RigidContact<double>> contacts;
  std::vector<JointState<double>> joints;
  IslandRules<double> rules{1.0 / 60, 0.2, 1000, 1, 0.4, 1e-6, 60, 192, 3000};
  explicit Scene(bool jointed) {
    for (int i = 0; i < 2; ++i) {
      SolverBody<double>& b = bodies[static_cast<std::size_t>(i)];
      b.lightness = i == 0 ? 1.0 : 0.5;
      b.inverse = 6 * b.lightness * M::Identity();
      b.x = V(1.5 * i, 0, 0.5);
      b.v = V(0.3, -0.1 * i, -9.81 / 60);
      b.w = V(0, 0, 0.2);
      for (int k = 0; k < 4; ++k) {
        RigidContact<double> c;
        c.a = i;
        c.b = -1;
        c.position = b.x + V(k % 2 == 0 ? 0.5 : -0.5, k < 2 ? 0.5 : -0.5, -0.5);
        c.sample.friction = 0.4;
        contacts.push_back(c);
      }
    }
    if (!jointed) return;
    JointState<double> j;
    j.kind = JointKind::Fixed;
    j.a = 0;
    j.b = 1;
    j.anchor_a = V(0.75, 0, 0);
    j.anchor_b = V(-0.75, 0, 0);
    j.axis_a = j.axis_b = V(0, 0, 1);
    j.update(bodies[0], M::Identity(), bodies[1], M::Identity(), rules.h, 0.2, 1);
    joints.push_back(j);
  }
  IslandReport<double> solve() {
    std::vector<int> all(contacts.size()), links(joints.size());
    std::iota(all.begin(), all.end(), 0);
    std::iota(links.begin(), links.end(), 0);
    IslandSolver<double> solver;
    solver.reserve(60, 12, 60);
    return solver.solve(rules, 2, all, links, bodies, contacts, joints);
  }
};

}  // namespace

TEST_CASE("Newton's method and sweeps find the same velocities") {
  for (const bool jointed : {false, true}) {
    Scene newton(jointed), swept(jointed);
    swept.rules.newton_contacts = 0;
    const IslandReport<double> a = newton.solve(), b = swept.solve();
    CAPTURE(jointed, a.velocity, b.velocity);
    CHECK(a.solved);
    CHECK(b.velocity < 1e-4);
    CHECK(a.newton_steps > 0);
    CHECK(b.newton_steps == 0);
    for (std::size_t i = 0; i < 2; ++i) {
      CHECK((newton.bodies[i].v - swept.bodies[i].v).norm() < 1e-4);
      CHECK((newton.bodies[i].w - swept.bodies[i].w).norm() < 1e-4);
      CHECK(std::abs(newton.bodies[i].v[2]) < 1e-3);
    }
    if (!jointed) continue;
    CHECK(newton.joints[0].velocity(newton.bodies[0], newton.bodies[1]).norm() < 1e-8);
  }
}

TEST_CASE("contacts obey Coulomb's law, and friction takes the speed") {
  Scene scene(false);
  REQUIRE(scene.solve().solved);
  for (const RigidContact<double>& c : scene.contacts) {
    const V p = c.sample.impulse;
    CHECK(p[2] >= 0);
    CHECK(p.head<2>().norm() < 0.4 * p[2] + 1e-9);
  }
  CHECK(scene.bodies[0].v[0] < 0.3);
}

TEST_CASE("an island without contacts solves its joints") {
  Scene scene(true);
  scene.contacts.clear();
  scene.bodies[1].v = V(0, 1, 0);
  REQUIRE(scene.solve().solved);
  CHECK(scene.joints[0].velocity(scene.bodies[0], scene.bodies[1]).norm() < 1e-8);
}
