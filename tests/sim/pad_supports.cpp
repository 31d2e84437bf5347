// What lies under a pad: a finger presses a sheet on a table, and drags it.

#include "clothctl/sim/detail/pad_supports.hpp"

#include <cmath>
#include <utility>
#include <vector>

#include "clothctl/sim/contact_summary.hpp"
#include "support/catch.hpp"
#include "support/pads.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::allocation_counting_works;
using clothctl_test::allocations;

namespace {

using Vec = Vector3<double>;

/// A rail along x and a finger on it that presses down.
KinematicTree<double> pressing_finger() {
  KinematicTreeBuilder<double> robot;
  Inertia<double> body;
  body.mass = 0.05;
  body.about_com.diagonal().setConstant(1e-5);
  robot.add_link("world");
  const auto add = [&](const char* name, const char* parent, const char* child, const Vec& axis) {
    Joint<double> joint;
    joint.name = name;
    joint.type = JointType::Prismatic;
    joint.parent = parent;
    joint.child = child;
    joint.axis = axis;
    joint.limits = {-10, 10, 100, 1e4};
    robot.add_link(child, body).add_joint(joint);
  };
  add("rail", "world", "palm", Vec(1, 0, 0));
  add("press", "palm", "finger", Vec(0, 0, -1));
  return robot.build().value();
}

/// A sheet of n×n vertices and 0.2 m on a table z <= 0, and a finger over its middle, 3 mm aside of
/// a vertex.
struct PressedSheet {
  World<double> world;
  BoxCollider<double> table =
      BoxCollider<double>::create(Vec(0, 0, -0.05), Vec(1, 1, 0.05)).value();
  double dt, weight = 0;

  PressedSheet(int n, double force, double pad_friction, double table_friction, double step = 0.02,
               bool position_based = false)
      : dt(step) {
    const auto grid = make_grid<double>(n, n, 0.2, 0.2).value();
    const auto network = sheet_network(grid, Material<double>()).value();
    weight = 9.81 * network.mass.sum();
    auto state = MassSpring<double>::create(network).value().rest_state();
    for (Index i = 0; i < state.positions.cols(); ++i)
      state.positions.col(i) = Vec(grid.positions(0, i), grid.positions(2, i), 1e-3);
    const Vec middle = state.positions.rowwise().mean();
    state.positions.colwise() -= Vec(middle[0], middle[1], 0);
    if (position_based) {
      auto settings = PositionBasedSettings<double>::of(Material<double>());
      settings.stretch_limit = 0.02;
      (void)world
          .add_sheet(PositionBased<double>::create(network, settings).value(), std::move(state))
          .value();
    } else {
      (void)world
          .add_sheet(MassSpring<double>::create(network,
                                                MassSpringSettings<double>::of(Material<double>()))
                         .value(),
                     std::move(state))
          .value();
    }
    ColliderSurface<double> surface;
    surface.friction = table_friction;
    (void)world.add_obstacle(table, {}, surface).value();
    HandSetup<double> hand;
    hand.positions = Eigen::Vector2d::Zero();
    hand.control.kp = Eigen::Vector2d(1e4, 0);
    hand.control.kd = Eigen::Vector2d(1e3, 5);
    const KinematicTree<double> tree = pressing_finger();
    (void)world.add_hand(tree, hand).value();
    world.drive(0).torque = Eigen::Vector2d(0, force);
    const int carrier =
        world.add_link_shape(0, tree.find_link("finger"), clothctl_test::pad_ball()).value();
    PadSettings<double> pad;
    pad.friction = pad_friction;
    std::vector<PadSample<double>> samples;
    for (const PadSample<double>& s : clothctl_test::pad_samples())
      samples.push_back({Vec(s.position[0] + 0.003, s.position[2], 2e-3), Vec(0, 0, -1)});
    (void)world.add_pad(carrier, std::move(samples), pad).value();
  }

  bool run(double seconds) {
    for (int i = 0; i < std::lround(seconds / dt); ++i) {
      if (!world.step(dt).advanced) return false;
    }
    return true;
  }
  /// The force of the table on the sheet, N.
  Vec reaction() const {
    Vec sum = Vec::Zero();
    for (const auto& c : world.contacts(0)) sum += c.impulse / dt;
    return sum;
  }
  Vec middle() const { return world.state(0).positions.rowwise().mean(); }
};

}  // namespace

TEST_CASE("a table bears what a finger presses on it, at once and at any step", "[sim]") {
  for (const double force : {0.2, 2.0, 20.0}) {
    for (const int n : {9, 21}) {
      if (clothctl_test::kSanitized && n > 9) continue;
      for (const double dt : {0.02, 0.005}) {
        for (const bool position_based : {false, true}) {
          INFO(force << " N, " << n << " vertices a side, " << dt << " s, " << position_based);
          PressedSheet scene(n, force, 0.6, 0.4, dt, position_based);
          double deepest = 0, reported = 0;
          for (int i = 0; i < std::lround(1 / dt); ++i) {
            const auto report = scene.world.step(dt);
            REQUIRE(report.advanced);
            deepest = std::max(deepest, 1e-3 - scene.world.state(0).positions.row(2).minCoeff());
            reported = std::max(reported, report.penetration);
          }
          CHECK(deepest < 2e-4);
          CHECK(reported < 3e-4);
          CHECK(pad_touch(scene.world, 0, dt).normal_force == Approx(force).epsilon(0.01));
          CHECK(scene.reaction()[2] == Approx(force + scene.weight).epsilon(0.02));
        }
      }
    }
  }
}

TEST_CASE("a finger drags a sheet over a table if its friction is the larger one", "[sim]") {
  PressedSheet held(17, 2, 0.8, 0.3), left(17, 2, 0.2, 0.5);
  for (PressedSheet* scene : {&held, &left}) {
    REQUIRE(scene->run(0.5));
    const Vec before = scene->middle();
    double pulled = 0, share = 0;  // largest friction of the table, N, and over its normal force
    for (int i = 0; i < 100; ++i) {
      scene->world.drive(0).target[0] += 0.0005;
      REQUIRE(scene->run(scene->dt));
      const Vec table = scene->reaction();
      pulled = std::max(pulled, -table[0]);
      share = std::max(share, table.head<2>().norm() / table[2]);
    }
    REQUIRE(scene->run(0.3));
    const double way = scene->middle()[0] - before[0];
    if (scene == &held) {
      CHECK(way == Approx(0.05).margin(2e-3));
      CHECK(share <= 0.3 * 1.2);  // springs and supports obey it each, not their sum
      CHECK(pulled > 0.3 * (2 + scene->weight) * 0.9);
    } else {
      CHECK(std::abs(way) < 5e-3);  // of the finger's 50 mm: it creeps from cell to cell
      CHECK(pad_touch(scene->world, 0, scene->dt).sliding > 0);
    }
  }
}

TEST_CASE("a finger that lifts leaves the sheet at rest", "[sim]") {
  PressedSheet scene(17, 5, 0.6, 0.4);
  REQUIRE(scene.run(0.6));
  scene.world.drive(0).torque[1] = -1;
  double fastest = 0, highest = 0;
  for (int i = 0; i < 50; ++i) {
    REQUIRE(scene.run(scene.dt));
    fastest = std::max(fastest, scene.world.state(0).velocities.colwise().norm().maxCoeff());
    highest = std::max(highest, scene.world.state(0).positions.row(2).maxCoeff());
  }
  CHECK(highest < 2e-3);
  CHECK(fastest < 0.2);
  CHECK(scene.world.pad_contacts(0).empty());
  CHECK(scene.reaction()[2] == Approx(scene.weight).epsilon(0.02));
}

TEST_CASE("a table bears what loads a sheet beside the finger, too", "[sim]") {
  PressedSheet scene(17, 2, 0.6, 0.4);
  REQUIRE(scene.run(0.5));
  auto& input = scene.world.input(0);
  input.force_vertices = {52};
  input.forces = Points<double>::Zero(3, 1);
  input.forces(2, 0) = -1;  // N, thousands of times what a vertex weighs
  for (int i = 0; i < 50; ++i) {
    REQUIRE(scene.run(scene.dt));
    if (i < 3) continue;  // the table has to let it in first
    INFO("step " << i);
    CHECK(scene.world.state(0).positions(2, 52) > 1e-3 - 2e-5);
  }
  CHECK(scene.reaction()[2] == Approx(3 + scene.weight).epsilon(0.02));
}

TEST_CASE("supports never allocate, and repeat their bits", "[sim]") {
  PressedSheet one(13, 3, 0.6, 0.4), two(13, 3, 0.6, 0.4);
  REQUIRE(one.run(0.1));
  const long before = allocations();
  REQUIRE(one.run(0.4));
  const long after = allocations();
  if (allocation_counting_works()) CHECK(after == before);
  REQUIRE(two.run(0.1));
  REQUIRE(two.run(0.4));
  CHECK(one.world.state(0).positions == two.world.state(0).positions);
}

TEST_CASE("supports are the contacts whose vertices are all touched, with their last impulses",
          "[sim]") {
  auto contacts = ObstacleContacts<double>::create(8).value();
  std::vector<ObstacleContact<double>> list(3);
  list[0].point.vertex = {4, -1, -1};
  list[1].point.vertex = {4, 5, -1};
  list[2].point.vertex = {7, -1, -1};
  for (auto& c : list) {
    c.point.weight = Vec(1, 0, 0);
    c.point.surface.normal = Vec(0, 0, 1);
    c.point.surface.distance = -0.5;
    c.point.surface.friction = 0.4;
  }
  list[1].point.weight = Vec(0.25, 0.75, 0);
  list[2].obstacle = 1;
  contacts.set_contacts(list);
  detail::PadSupports<double> supports;
  supports.reserve(4);
  std::vector<ContactSample<double>> samples;
  const auto point = [](int v) { return v == 4 ? 0 : v == 7 ? 1 : -1; };
  const auto collect = [&](auto counts) {
    samples.clear();
    supports.begin();
    supports.add(0, 3, contacts, 0.02, 0.5, point, counts, samples);
  };
  collect([](int obstacle) { return obstacle == 0; });
  REQUIRE(samples.size() == 1);
  CHECK(samples[0].a.side == 3);
  CHECK(samples[0].b.side == -1);
  CHECK(samples[0].gap == Approx(-0.5 * 0.02));  // no faster than things are pushed out
  CHECK(samples[0].impulse.isZero());
  samples[0].impulse = Vec(0, 0, 2);
  samples[0].state = ContactState::Stick;
  supports.take(samples);
  collect([](int) { return true; });
  REQUIRE(samples.size() == 2);
  CHECK(samples[0].impulse == Vec(0, 0, 1));
  CHECK(samples[1].impulse.isZero());
  double sum = 0;
  supports.for_each_last(0, [&](int v, const Vec& p) { sum += v * p[2]; });
  CHECK(sum == 8);
  supports.add_to(0, list);
  CHECK(list[0].impulse == Vec(0, 0, 2));
  CHECK(list[2].impulse.isZero());
  supports.save();
  supports.clear();
  supports.restore();
  supports.add_to(0, list);
  CHECK(list[0].impulse == Vec(0, 0, 4));
}
