// Soft pads of a world: held by a gripper, by bodies, on given paths.

#include "clothctl/sim/detail/world_grips.hpp"

#include <cmath>
#include <limits>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/pads.hpp"
#include "support/sheet_on_obstacles.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Vec = Vector3<double>;

}  // namespace

TEST_CASE("a gripper that presses hard enough holds the sheet, with its weight", "[sim]") {
  GrippedSheet held(9, 3);
  const double weight = 9.81 * hanging_sheet(9).network().mass.sum();
  for (int i = 0; i < 500; ++i) {
    const WorldReport<double> report = held.world.step(0.02);
    if (report.status != StepStatus::Converged || !report.advanced) FAIL("step " << i);
    if (report.pads.force_residual > 1e-7) FAIL("residual " << report.pads.force_residual);
  }
  const Vec force = held.impulse() / 0.02;
  CHECK(std::abs(force.z() - weight) < 0.01 * weight);
  CHECK(std::abs(force.y()) < 0.01 * weight);
  for (int pad = 0; pad < 2; ++pad) {
    double normal = 0;
    for (const auto& c : held.world.pad_contacts(pad)) normal += c.impulse.dot(c.normal) / 0.02;
    CHECK(std::abs(normal - 3) < 0.02);  // the force of the finger
  }
  CHECK(std::abs(held.world.hand(0).velocities[1]) < 1e-4);
  CHECK(held.world.torques(0)[1] == Approx(3).margin(0.01));  // the drive's torque presses alone
}

TEST_CASE("a gripper that presses too little loses the sheet, at the limit of friction", "[sim]") {
  const double weight = 9.81 * hanging_sheet(9).network().mass.sum();
  GrippedSheet lost(9, 0.3 * weight, 0.5);  // 2 μ F is 0.3 of the weight
  double worst = 0;
  int sliding = 0;
  for (int i = 0; i < 100; ++i) {
    if (!lost.world.step(0.01).advanced) FAIL("step " << i);
    if (lost.world.pad_contacts(0).empty()) break;
    for (int pad = 0; pad < 2; ++pad) {
      for (const auto& c : lost.world.pad_contacts(pad)) {
        if (c.state != ContactState::Slip) continue;
        const double normal = c.impulse.dot(c.normal);
        const double across = (c.impulse - normal * c.normal).norm();
        if (normal > 1e-9) worst = std::max(worst, std::abs(across / (0.5 * normal) - 1));
        ++sliding;
      }
    }
  }
  CHECK(sliding > 10);
  CHECK(worst < 1e-6);
  CHECK(lost.world.pad_contacts(0).empty());
}

TEST_CASE("momentum of a sheet and bodies with pads is kept without gravity", "[sim]") {
  WorldSettings<double> settings;
  settings.bodies.gravity.setZero();
  World<double> world(settings);
  const Vec at = add_hanging_sheet(world, 9, Vec::Zero());
  for (const double side : {1.0, -1.0}) {
    RigidBodySetup<double> ball{ConvexShape<double>::sphere(0.01).value()};
    ball.mass = 0.02;
    ball.motion.velocity = Vec(0.3, side * 0.2, -0.1);
    add_ball_with_pad(world, side, at, ball);
  }
  const VectorX<double> mass = hanging_sheet(9).network().mass;
  const auto momentum = [&] {
    Vec p = world.state(0).velocities * mass;
    for (int b = 0; b < 2; ++b) p += 0.02 * world.bodies().motion(b).velocity;
    return p;
  };
  const Vec before = momentum();
  double pushed = 0, touched = 0;
  for (int i = 0; i < 60; ++i) {
    const WorldReport<double> report = world.step(0.005);
    if (!report.advanced) FAIL("step " << i);
    for (int pad = 0; pad < 2; ++pad) {
      for (const auto& c : world.pad_contacts(pad)) {
        pushed += c.impulse.norm();
        ++touched;
      }
    }
  }
  CHECK(touched > 50);
  CHECK((momentum() - before).norm() <= 1e-9 * pushed);
}

TEST_CASE("obstacles and bodies beside pads receive what the sheet receives", "[sim]") {
  WorldSettings<double> settings;
  settings.bodies.gravity.setZero();
  World<double> world(settings);
  const Vec at = add_hanging_sheet(world, 9, Vec::Zero());
  // Pads pull the sheet's corner against a ball that stands, and a free one, both without pads.
  for (const double side : {1.0, -1.0}) {
    RigidMotion<double> motion;
    motion.position = at + side * Vec(0, 0.0015, 0);
    motion.velocity = Vec(0, 0.3, 0);
    if (side < 0) motion.R_world_body = rotation_exp<double>(Vec(0, 0, std::acos(-1.0)));
    (void)world.add_pad(world.add_obstacle(pad_ball(), motion).value(), pad_samples()).value();
  }
  RigidMotion<double> stands;
  stands.position = at + Vec(0.06, 0.022, -0.02);
  const auto shape = SphereCollider<double>::create(Vec::Zero(), 0.02).value();
  const int ball = world.add_obstacle(shape, stands).value();
  RigidBodySetup<double> free{ConvexShape<double>::sphere(0.02).value()};
  free.mass = 0.3;
  free.motion.position = at + Vec(0.02, 0.022, -0.07);
  (void)world.add_body(free).value();
  const VectorX<double> mass = hanging_sheet(9).network().mass;
  double beside = 0, largest = 0;
  for (int i = 0; i < 60; ++i) {
    const Vec before = world.state(0).velocities * mass;
    const Vec body_before = world.bodies().motion(0).velocity;
    if (!world.step(0.005).advanced) FAIL("step " << i);
    Vec received = Vec::Zero(), to_body = Vec::Zero();
    double size = 0;
    for (int pad = 0; pad < 2; ++pad) {
      for (const auto& c : world.pad_contacts(pad)) {
        received += c.impulse;
        size += c.impulse.norm();
      }
    }
    const bool pinched = 0 < size;
    for (const auto& c : world.contacts(0)) {
      if (c.state == ContactState::Open) continue;
      received += c.impulse;
      size += c.impulse.norm();
      if (pinched && c.obstacle == ball) beside += c.impulse.norm();
      if (c.obstacle < 0) to_body -= c.impulse;
    }
    const Vec gained = world.state(0).velocities * mass - before;
    largest = std::max(largest, (gained - received).norm() / (size + 1e-12));
    const Vec body_gained = 0.3 * (world.bodies().motion(0).velocity - body_before);
    largest = std::max(largest, (body_gained - to_body).norm() / (size + 1e-12));
  }
  CHECK(beside > 1e-3);
  CHECK(largest < 1e-9);
}

TEST_CASE("a pad presses through the sheet on a body that something holds", "[sim]") {
  for (const double mass : {0.02, 0.1, 1.0}) {
    World<double> world;
    const auto floor = PlaneCollider<double>::create(Vec::Zero(), Vec::UnitZ()).value();
    CollisionGroups below, upper;
    below.groups = below.collides_with = 2;  // the sheet does not meet the floor
    upper.groups = 3;
    (void)world.add_obstacle(floor, {}, {}, below).value();
    MassSpring<double> model = MassSpring<double>::create(level_sheet<double>(9, 0.0415)).value();
    const double weight = 9.81 * (mass + model.network().mass.sum());
    ClothState<double> state = model.rest_state();
    (void)world.add_sheet(std::move(model), std::move(state)).value();
    RigidBodySetup<double> ball{ConvexShape<double>::box(Vec(0.02, 0.02, 0.02)).value()};
    ball.mass = mass;
    ball.motion.position = Vec(0, 0, 0.02);
    ball.groups = upper;
    (void)world.add_body(ball).value();
    RigidMotion<double> motion;
    motion.position = Vec(0, 0, 0.0425);
    const int carrier = world.add_obstacle(pad_ball(), motion).value();
    std::vector<PadSample<double>> samples;
    for (const auto& s : pad_samples())
      samples.push_back({Vec(s.position[0], s.position[2], 0), Vec(0, 0, -1)});
    (void)world.add_pad(carrier, samples).value();
    double pressed = 0, carried = 0;
    for (int i = 0; i < 200; ++i) {
      motion.position.z() = 0.0425 - 0.005 * std::min(1.0, i / 60.0);
      motion.velocity = Vec(0, 0, i < 60 ? -0.005 / 0.3 : 0);
      (void)world.set_motion(carrier, motion);
      if (!world.step(0.005).advanced) FAIL("step " << i);
      if (i < 100) continue;
      for (const auto& c : world.pad_contacts(0)) pressed -= c.impulse.z() / 0.5;
      for (const auto& c : world.bodies().contacts()) carried += c.sample.impulse.z() / 0.5;
    }
    CAPTURE(mass, pressed, carried, weight);
    CHECK(pressed > 1);
    CHECK(std::abs(carried - pressed - weight) < 0.1 * pressed);
  }
}

TEST_CASE("a pad on the first body is that of the body, whatever else carries pads", "[sim]") {
  GrippedSheet held(9, 3);  // a hand carries pads 0 and 1
  RigidBodySetup<double> ball{ConvexShape<double>::sphere(0.01).value()};
  ball.mass = 0.02;
  ball.motion.position = held.at + Vec(0.1, -0.0095, 0);
  REQUIRE(held.world.add_body(ball).value() == 0);
  const int pad = held.world.add_pad(-1, pad_samples(1, Vec(0, 0.01, 0))).value();
  const Vec before = held.world.bodies().motion(0).velocity;
  REQUIRE(held.world.step(0.01).advanced);
  Vec pushed = Vec::Zero();
  for (const auto& c : held.world.pad_contacts(pad)) pushed += c.impulse;
  REQUIRE(pushed.norm() > 1e-6);
  const Vec gained = 0.02 * (held.world.bodies().motion(0).velocity - before);
  CHECK((gained + pushed - 0.02 * 0.01 * Vec(0, 0, -9.81)).norm() < 1e-9 * pushed.norm());
}

TEST_CASE("pads on a path carry the sheet, and a path through all substeps is the same", "[sim]") {
  for (const int parts : {1, 4}) {
    World<double> world;
    WorldSheetSetup<double> setup;
    setup.substeps = parts;
    const Vec at = add_hanging_sheet(world, 9, Vec(0, 0, -9.81), setup);
    for (const double side : {1.0, -1.0}) {
      RigidMotion<double> motion;
      motion.position = at + side * Vec(0, 0.0015, 0);
      motion.velocity = Vec(0.1, 0, 0.05);
      if (side < 0) motion.R_world_body = rotation_exp<double>(Vec(0, 0, std::acos(-1.0)));
      const int carrier = world.add_obstacle(pad_ball(), motion).value();
      (void)world.add_pad(carrier, pad_samples()).value();
    }
    double slid = 0;  // from the sudden start
    for (int i = 0; i < 200; ++i) {
      if (!world.step(0.01).advanced) FAIL("step " << i);
      if (i == 60) slid = world.pad_contacts(0)[0].slid;
    }
    REQUIRE(world.pad_contacts(0).size() == 4);
    CHECK(world.pad_contacts(0)[0].slid - slid < 1e-5);
    for (const auto& c : world.pad_contacts(0)) {
      CHECK(c.state == ContactState::Stick);
      CHECK((c.place - at - 1.99 * Vec(0.1, 0, 0.05)).norm() < 0.008);
    }
  }
}

TEST_CASE("the impulse of a pad is that of the whole step, in any number of parts", "[sim]") {
  const double weight = 9.81 * hanging_sheet(9).network().mass.sum();
  for (const int parts : {1, 5}) {
    WorldSheetSetup<double> setup;
    setup.substeps = parts;
    GrippedSheet held(9, 3, 0.6, setup);
    for (int i = 0; i < 500; ++i) REQUIRE(held.world.step(0.02).advanced);
    CHECK(std::abs(held.impulse().z() / 0.02 - weight) < 0.01 * weight);
  }
}

TEST_CASE("a step with pads and a hand never allocates, and repeats its bits", "[sim]") {
  std::vector<Points<double>> ends;
  for (int run = 0; run < 2; ++run) {
    GrippedSheet held(9, 3);
    const long made = held.drag();
    REQUIRE(made >= 0);
    if (allocation_counting_works()) CHECK(made == 0);
    ends.push_back(held.world.state(0).positions);
  }
  CHECK(ends[0] == ends[1]);
}

TEST_CASE("pads and hands that are not valid are refused by name", "[sim]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  World<double> world;
  CHECK(world.add_pad(0, pad_samples()).error() == "pad 0: no obstacle 0 (there are 0)");
  CHECK(world.add_pad(-1, pad_samples()).error() == "pad 0: no body 0 (there are 0)");
  const int ball = world.add_obstacle(pad_ball()).value();
  CHECK(world.add_pad(ball, {}).error() == "pad 0 has no samples");
  auto bad = pad_samples();
  bad[2].normal *= 2;
  CHECK(world.add_pad(ball, bad).error().find("sample 2") != std::string::npos);
  PadSettings<double> settings;
  settings.friction = nan;
  CHECK(world.add_pad(ball, pad_samples(), settings).error().find("friction") != std::string::npos);
  HandSetup<double> hand;
  CHECK(world.add_hand(two_fingers(), hand).error() ==
        "hand 0 has positions of 0 entries, must be 3");
  hand.positions = Eigen::Vector3d(0, nan, 0);
  CHECK(world.add_hand(two_fingers(), hand).error() ==
        "hand 0 has positions with the entry 1 = nan, must be finite");
  hand.positions.setZero();
  CHECK(world.add_hand(two_fingers(), hand).error().find("kp") != std::string::npos);
  CHECK(world.add_link_shape(0, 1, pad_ball()).error() == "no hand 0 (there are 0)");
  hand.control = StablePdSettings<double>::uniform(3);
  (void)world.add_hand(two_fingers(), hand).value();
  CHECK(world.add_link_shape(0, 99, pad_ball()).error() == "hand 0 has no frame 99");
  CHECK(world.pad_count() == 0);
}

TEST_CASE("a world tells why every step is refused", "[sim]") {
  World<double> world;
  CHECK(world.check_setup().empty());
  MassSpringSettings<double> settings;
  settings.linear_solver = LinearSolver::ConjugateGradient;
  MassSpring<double> model =
      MassSpring<double>::create(hanging_sheet(5).network(), settings).value();
  ClothState<double> state = model.rest_state();
  (void)world.add_sheet(std::move(model), std::move(state)).value();
  CHECK(world.step(0.01).advanced);
  (void)world.add_pad(world.add_obstacle(pad_ball()).value(), pad_samples()).value();
  CHECK(world.step(0.01).status == StepStatus::InvalidInput);
  CHECK(world.check_setup().find("sheet 0") == 0);
  CHECK(world.check_setup().find("conjugate gradients") != std::string::npos);
}

TEST_CASE("a target that is not finite changes nothing", "[sim]") {
  GrippedSheet held(9, 3);
  for (int i = 0; i < 20; ++i) REQUIRE(held.world.step(0.02).advanced);
  const Points<double> x = held.world.state(0).positions;
  const VectorX<double> q = held.world.hand(0).positions;
  held.world.drive(0).target[0] = std::numeric_limits<double>::quiet_NaN();
  const WorldReport<double> report = held.world.step(0.02);
  CHECK(!report.advanced);
  CHECK(report.status == StepStatus::InvalidInput);
  CHECK(report.hand == 0);
  CHECK(held.world.check_input(0.02) ==
        "hand 0 has a target with the entry 0 = nan, must be finite");
  CHECK(held.world.state(0).positions == x);
  CHECK(held.world.hand(0).positions == q);
  held.world.drive(0).target = Eigen::Vector2d(0, 0);  // too short
  CHECK(held.world.step(0.02).status == StepStatus::InvalidInput);
  CHECK(held.world.check_input(0.02) == "hand 0 has a target of 2 entries, must be 3");
  held.world.drive(0).target = Eigen::Vector3d::Zero();
  CHECK(held.world.step(0.02).advanced);
  CHECK(held.world.pad_contacts(0).size() == 4);  // still held
}
