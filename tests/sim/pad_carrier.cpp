// What carries pads: its answer to impulses, and when a contact with it closes.

#include "clothctl/sim/detail/pad_carrier.hpp"

#include <cmath>
#include <vector>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Vec = Vector3<double>;

}  // namespace

TEST_CASE("a body that carries a pad answers impulses with its mass, a resting one not at all",
          "[sim]") {
  detail::WorldParts<double> parts{RigidBodiesSettings<double>()};
  RigidBodySetup<double> ball{ConvexShape<double>::sphere(0.01).value()};
  ball.mass = 0.5;
  ball.motion.position = Vec(1, 2, 3);
  ball.motion.velocity = Vec(0, 0, -2);
  REQUIRE(parts.bodies.add(ball).value() == 0);
  auto carrier = detail::PadCarrier<double>::make(parts, -1, -1);
  REQUIRE(carrier.rigid.has_value());
  carrier.reserve(parts, 4);
  carrier.count = 1;
  carrier.points.col(0) = Vec(1, 2, 3);  // its centre
  REQUIRE(carrier.attach(parts));
  const ImpulseResponseRef<double> side = carrier.side(parts);
  REQUIRE(side.point_count() == 1);
  VectorX<double> u(3);
  side.velocities(u);
  CHECK(u == Vec(0, 0, -2));
  MatrixX<double> W = MatrixX<double>::Zero(3, 3);
  side.add_mobility(W);
  CHECK((W - 2 * Matrix3<double>::Identity()).norm() < 1e-12);

  ball.kind = BodyKind::Kinematic;
  REQUIRE(parts.bodies.add(ball).value() == 1);
  auto resting = detail::PadCarrier<double>::make(parts, -1, -2);
  CHECK(!resting.rigid.has_value());
  resting.reserve(parts, 4);
  resting.count = 1;
  resting.points.col(0) = Vec(1, 2, 3);
  REQUIRE(resting.attach(parts));
  W.setZero();
  resting.side(parts).add_mobility(W);
  CHECK(W.isZero());
  CHECK(detail::PadCarrier<double>::motion(parts, -2).velocity == Vec(0, 0, -2));
}

TEST_CASE("a contact with a pad closes where the gap goes within the step", "[sim]") {
  ClothState<double> sheet;
  sheet.positions = Points<double>::Zero(3, 3);
  sheet.velocities = Points<double>::Zero(3, 3);
  ContactSample<double> c;
  c.a.point = {0, 1, 2};
  c.a.weight = Vec(0.2, 0.3, 0.5);
  c.normal = Vec(0, 0, 1);
  c.gap = 1e-3;
  RigidMotion<double> pad;
  CHECK(!detail::closes(c, sheet, pad, 0.02));
  pad.velocity = Vec(0, 0, 0.051);  // 1.02 mm a step
  CHECK(detail::closes(c, sheet, pad, 0.02));
  sheet.velocities.row(2).setConstant(0.002);
  CHECK(!detail::closes(c, sheet, pad, 0.02));
  pad.velocity = Vec::Zero();
  pad.position = Vec(-0.1, 0, 0);
  pad.angular_velocity = Vec(0, -1, 0);  // 0.1 m/s up at the sheet
  CHECK(detail::closes(c, sheet, pad, 0.02));
  pad.angular_velocity = Vec(0, 1, 0);
  CHECK(!detail::closes(c, sheet, pad, 0.02));
  c.state = ContactState::Stick;
  CHECK(detail::closes(c, sheet, pad, 0.02));
}
