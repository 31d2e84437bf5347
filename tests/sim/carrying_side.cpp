// Pads that hold a position-based sheet with a limit of stretch.

#include "clothctl/sim/detail/carrying_side.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/pads.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using namespace clothctl_test;

namespace {

using Model = PositionBased<double>;
using Vec = Vector3<double>;

/// Largest length over rest length, minus 1.
double stretch(const SpringNetwork<double>& network, const Points<double>& x) {
  double most = 0;
  for (const Spring<double>& s : network.springs) {
    if (s.kind == SpringKind::Bend) continue;
    most = std::max(most, (x.col(s.a) - x.col(s.b)).norm() / s.rest_length - 1);
  }
  return most;
}

Model without_drag(const Model& model) {
  auto settings = model.settings();
  settings.drag = 0;
  return Model::create(model.network(), settings).value();
}

/// Two triangles of a sheet of 5×5 that pads hold, and a vertex that they only touch.
struct Held {
  Model model = without_drag(limited_sheet(5));
  Model::Workspace ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  ClothInput<double> input;
  GripPatches<double> grip;
  CarryingSide<Model> side;

  explicit Held(bool sticks, const Vec& velocity = Vec::Zero(), const Vec& spin = Vec::Zero()) {
    input.clear();
    std::vector<GripContact<double>> contacts(2);
    contacts[0].vertex = {20, 21, 15};
    contacts[1].vertex = {21, 15, 16};
    for (auto& c : contacts) {
      c.sticks = sticks;
      c.impulse = 1;
      c.velocity = velocity;
      c.spin = spin;
    }
    const auto none = [](int) { return false; };
    grip.reserve(8, model.vertex_count());
    grip.find(contacts, VertexNeighbours<double>(model.network()), none, none);
    REQUIRE(grip.vertices().size() == 4);
    REQUIRE(side.create(model, 8).empty());
  }
  void step(double dt) {
    side.carry(grip, state, ws);
    REQUIRE(model.step(state, input, dt, ws).advanced);
    side.release(model, input, dt, ws);
    const VectorX<double> inverse = model.network().mass.cwiseInverse();
    const std::vector<int> touched{20, 21, 15, 16, 3};
    REQUIRE(side.attach(touched, state, ws, inverse) == StepStatus::Converged);
  }
  Vec momentum() const { return state.velocities * model.network().mass; }
};

}  // namespace

TEST_CASE("a patch answers to impulses as its mobility says", "[sim]") {
  Held held(true);
  held.step(0.01);
  const Index n = held.side.point_count();
  REQUIRE(n == 5);
  MatrixX<double> W = MatrixX<double>::Zero(3 * n, 3 * n);
  held.side.add_mobility(W);
  CHECK((W - W.transpose()).norm() < 1e-12 * W.norm());
  CHECK(
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(Eigen::MatrixXd(W)).eigenvalues().minCoeff() >
      -1e-12 * W.norm());
  VectorX<double> before(3 * n), after(3 * n), p = VectorX<double>::LinSpaced(3 * n, -1e-3, 2e-3);
  held.side.velocities(before);
  held.side.apply(p);
  held.side.velocities(after);
  CHECK((after - before - W * p).norm() < 1e-10 * (W * p).norm());
}

TEST_CASE("impulses on a patch are the momentum that the sheet gains", "[sim]") {
  for (const bool sticks : {true, false}) {
    Held held(sticks, Vec(0.3, -0.1, 0.2), Vec(1, 2, 3));
    held.state.velocities.row(0).setConstant(0.1);
    const double dt = 0.01, mass = held.model.network().mass.sum();
    VectorX<double> p = VectorX<double>::Constant(15, 1e-4);
    Vec given = Vec::Zero();
    const Vec start = held.momentum();
    for (int i = 0; i < 20; ++i) {
      held.step(dt);
      held.side.apply(p);
      held.side.take(dt, false, held.ws);
      given += Vec::Constant(5e-4) + dt * mass * Vec(0, 0, -9.81);
    }
    CHECK((held.momentum() - start - given).norm() < 1e-9 * given.norm());
  }
}

TEST_CASE("a patch moves as a rigid body", "[sim]") {
  Held held(true, Vec(0.3, -0.1, 0.2), Vec(1, 2, 3));
  const std::vector<int>& vertices = held.grip.vertices();
  const auto ways = [&] {
    std::vector<double> out;
    for (const int a : vertices) {
      for (const int b : vertices)
        out.push_back((held.state.positions.col(a) - held.state.positions.col(b)).norm());
    }
    return out;
  };
  const std::vector<double> before = ways();
  for (int i = 0; i < 50; ++i) {
    held.step(0.01);
    held.side.apply(VectorX<double>::LinSpaced(15, -1e-4, 1e-4));
    held.side.take(0.01, false, held.ws);
  }
  const std::vector<double> after = ways();
  for (std::size_t i = 0; i < before.size(); ++i) CHECK(std::abs(after[i] - before[i]) < 1e-12);
}

TEST_CASE("a gripper holds and shakes a sheet whose edges are limited", "[sim]") {
  for (const double dt : {0.02, 0.004}) {
    CAPTURE(dt);
    GrippedSheet held(17, 6, 0.6, {}, true);
    const SpringNetwork<double> network = hanging_sheet(17).network();
    const int steps = static_cast<int>(std::lround(3 / dt));
    std::vector<Vec> marked;
    double slid = 0, longest = 0;
    for (int i = 0; i < steps; ++i) {
      const double t = (i + 1) * dt;
      held.world.drive(0).target[0] = 0.05 * (1 - std::cos(4 * std::acos(-1.0) * t));
      const WorldReport<double> report = held.world.step(dt);
      if (!report.advanced) FAIL("step " << i);
      longest = std::max(longest, stretch(network, held.world.state(0).positions));
      if (i == steps / 10) slid = held.world.pad_contacts(0)[0].slid;
    }
    REQUIRE(held.world.pad_contacts(0).size() == 4);
    CHECK(held.world.pad_contacts(0)[0].slid - slid < 5e-4);
    CHECK(longest < 0.1);
  }
}

TEST_CASE("a limited sheet hangs in a gripper with its weight, without creep", "[sim]") {
  GrippedSheet held(9, 3, 0.6, {}, true);
  const double weight = 9.81 * hanging_sheet(9).network().mass.sum();
  Vec place = Vec::Zero(), mean = Vec::Zero();
  double slid = 0;
  for (int i = 0; i < 1500; ++i) {
    if (!held.world.step(0.02).advanced) FAIL("step " << i);
    if (i == 750) {
      place = held.world.pad_contacts(0)[0].place;
      slid = held.world.pad_contacts(0)[0].slid;
    }
    if (i >= 1400) mean += held.impulse() / (100 * 0.02);
  }
  CHECK(held.world.pad_contacts(0)[0].slid - slid < 1e-6);
  CHECK((held.world.pad_contacts(0)[0].place - place).norm() < 3e-4);
  CHECK(std::abs(mean.z() - weight) < 0.03 * weight);
  CHECK(std::abs(mean.y()) < 0.03 * weight);
}

TEST_CASE("a gripper that presses too little loses a limited sheet at the limit of friction",
          "[sim]") {
  const double weight = 9.81 * hanging_sheet(9).network().mass.sum();
  GrippedSheet lost(9, 0.3 * weight, 0.5, {}, true);
  double worst = 0;
  int sliding = 0;
  for (int i = 0; i < 100 && (i == 0 || !lost.world.pad_contacts(0).empty()); ++i) {
    if (!lost.world.step(0.01).advanced) FAIL("step " << i);
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
  CHECK(lost.world.pad_contacts(0).empty());
  CHECK(sliding > 10);
  CHECK(worst < 1e-6);
}

TEST_CASE("momentum of a limited sheet and bodies with pads is kept without gravity", "[sim]") {
  WorldSettings<double> settings;
  settings.bodies.gravity.setZero();
  World<double> world(settings);
  const Vec at = add_hanging_sheet(world, 9, Vec::Zero(), {}, true);
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
  const auto energy = [&] {
    double e = 0.5 * mass.dot(world.state(0).velocities.colwise().squaredNorm().transpose());
    for (int b = 0; b < 2; ++b) {
      const RigidMotion<double> m = world.bodies().motion(b);
      e += 0.5 * 0.02 * (m.velocity.squaredNorm() + 0.4 * 1e-4 * m.angular_velocity.squaredNorm());
    }
    return e;
  };
  const Vec before = momentum();
  const double given = energy();
  double pushed = 0;
  int touched = 0;
  for (int i = 0; i < 60; ++i) {
    if (!world.step(0.005).advanced) FAIL("step " << i);
    for (int pad = 0; pad < 2; ++pad) {
      for (const auto& c : world.pad_contacts(pad)) {
        pushed += c.impulse.norm();
        ++touched;
      }
    }
  }
  CHECK(touched > 50);
  CHECK((momentum() - before).norm() <= 1e-9 * pushed);
  CHECK(energy() < 1.01 * given);
}

TEST_CASE("a pad that presses a limited sheet on a table does not drive it in", "[sim]") {
  World<double> world;
  SpringNetwork<double> network = hanging_sheet(17).network();
  const Points<double> x = network.rest_positions;
  for (Index i = 0; i < x.cols(); ++i)
    network.rest_positions.col(i) = Vec(x(0, i) - 0.15, x(2, i) - x.row(2).mean(), 1e-3);
  auto settings = limited_sheet(17).settings();
  const Model model = Model::create(network, settings).value();
  (void)world.add_sheet(model, model.rest_state()).value();
  (void)world.add_obstacle(BoxCollider<double>::create(Vec(0, 0, -0.1), Vec(0.5, 0.5, 0.1)).value())
      .value();
  RigidMotion<double> motion;
  motion.position = Vec(0.003, 0.004, 1e-3);
  motion.velocity = Vec(0, 0, -0.01);
  motion.R_world_body = rotation_exp<double>(Vec(-std::acos(-1.0) / 2, 0, 0));  // y to -z
  const int pad = world.add_obstacle(pad_ball(), motion).value();
  (void)world.add_pad(pad, pad_samples()).value();
  int touched = 0;
  for (int i = 0; i < 120; ++i) {
    if (i == 40) {
      motion = world.motion(pad);
      motion.velocity.setZero();
      CHECK(world.set_motion(pad, motion).empty());
    }
    if (!world.step(0.01).advanced) FAIL("step " << i);
    touched += static_cast<int>(world.pad_contacts(0).size());
    const double lowest = world.state(0).positions.row(2).minCoeff();
    if (lowest < -3.5e-3) FAIL("step " << i << ": " << lowest);  // the pad is at -3 mm
  }
  CHECK(touched > 20);
  CHECK(world.state(0).velocities.colwise().norm().maxCoeff() < 0.05);
}

TEST_CASE("pads that are set in motion take the sheet with them", "[sim]") {
  WorldSettings<double> settings;
  settings.bodies.gravity.setZero();
  World<double> world(settings);
  const Vec at = add_hanging_sheet(world, 9, Vec::Zero(), {}, true);
  for (const double side : {1.0, -1.0}) {
    RigidBodySetup<double> ball{ConvexShape<double>::sphere(0.01).value()};
    ball.kind = BodyKind::Kinematic;
    ball.may_sleep = false;
    add_ball_with_pad(world, side, at, ball);
  }
  const VectorX<double> mass = hanging_sheet(9).network().mass;
  for (int i = 0; i < 20; ++i) REQUIRE(world.step(0.01).advanced);
  for (int b = 0; b < 2; ++b) {
    RigidMotion<double> motion = world.bodies().motion(b);
    motion.velocity = Vec(0.5, 0, 0);
    REQUIRE(world.bodies().set_motion(b, motion).empty());
  }
  double before = 0;
  for (int i = 0; i < 10; ++i) {
    REQUIRE(world.step(0.01).advanced);
    const double mean = (world.state(0).velocities * mass).x() / mass.sum();
    CHECK(mean > before - 1e-3);  // never thrown back
    before = mean;
  }
  CHECK(before > 0.05);
}

TEST_CASE("up to four pairs of bodies that pinch a free sheet add no energy", "[sim]") {
  for (const int pairs : {2, 4}) {
    WorldSettings<double> settings;
    settings.bodies.gravity.setZero();
    World<double> world(settings);
    (void)add_hanging_sheet(world, 17, Vec::Zero(), {}, true);
    const Points<double> x = world.state(0).positions;
    for (int k = 0; k < pairs; ++k) {
      const Vec at = x.col(3 * 17 + 3) + Vec(0.17 * (k % 2), 0, 0.17 * (k / 2));
      for (const double side : {1.0, -1.0}) {
        RigidBodySetup<double> ball{ConvexShape<double>::sphere(0.01).value()};
        ball.mass = 0.02;
        ball.motion.velocity = Vec(0.1 * (k % 3) - 0.1, 0, 0.1 * (k % 2));
        add_ball_with_pad(world, side, at, ball);
      }
    }
    const VectorX<double> mass = hanging_sheet(17).network().mass;
    const auto energy = [&] {
      double e = 0.5 * mass.dot(world.state(0).velocities.colwise().squaredNorm().transpose());
      for (int b = 0; b < 2 * pairs; ++b)
        e += 0.5 * 0.02 * world.bodies().motion(b).velocity.squaredNorm();
      return e;
    };
    // The springs of the pads are compressed by 0.5 mm at the start.
    const double given = energy() + 1.1 * 2 * pairs * 0.5 * 2000 * 0.5e-3 * 0.5e-3;
    for (int i = 0; i < 100; ++i) {
      if (!world.step(0.01).advanced) FAIL("step " << i);
      if (given < energy()) FAIL(pairs << " pairs, step " << i << ": " << energy());
    }
  }
}

TEST_CASE("a step that carries patches does not allocate, and repeats its bits", "[sim]") {
  std::vector<Points<double>> ends;
  for (int run = 0; run < 2; ++run) {
    WorldSheetSetup<double> setup;
    setup.substeps = 2;
    GrippedSheet held(9, 3, 0.6, setup, true);
    const long made = held.drag();
    REQUIRE(made >= 0);
    if (allocation_counting_works()) CHECK(made == 0);
    ends.push_back(held.world.state(0).positions);
  }
  CHECK(ends[0] == ends[1]);
}

TEST_CASE("random pads on limited sheets stay finite", "[sim]") {
  std::mt19937 random(77);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  int touched = 0;
  for (int trial = 0; trial < trials(40, 10000, 4); ++trial) {
    World<double> world;
    const Vec at = add_hanging_sheet(world, 3 + trial % 7, Vec(0, 0, -9.81), {}, true);
    const double scale = std::pow(10, uniform(-2, 1));
    const auto some = [&](double size) {
      return Vec(uniform(-size, size), uniform(-size, size), uniform(-size, size));
    };
    for (const double side : {1.0, -1.0}) {
      PadSettings<double> pad;
      pad.stiffness = pad.tangential_stiffness = std::pow(10, uniform(1, 6));
      pad.friction = uniform(0, 2);
      if (trial % 3 == 0) {
        RigidBodySetup<double> ball{ConvexShape<double>::sphere(0.01).value()};
        ball.mass = std::pow(10, uniform(-4, 1));
        ball.motion.position = at - side * Vec(0, 0.01, 0) + some(0.002);
        ball.motion.velocity = scale * some(1);
        const int body = world.add_body(ball).value();
        (void)world.add_pad(-1 - body, pad_samples(side, side * Vec(0, 0.01, 0)), pad).value();
      } else {
        RigidMotion<double> motion;
        motion.position = at + some(0.002);
        motion.velocity = scale * some(1);
        motion.angular_velocity = 10 * scale * some(1);
        const int carrier = world.add_obstacle(pad_ball(), motion).value();
        (void)world.add_pad(carrier, pad_samples(side), pad).value();
      }
    }
    bool finite = true;
    for (int i = 0; i < 40 && finite; ++i) {
      (void)world.step(std::pow(10, uniform(-4, -1)));
      touched += static_cast<int>(world.pad_contacts(0).size());
      finite = world.state(0).positions.allFinite() && world.state(0).velocities.allFinite();
    }
    if (!finite) FAIL("trial " << trial);
  }
  CHECK(touched > trials(200, 50000, 10));
}
