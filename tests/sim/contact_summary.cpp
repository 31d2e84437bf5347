// The contacts of a sheet as a planner needs them.

#include "clothctl/sim/contact_summary.hpp"

#include <cmath>
#include <set>
#include <vector>

#include "support/catch.hpp"
#include "support/pads.hpp"
#include "support/sheet_on_obstacles.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("outer forces are those that balance the weight of a held sheet", "[sim]") {
  GrippedSheet held(9, 3);
  const double weight = 9.81 * hanging_sheet(9).network().mass.sum();
  for (int i = 0; i < 500; ++i) REQUIRE(held.world.step(0.02).advanced);
  Points<double> f = Points<double>::Zero(3, 81);
  add_contact_forces<double>(held.world, 0, 0.02, {}, f);
  const Vector3<double> sum = f.rowwise().sum();
  CHECK(std::abs(sum.z() - weight) < 0.01 * weight);
  CHECK((sum - held.impulse() / 0.02).norm() < 1e-12);
  // Without one finger, its force is missing.
  const std::vector<int> except{held.world.pad_carrier(0)};
  f.setZero();
  add_contact_forces<double>(held.world, 0, 0.02, except, f);
  CHECK(f.row(1).sum() == Approx(-3).epsilon(0.01));
}

TEST_CASE("what bears a sheet at rest is its weight, however steps are divided", "[sim]") {
  for (const int parts : {1, 4}) {
    World<double> world;
    const SpringNetwork<double> network = level_sheet<double>(9);
    MassSpring<double> model = MassSpring<double>::create(network).value();
    ClothState<double> state = model.rest_state();
    state.positions.row(2).setConstant(1e-3);
    WorldSheetSetup<double> setup;
    setup.substeps = parts;
    (void)world.add_sheet(std::move(model), std::move(state), setup).value();
    using Vec = Vector3<double>;
    (void)world.add_obstacle(PlaneCollider<double>::create(Vec::Zero(), Vec(0, 0, 1)).value())
        .value();
    CHECK(world.last_part() == 0);
    for (int i = 0; i < 100; ++i) {
      const auto report = world.step(0.02);
      REQUIRE(report.advanced);
      CHECK(report.parts == parts);
    }
    CHECK(world.last_part() == Approx(0.02 / parts));
    Points<double> f = Points<double>::Zero(3, 81);
    add_contact_forces<double>(world, 0, 0.02, {}, f);
    CHECK(f.row(2).sum() == Approx(9.81 * network.mass.sum()).epsilon(1e-3));
  }
}

TEST_CASE("supports are the forces of contacts, with their normals", "[sim]") {
  World<double> world;
  const SpringNetwork<double> network = level_sheet<double>(9);
  MassSpring<double> model = MassSpring<double>::create(network).value();
  ClothState<double> state = model.rest_state();
  using Vec = Vector3<double>;
  const Vec normal(0, 0.28, 0.96);
  const Matrix3<double> turn =
      Eigen::Quaterniond::FromTwoVectors(Vec::UnitZ(), normal).toRotationMatrix();
  for (Index i = 0; i < 81; ++i) {
    const Vec flat = state.positions.col(i);
    state.positions.col(i) = turn * flat + 1e-3 * normal;
  }
  (void)world.add_sheet(std::move(model), std::move(state)).value();
  const int table =
      world.add_obstacle(PlaneCollider<double>::create(Vec::Zero(), normal).value(), {}, {1.0, 0})
          .value();
  for (int i = 0; i < 100; ++i) REQUIRE(world.step(0.02).advanced);
  Points<double> f = Points<double>::Zero(3, 81);
  add_contact_forces<double>(world, 0, 0.02, {}, f);
  std::vector<VertexSupport<double>> supports;
  contact_supports<double>(world, 0, 0.02, {}, 0.003, supports);
  REQUIRE(supports.size() > 20);
  for (std::size_t i = 0; i < supports.size(); ++i) {
    const VertexSupport<double>& support = supports[i];
    if (i > 0) CHECK(supports[i - 1].vertex < support.vertex);
    CHECK((support.force - f.col(support.vertex)).norm() < 1e-15);
    CHECK((support.normal - normal).norm() < 1e-12);
    CHECK(support.release == 0.003);
    f.col(support.vertex).setZero();
  }
  CHECK(f.norm() < 1e-12);  // no other vertex is carried
  contact_supports<double>(world, 0, 0.02, std::vector<int>{table}, 0.003, supports);
  CHECK(supports.empty());
}

TEST_CASE("supports of a pinched sheet keep all forces, which do not end", "[sim]") {
  GrippedSheet held(9, 3);
  for (int i = 0; i < 200; ++i) REQUIRE(held.world.step(0.02).advanced);
  Points<double> f = Points<double>::Zero(3, 81);
  add_contact_forces<double>(held.world, 0, 0.02, {}, f);
  std::vector<VertexSupport<double>> supports;
  contact_supports<double>(held.world, 0, 0.02, {}, 0.001, supports);
  REQUIRE(!supports.empty());
  int pinched = 0;
  for (const VertexSupport<double>& support : supports) {
    CHECK((support.force - f.col(support.vertex)).norm() < 1e-12);
    f.col(support.vertex).setZero();
    if (is_unbounded(support.release)) ++pinched;
  }
  CHECK(f.norm() < 1e-12);
  CHECK(pinched > 0);
}

TEST_CASE("static contacts are the vertices at a finger, each once", "[sim]") {
  GrippedSheet held(9, 3);
  for (int i = 0; i < 50; ++i) REQUIRE(held.world.step(0.02).advanced);
  std::vector<int> vertices;
  for (int pad = 0; pad < 2; ++pad)
    add_static_contacts(held.world, 0, held.world.pad_carrier(pad), vertices);
  CHECK(!vertices.empty());
  CHECK(std::set<int>(vertices.begin(), vertices.end()).size() == vertices.size());
  for (const int v : vertices) {
    const Vector3<double> x = held.world.state(0).positions.col(v);
    CHECK((x - held.at).norm() < 0.06);  // cells of 37.5 mm
  }
  vertices.clear();
  add_static_contacts(held.world, 0, 99, vertices);
  CHECK(vertices.empty());
}

TEST_CASE("a pad feels what presses it, what pulls it, and whether it slides", "[sim]") {
  GrippedSheet held(9, 3);
  PadTouch<double> before = pad_touch(held.world, 0, 0.02);
  CHECK(before.contacts == 0);
  for (const int none : {-1, 2}) CHECK(pad_touch(held.world, none, 0.02).contacts == 0);
  for (int i = 0; i < 300; ++i) REQUIRE(held.world.step(0.02).advanced);
  double pull = 0;
  for (int pad = 0; pad < 2; ++pad) {
    const PadTouch<double> felt = pad_touch(held.world, pad, 0.02);
    CHECK(felt.normal_force == Approx(3).epsilon(0.01));
    CHECK(felt.contacts == 4);
    CHECK(felt.sliding == 0);
    pull += felt.tangential_force;
    // The pads press along y, one each way.
    const Vector3<double> press = held.world.pad_contacts(pad)[0].normal;
    CHECK(std::abs(press.y()) == Approx(1));
    const Vector3<double> tilted = press + Vector3<double>(1, 0, 0);
    CHECK(pad_touch(held.world, pad, 0.02, press).normal_force == felt.normal_force);
    CHECK(pad_touch<double>(held.world, pad, 0.02, tilted.normalized()).contacts == 4);
    CHECK(pad_touch<double>(held.world, pad, 0.02, -press).contacts == 0);
    CHECK(pad_touch<double>(held.world, pad, 0.02, Vector3<double>(0, 0, 1)).normal_force == 0);
  }
  const double weight = 9.81 * hanging_sheet(9).network().mass.sum();
  CHECK(pull >= 0.99 * weight);  // each pad carries its share, and they may pull at each other
  // Too weak a grip slides.
  held.world.drive(0).torque = Eigen::Vector3d(0, 0.05, 0.05);
  int sliding = 0;
  for (int i = 0; i < 5; ++i) {
    REQUIRE(held.world.step(0.02).advanced);
    sliding += pad_touch(held.world, 0, 0.02).sliding;
  }
  CHECK(sliding > 0);
}
