// What RigidBodies holds: masses from densities, velocities of what is pinned, impulses, restore.

#include "clothctl/sim/detail/rigid_world.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "clothctl/sim/rigid_bodies.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;

TEST_CASE("mass and inertia come from density and shape, or from the mass") {
  detail::RigidWorld<double> w{RigidBodiesSettings<double>{}};
  RigidBodySetup<double> setup{ConvexShape<double>::box(V(0.5, 1, 1.5)).value()};
  setup.density = 10;
  CHECK(w.add(setup).value() == 0);
  CHECK(w.body(0).mass == Approx(60));
  CHECK(w.body(0).inertia(0, 0) == Approx(60.0 / 3 * (1 + 2.25)));
  setup.mass = 3;
  CHECK(w.add(setup).value() == 1);
  CHECK(w.body(1).mass == 3);
  CHECK((w.body(1).inertia * w.body(1).inverse - Matrix3<double>::Identity()).norm() < 1e-12);
  setup.kind = BodyKind::Pinned;
  setup.motion.velocity = V(1, 2, 3);
  CHECK(w.add(setup).value() == 2);
  CHECK(w.body(2).lightness == 0);
  CHECK(w.body_state(2).motion.velocity.norm() == 0);
}

TEST_CASE("an impulse at a point changes both velocities of a free body only") {
  RigidBodies<double> w;
  RigidBodySetup<double> setup{ConvexShape<double>::sphere(0.5).value()};
  setup.mass = 2;
  w.add(setup).value();
  setup.kind = BodyKind::Kinematic;
  w.add(setup).value();
  for (const int i : {0, 1}) CHECK(w.apply_impulse(i, V(0, 1, 0), V(0.5, 0, 0)));
  CHECK(w.motion(0).velocity[1] == Approx(0.5));
  CHECK(w.motion(0).angular_velocity[2] == Approx(0.5 / (0.4 * 2 * 0.25)));
  CHECK(w.motion(1).velocity.norm() == 0);
  CHECK(w.inverse_mass(0) == 0.5);
  CHECK(w.inverse_inertia(0)(0, 0) == Approx(1 / (0.4 * 2 * 0.25)));
  CHECK(w.inverse_inertia(1).norm() == 0);
}

TEST_CASE("a state of another system is refused") {
  RigidBodies<double> one, two;
  const RigidBodySetup<double> setup{ConvexShape<double>::sphere(0.5).value()};
  one.add(setup).value();
  two.add(setup).value();
  CHECK(one.restore(two.state()));
  two.add(setup).value();
  CHECK(!one.restore(two.state()));
}

TEST_CASE("obstacles with a restitution beyond 0 to 1 are refused") {
  const SphereCollider<double> ball = SphereCollider<double>::create(V(0, 0, 0), 1).value();
  RigidBodies<double> w;
  CHECK(!w.add_obstacle(ColliderRef<double>(ball), 2));
  CHECK(w.add_obstacle(ColliderRef<double>(ball), 1).value() == 0);
  CHECK(w.obstacle_count() == 1);
}
