// A sheet 1 mm thick and a finger, a needle or a plate edge-on, at up to 2 m/s, in a world: nothing
// passes. The judge (support/throws.hpp) is brute force.

#include "support/throws.hpp"
#include "clothctl/sim/world.hpp"
#include "support/sheet_on_obstacles.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Implicit = MassSpring<double>;
using Xpbd = PositionBased<double>;

/// What a throw came to.
struct Outcome {
  bool touched = false, passed = false, failed = false;
  double fastest = 0;
};

template <class Model>
Outcome play(const Throw& thrown, int n, double dt) {
  World<double> world;
  if (thrown.what == Thrown::Plate) {
    const Vec3 half(thrown.radius, thrown.half, thrown.half);
    (void)world
        .add_obstacle(BoxCollider<double>::create(Vec3::Zero(), half).value(), thrown.motion,
                      {thrown.friction, 0})
        .value();
  } else {
    const Vec3 end(0, 0, thrown.half);
    (void)world
        .add_obstacle(CapsuleCollider<double>::create(-end, end, thrown.radius).value(),
                      thrown.motion, {thrown.friction, 0})
        .value();
  }
  auto settings = [&] {
    if constexpr (std::is_same_v<Model, Implicit>)
      return MassSpringSettings<double>();
    else
      return PositionBasedSettings<double>();
  }();
  settings.gravity = thrown.gravity;
  Model model = Model::create(level_sheet<double>(n), settings).value();
  const Triangles triangles = model.network().triangles;
  ClothState<double> state = model.rest_state();
  state.velocities.colwise() = thrown.sheet_velocity;
  WorldSheetSetup<double> setup;
  setup.thickness = 1e-3;
  const int sheet = world.add_sheet(std::move(model), state, setup).value();
  Outcome out;
  for (double time = 0; time < 0.35 && !out.passed && !out.failed; time += dt) {
    const Points<double> from = world.state(sheet).positions;
    const Points<double> place = placed(thrown, world.motion(0));
    const WorldReport<double> report = world.step(dt);
    out.failed = !report.advanced || !report.complete;
    out.touched = out.touched || report.contacts > 0;
    out.passed = passes(thrown.skeleton, place, placed(thrown, world.motion(0)), triangles, from,
                        world.state(sheet).positions);
    const double speed = world.state(sheet).velocities.colwise().norm().maxCoeff();
    out.fastest = std::max(out.fastest, speed);
  }
  return out;
}

}  // namespace

TEMPLATE_TEST_CASE("nothing passes a finger, a needle or a plate that is thrown", "[sim]", Implicit,
                   Xpbd) {
  const int count = trials(6, 1000, 2);
  int touched = 0;
  for (int trial = 0; trial < count; ++trial) {
    std::mt19937 random(static_cast<unsigned>(trial));
    const int n = 7 + static_cast<int>(random() % 5);
    const Throw thrown = random_throw(random, static_cast<Thrown>(trial % 3), 2);
    const Outcome out = play<TestType>(thrown, n, trial % 2 == 0 ? 1.0 / 60 : 1.0 / 120);
    CAPTURE(trial, out.fastest);
    CHECK(!out.passed);
    CHECK(!out.failed);
    CHECK(out.fastest < 15);  // the corner of a sheet cracks like a whip
    touched += out.touched ? 1 : 0;
  }
  CHECK(touched > count / 2);
}

// States of contacts took turns; what was left of the forces pushed the whole sheet at 18 to 28
// m/s.
TEST_CASE("an obstacle does not kick a sheet off", "[sim]") {
  for (const unsigned seed : {148U, 1290U, 1314U, 2345U, 557U, 587U}) {
    std::mt19937 random(seed);
    const int n = 7 + static_cast<int>(random() % 5);
    const Throw thrown = random_throw(random, static_cast<Thrown>(seed % 3), 2);
    const Outcome out = play<Implicit>(thrown, n, seed == 148 ? 1.0 / 60 : 1.0 / 120);
    CAPTURE(seed);
    CHECK(out.touched);
    CHECK(out.fastest < 4);
  }
}

TEST_CASE("the judge sees what passes", "[sim]") {
  const Skeleton axis = make_skeleton(Thrown::Needle, 0.1);
  const Skeleton plate = make_skeleton(Thrown::Plate, 0.1);
  Points<double> from(3, 3), to(3, 3);
  from << -0.01, 0.01, 0, 0, 0, 0.02, 0.11, 0.11, 0.11;
  to = from;
  to.row(2).array() -= 0.02;  // down over the tip
  const Triangles triangles{{0, 1, 2}};
  const auto pass = [&](const Skeleton& s) {
    return passes(s, s.points, s.points, triangles, from, to);
  };
  CHECK(pass(axis));
  CHECK(pass(plate));
  to.row(2).array() += 0.015;
  CHECK(!pass(axis));
  CHECK(!pass(plate));
  from.row(2).setZero();
  from.row(1).array() += 0.01;
  to = from;
  CHECK(!pass(axis));
  to.row(1).array() -= 0.05;  // across it
  CHECK(pass(axis));
  from.row(0).array() += 0.02;
  to = from;
  to.row(0).array() -= 0.05;  // flat on the plate
  CHECK(pass(plate));
}
