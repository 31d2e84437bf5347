// Sheets, bodies and obstacles in one step.

#include "clothctl/sim/world.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "support/allocations.hpp"
#include "support/meshes.hpp"
#include "support/pads.hpp"
#include "support/sheet_on_obstacles.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Implicit = MassSpring<double>;
using Xpbd = PositionBased<double>;
const double kNan = std::numeric_limits<double>::quiet_NaN();

template <class Model>
Model make_model(int n, const Vector3<double>& gravity = Vector3<double>(0, 0, -9.81)) {
  if constexpr (std::is_same_v<Model, Implicit>) {
    MassSpringSettings<double> settings;
    settings.gravity = gravity;
    return Model::create(level_sheet<double>(n), settings).value();
  } else {
    PositionBasedSettings<double> settings;
    settings.gravity = gravity;
    return Model::create(level_sheet<double>(n), settings).value();
  }
}

template <class Model>
int add_sheet(World<double>& world, int n, double z, const WorldSheetSetup<double>& setup = {},
              const Vector3<double>& gravity = Vector3<double>(0, 0, -9.81)) {
  Model model = make_model<Model>(n, gravity);
  ClothState<double> state = model.rest_state();
  state.positions.row(2).array() += z;
  return world.add_sheet(std::move(model), std::move(state), setup).value();
}

PlaneCollider<double> floor_at(double z) {
  return PlaneCollider<double>::create(Vector3<double>(0, 0, z), Vector3<double>(0, 0, 1)).value();
}

RigidBodySetup<double> ball(double radius, double mass, const Vector3<double>& at) {
  RigidBodySetup<double> setup{ConvexShape<double>::sphere(radius).value()};
  setup.mass = mass;
  setup.motion.position = at;
  return setup;
}

}  // namespace

TEMPLATE_TEST_CASE("two sheets that fall on each other lie in layers", "[sim]", Implicit, Xpbd) {
  World<double> world;
  (void)world.add_obstacle(floor_at(0)).value();
  WorldSheetSetup<double> setup;
  setup.meets_sheets = true;
  const int low = add_sheet<TestType>(world, 9, 0.02, setup);
  const int high = add_sheet<TestType>(world, 9, 0.04, setup);
  ClothState<double> turned = world.state(high);
  for (Index i = 0; i < turned.positions.cols(); ++i) {
    const Vector3<double> x = turned.positions.col(i);
    turned.positions.col(i) =
        Vector3<double>(0.8 * x[0] - 0.6 * x[1] + 0.004, 0.6 * x[0] + 0.8 * x[1] + 0.007, x[2]);
  }
  REQUIRE(world.set_state(high, turned).empty());
  for (int i = 0; i < 240; ++i) {
    const WorldReport<double> report = world.step(1.0 / 60);
    if (!report.advanced || report.crossings > 0) FAIL("step " << i);
  }
  // Half a thickness from the floor, and a thickness from each other; the corners overhang.
  const auto& below = world.state(low).positions;
  const auto& above = world.state(high).positions;
  CHECK(below.row(2).minCoeff() > 0.3e-3);
  CHECK(below.row(2).maxCoeff() < 1.8e-3);
  CHECK(above.row(2).maxCoeff() < 4.5e-3);
  double sum = 0;
  int count = 0;
  for (Index i = 0; i < above.cols(); ++i) {
    if (above.col(i).head<2>().cwiseAbs().maxCoeff() > 0.12) continue;
    sum += above(2, i);
    ++count;
  }
  CHECK(sum / count > 2.5e-3);
  CHECK(world.state(high).velocities.colwise().norm().maxCoeff() < 0.3);
}

TEMPLATE_TEST_CASE("sheet and body without gravity keep their momentum", "[sim]", Implicit, Xpbd) {
  WorldSettings<double> settings;
  settings.bodies.gravity.setZero();
  World<double> world(settings);
  const int sheet = add_sheet<TestType>(world, 9, 0, {}, Vector3<double>::Zero());
  RigidBodySetup<double> setup = ball(0.05, 0.3, Vector3<double>(0.01, 0.02, 0.12));
  setup.motion.velocity = Vector3<double>(0, 0, -1);
  (void)world.add_body(setup).value();
  const VectorX<double> mass = level_sheet<double>(9).mass;
  const auto momentum = [&] {
    return Vector3<double>(world.state(sheet).velocities * mass +
                           0.3 * world.bodies().motion(0).velocity);
  };
  const Vector3<double> start = momentum();
  double summed = 0;
  for (int i = 0; i < 120; ++i) {
    REQUIRE(world.step(1.0 / 60).advanced);
    for (const auto& c : world.contacts(sheet)) {
      summed += c.impulse.norm();
      CHECK(c.obstacle == -1);
    }
  }
  CHECK(summed > 1e-3);
  CHECK((momentum() - start).norm() < 1e-9 * summed);
  CHECK(world.bodies().motion(0).velocity[2] > -0.99);
}

TEMPLATE_TEST_CASE("a pinned sheet carries a ball", "[sim]", Implicit, Xpbd) {
  World<double> world;
  TestType model = make_model<TestType>(17);
  typename TestType::State state = model.rest_state();
  const int sheet = world.add_sheet(std::move(model), state).value();
  ClothInput<double>& input = world.input(sheet);
  const std::vector<int> corners{0, 16, 272, 288};
  input.driven_vertices = corners;
  input.driven_positions.resize(3, 4);
  for (Index i = 0; i < 4; ++i)
    input.driven_positions.col(i) = state.positions.col(corners[static_cast<std::size_t>(i)]);
  (void)world.add_body(ball(0.04, 0.1, Vector3<double>(0, 0, 0.05))).value();
  for (int i = 0; i < 600; ++i) REQUIRE(world.step(1.0 / 120).advanced);
  const RigidMotion<double>& motion = world.bodies().motion(0);
  CAPTURE(motion.position.transpose(), motion.velocity.transpose());
  CHECK(motion.position[2] > -0.25);  // it has not fallen through
  CHECK(motion.position.head<2>().norm() < 0.08);
  CHECK(motion.velocity.norm() < 0.3);  // it rolls
}

TEST_CASE("a moving obstacle goes on, and pushes a sheet", "[sim]") {
  World<double> world;
  RigidMotion<double> motion;
  motion.position = Vector3<double>(0, 0, -0.2);
  motion.velocity = Vector3<double>(0, 0, 0.5);
  motion.angular_velocity = Vector3<double>(0, 0, 1);
  const auto sphere = SphereCollider<double>::create(Vector3<double>::Zero(), 0.1).value();
  const int obstacle = world.add_obstacle(sphere, motion).value();
  const int sheet = add_sheet<Implicit>(world, 9, 0, {}, Vector3<double>::Zero());
  for (int i = 0; i < 60; ++i) REQUIRE(world.step(1.0 / 60).advanced);
  CHECK((world.motion(obstacle).position - Vector3<double>(0, 0, 0.3)).norm() < 1e-12);
  CHECK(world.state(sheet).positions.row(2).minCoeff() > 0.2);
  motion.velocity.setConstant(kNan);
  CHECK(world.set_motion(obstacle, motion) ==
        "obstacle 0 has the velocity with the coordinate 0 = nan, must be finite");
}

TEST_CASE("groups that do not meet do not touch", "[sim]") {
  World<double> world;
  (void)world.add_obstacle(floor_at(0), {}, {}, {2, 2}).value();
  WorldSheetSetup<double> setup;
  setup.groups = {1, 1};
  const int sheet = add_sheet<Implicit>(world, 5, 0.01, setup);
  for (int i = 0; i < 30; ++i) REQUIRE(world.step(1.0 / 60).advanced);
  CHECK(world.state(sheet).positions.row(2).maxCoeff() < -0.5);
  CHECK(world.contacts(sheet).empty());
}

TEST_CASE("driven vertices go their way in equal parts", "[sim]") {
  World<double> world;
  WorldSheetSetup<double> setup;
  setup.substeps = 3;
  const int sheet = add_sheet<Implicit>(world, 5, 0, setup);
  world.input(sheet).driven_vertices = {0};
  world.input(sheet).driven_positions =
      world.state(sheet).positions.col(0) + Vector3<double>(0.03, 0, 0);
  const Vector3<double> goal = world.input(sheet).driven_positions.col(0);
  const WorldReport<double> report = world.step(1.0 / 60);
  REQUIRE(report.advanced);
  CHECK(report.parts == 3);
  // A vertex without a position is refused, and nothing else is touched.
  world.input(sheet).driven_vertices = {0, 1};
  CHECK(world.step(1.0 / 60).status == StepStatus::InvalidInput);
  CHECK((world.state(sheet).positions.col(0) - goal).norm() < 1e-15);
  CHECK((world.state(sheet).velocities.col(0) - Vector3<double>(1.8, 0, 0)).norm() < 1e-12);
}

TEST_CASE("a world refuses what is wrong, and a failed step changes nothing", "[sim]") {
  World<double> world;
  const auto error = [&](const WorldSheetSetup<double>& setup) {
    Implicit model = make_model<Implicit>(3);
    ClothState<double> state = model.rest_state();
    return world.add_sheet(std::move(model), std::move(state), setup).error();
  };
  WorldSheetSetup<double> setup;
  setup.thickness = 0;
  CHECK(error(setup) == "sheet 0 has the thickness 0 m, must be from 1e-6 to 1");
  setup = {};
  setup.substeps = 0;
  CHECK(error(setup).find("0 substeps") != std::string::npos);
  setup = {};
  setup.contacts = Index(1) << 40;
  CHECK(error(setup).find("sheet 0 has room for 1099511627776 contacts") == 0);
  for (const bool meets : {false, true}) {
    setup = {};
    setup.meets_sheets = meets;
    setup.joined = {{0, 1}, {0, 9}};
    CHECK(error(setup) == "sheet 0: joined pair 1 holds vertex 9 off the sheet of 9 vertices");
    setup.joined = {{2, 2}};
    CHECK(error(setup) == "sheet 0: joined pair 0 holds vertex 2 twice");
  }
  Implicit model = make_model<Implicit>(3);
  ClothState<double> bad = model.rest_state();
  bad.velocities(0, 0) = kNan;
  CHECK(world.add_sheet(model, bad).error() == "sheet 0: velocity of vertex 0: x is nan");
  CHECK(world.add_sheet(model, ClothState<double>{}).error() ==
        "sheet 0: 0 positions in the state for 9 vertices of the model");
  CHECK(!world.add_body(ball(0.1, kNan, Vector3<double>::Zero())));
  const int sheet = add_sheet<Implicit>(world, 3, 0);
  (void)world.add_body(ball(0.1, 1, Vector3<double>(0, 0, 1))).value();
  REQUIRE(world.step(0.01).advanced);
  const ClothState<double> before = world.state(sheet);
  const Vector3<double> where = world.bodies().motion(0).position;
  CHECK(world.check_input(0.01).empty());
  for (const double dt : {0.0, -1.0, kNan, 1e-300, 1e300}) {
    CHECK(world.step(dt).status == StepStatus::InvalidInput);
    CHECK(!world.step(dt).advanced);
    CHECK(world.check_input(dt) ==
          "step length dt must be from 1e-9 to 1000 s, got " + number_text(dt) + " s");
  }
  world.input(sheet).driven_vertices = {99};
  world.input(sheet).driven_positions.setZero(3, 1);
  const WorldReport<double> report = world.step(0.01);
  CHECK(report.status == StepStatus::InvalidInput);
  CHECK(report.sheet == sheet);
  CHECK(!report.advanced);
  CHECK(world.check_input(0.01) ==
        "sheet 0: driven vertex 0: vertex 99 is off the mesh of 9 vertices");
  CHECK(world.state(sheet) == before);
  CHECK(world.bodies().motion(0).position == where);
  CHECK(world.set_state(sheet, bad) == "sheet 0: velocity of vertex 0: x is nan");
  CHECK(world.set_state(sheet, ClothState<double>{}) ==
        "sheet 0: 0 positions in the state for 9 vertices of the model");
  CHECK(world.state(sheet) == before);
  CHECK(world.set_state(sheet, before).empty());
}

TEST_CASE("what sets or adds to a number that nothing has is refused", "[sim]") {
  World<double> world;
  const int sheet = add_sheet<Implicit>(world, 3, 0);
  const ClothState<double> state = world.state(sheet);
  (void)world.add_obstacle(floor_at(-1)).value();
  (void)world.add_body(ball(0.1, 1, Vector3<double>(0, 0, 1))).value();
  (void)world.add_body(ball(0.1, 1, Vector3<double>(0, 0, 2))).value();
  const RigidMotion<double> motion = world.motion(0);
  RigidMotion<double> moved;
  moved.position[0] = 1;
  for (const int none : {-1, 1, 99, std::numeric_limits<int>::max()}) {
    const std::string number = std::to_string(none);
    CHECK(world.set_state(none, state) == "no sheet " + number + " (there are 1)");
    CHECK(world.set_motion(none, moved) == "no obstacle " + number + " (there are 1)");
    CHECK(world.set_hand(none, {}) == "no hand " + number + " (there are 0)");
  }
  CHECK(world.motion(0).position == motion.position);
  CHECK(world.state(sheet) == state);
  const std::vector<PadSample<double>> samples(1);
  CHECK(world.add_pad(99, samples).error() == "pad 0: no obstacle 99 (there are 1)");
  CHECK(world.add_pad(-1 - 3, samples).error() == "pad 0: no body 3 (there are 2)");
  CHECK(world.add_pad(std::numeric_limits<int>::min(), samples).error().find("pad 0: no body") ==
        0);
  CHECK(world.pad_count() == 0);
}

TEST_CASE("a wrong setting of a world is named, and every step is refused", "[sim]") {
  WorldSettings<double> settings;
  settings.sheet_friction = kNan;
  World<double> world(settings);
  (void)add_sheet<Implicit>(world, 3, 0);
  CHECK(world.step(0.01).status == StepStatus::InvalidInput);
  CHECK(world.check_setup() == "the sheet_friction nan, must be finite and not negative");
  CHECK(world.check_input(0.01) == world.check_setup());
}

TEMPLATE_TEST_CASE("a world repeats bit for bit and a step does not allocate", "[sim]", Implicit,
                   Xpbd) {
  Points<double> first;
  for (int run = 0; run < 2; ++run) {
    World<double> world;
    (void)world.add_obstacle(floor_at(-0.1)).value();
    (void)world
        .add_obstacle(SphereCollider<double>::create(Vector3<double>(0, 0, -0.1), 0.08).value())
        .value();
    WorldSheetSetup<double> setup;
    setup.meets_sheets = true;
    const int sheet = add_sheet<TestType>(world, 13, 0, setup);
    (void)world.add_body(ball(0.03, 0.05, Vector3<double>(0.01, 0, 0.05))).value();
    for (int i = 0; i < 20; ++i) (void)world.step(1.0 / 60);
    const long before = allocations();
    for (int i = 0; i < 40; ++i) (void)world.step(1.0 / 60);
    const long after = allocations();
    if (run == 0 && allocation_counting_works()) CHECK(after == before);
    if (run == 0) first = world.state(sheet).positions;
    CHECK(all_finite(first));
    CHECK(world.state(sheet).positions == first);
  }
}

TEST_CASE("random worlds stay finite", "[sim]") {
  std::mt19937 random(15);
  int advanced = 0, steps = 0;
  for (int trial = 0; trial < trials(30, 100000, 3); ++trial) {
    World<double> world;
    const double scale = std::pow(10, uniform(random, -2, 1));
    if (trial % 3 != 0) (void)world.add_obstacle(floor_at(uniform(random, -0.2, 0.1)));
    const auto at = [&] {
      return Vector3<double>(uniform(random, -0.2, 0.2), uniform(random, -0.2, 0.2),
                             uniform(random, -0.2, 0.2));
    };
    RigidMotion<double> motion;
    motion.position = at();
    motion.velocity = scale * at();
    motion.angular_velocity = 10 * scale * at();
    (void)world.add_obstacle(
        BoxCollider<double>::create(at(), Vector3<double>(0.05, 0.001, 0.1)).value(), motion);
    for (int b = 0; b < trial % 4; ++b)
      (void)world.add_body(
          ball(uniform(random, 0.01, 0.1), std::pow(10, uniform(random, -4, 3)), at()));
    WorldSheetSetup<double> setup;
    setup.meets_sheets = trial % 2 == 0;
    setup.thickness = std::pow(10, uniform(random, -4, -1.5));
    const int n = 3 + trial % 5;
    const int sheet = trial % 5 < 2 ? add_sheet<Implicit>(world, n, 0, setup)
                                    : add_sheet<Xpbd>(world, n, 0, setup);
    ClothState<double> state = world.state(sheet);
    for (Index k = 0; k < state.positions.size(); ++k) {
      state.positions.data()[k] += 0.01 * scale * uniform(random, -1, 1);
      state.velocities.data()[k] = scale * uniform(random, -1, 1);
    }
    REQUIRE(world.set_state(sheet, state).empty());
    bool finite = true;
    for (int i = 0; i < 40 && finite; ++i) {
      const WorldReport<double> report = world.step(std::pow(10, uniform(random, -4, -1)));
      advanced += report.advanced ? 1 : 0;
      ++steps;
      finite = all_finite(world.state(sheet).positions) &&
               all_finite(world.state(sheet).velocities) && is_finite(report.penetration);
      for (int b = 0; b < world.bodies().body_count(); ++b)
        finite = finite && all_finite(world.bodies().motion(b).position);
    }
    CAPTURE(trial);
    CHECK(finite);
  }
  CHECK(advanced > steps * 9 / 10);
}

namespace {

/// A ball that does not answer, or wrongly.
struct FaultyBall {
  SphereCollider<double> ball;
  int fault;

  QueryStatus distance(const PointsView<double>& x, Eigen::Ref<VectorX<double>> d) const {
    return ball.distance(x, d);
  }
  QueryStatus closest(const PointsView<double>& x, std::span<SurfacePoint<double>> out) const {
    (void)ball.closest(x, out);
    for (SurfacePoint<double>& q : out) {
      if (fault == 1) q.distance = std::numeric_limits<double>::quiet_NaN();
      if (fault == 2) q.normal[1] = std::numeric_limits<double>::quiet_NaN();
      if (fault == 3) q.normal *= 5;
    }
    return fault == 0 ? QueryStatus::InvalidArgument : QueryStatus::Answered;
  }
  QueryStatus sweep(const PointsView<double>& from, const PointsView<double>& to, double radius,
                    double dt, Eigen::Ref<VectorX<double>> times) const {
    return ball.sweep(from, to, radius, dt, times);
  }
  BoundingBox<double> bounds(double dt) const { return ball.bounds(dt); }
};

}  // namespace

TEST_CASE("a collider that does not answer, or wrongly, stops the step", "[sim]") {
  for (const int fault : {0, 1, 2, 3, 4}) {
    CAPTURE(fault);
    World<double> world;
    ClothState<double> state = hanging_sheet(9).rest_state();
    state.positions.row(2).array() += 0.2 - state.positions.row(2).minCoeff();
    const Points<double> start = state.positions;
    (void)world.add_sheet(limited_sheet(9), std::move(state)).value();
    const auto ball = SphereCollider<double>::create(Vector3<double>::Zero(), 0.15).value();
    (void)world.add_obstacle(FaultyBall{ball, fault}).value();
    int refused = 0;
    for (int i = 0; i < 30; ++i) {
      const Points<double> before = world.state(0).positions;
      const WorldReport<double> report = world.step(1.0 / 60);
      if (report.advanced) continue;
      ++refused;
      CHECK(report.status == StepStatus::InvalidState);
      CHECK(report.sheet == 0);
      CHECK(world.state(0).positions == before);
    }
    CHECK((fault < 4) == (refused > 0));
    CHECK(world.state(0).positions != start);
  }
}

TEST_CASE("an obstacle that is not valid is refused by number", "[sim]") {
  World<double> world;
  const auto ball = SphereCollider<double>::create(Vector3<double>::Zero(), 0.15).value();
  ColliderSurface<double> surface;
  surface.friction = -1;
  (void)world.add_obstacle(ball).value();
  CHECK(world.add_obstacle(ball, {}, surface).error() ==
        "obstacle 1: the moving collider has the friction coefficient -1, must be finite and not "
        "negative");
  CHECK(world.obstacle_count() == 1);
}

TEST_CASE("fast sheets do not pass obstacles, or the report says that they may", "[sim]") {
  const auto slab =
      BoxCollider<double>::create(Vector3<double>(0, 0, -0.02), Vector3<double>(0.5, 0.5, 0.02))
          .value();
  for (const bool limited : {false, true}) {
    for (const double speed : {5.0, 20.0, 40.0, 1000.0}) {
      CAPTURE(limited, speed);
      World<double> world;
      (void)world.add_obstacle(slab).value();
      ClothState<double> state = hanging_sheet(9).rest_state();
      const Points<double> hanging = state.positions;
      state.positions.row(1) = hanging.row(2);  // level
      state.positions.row(2).setConstant(0.3);
      state.velocities.row(2).setConstant(-speed);
      (void)(limited ? world.add_sheet(limited_sheet(9), state)
                     : world.add_sheet(hanging_sheet(9), state))
          .value();
      bool complete = true;
      for (int i = 0; i < 20; ++i) {
        const WorldReport<double> report = world.step(1.0 / 60);
        REQUIRE(report.advanced);
        complete = complete && report.complete;
      }
      CHECK(complete == (speed < 100));
      if (complete) CHECK(world.state(0).positions.row(2).minCoeff() > -0.02);
    }
  }
}
