// Forces that follow poses: on a step that is linear in the forces they are known, and on a
// position-based sheet they close the loop.

#include "clothctl/mpc/pose_forces.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/position_based.hpp"
#include "clothctl/contact/friction_cone.hpp"
#include "clothctl/prediction/simulator_predictor.hpp"
#include "mpc/planner_loops.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/square_sheets.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::HangingSheet;
using clothctl_test::kFrame;

namespace {

using Dynamics = PoseForces<MassSpring<double>>;

// A hanging sheet of 5×5 vertices, whose linearly implicit steps are linear in the forces, and
// poses for its upper corners.
struct Case {
  HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 30);
  MassSpring<double> model = sheet.model(Integration::LinearlyImplicit);
  PlannerSetup<double> setup = clothctl_test::corner_setup(sheet);
  ClothInput<double> poses;
  Points<double> velocities = clothctl_test::noise<double>(5, 2, 0.2);

  Case() {
    for (const Grip<double>& grip : setup.grips)
      poses.driven_vertices.push_back(grip.vertices().front());
    poses.driven_positions.resize(3, 2);
    for (Index j = 0; j < 2; ++j)
      poses.driven_positions.col(j) =
          sheet.state.positions.col(poses.driven_vertices[static_cast<std::size_t>(j)]);
    poses.driven_positions += clothctl_test::noise<double>(3, 2, 0.003);
    poses.forces.setZero(3, 0);
  }

  Dynamics dynamics(const PoseForcesSettings& settings) const {
    return Dynamics::create(model, setup, settings).value();
  }
  // The held vertices after a step with an input: positions, then velocities.
  MatrixX<double> after(const ClothInput<double>& input) const {
    ClothState<double> state = sheet.state;
    auto workspace = model.make_workspace();
    REQUIRE(model.step(state, input, kFrame, workspace).advanced);
    MatrixX<double> out(3, 4);
    for (Index j = 0; j < 2; ++j) {
      const int v = poses.driven_vertices[static_cast<std::size_t>(j)];
      out.col(j) = state.positions.col(v);
      out.col(2 + j) = state.velocities.col(v);
    }
    return out;
  }
  bool solve(Dynamics& dynamics) const {
    return dynamics.solve(sheet.state.positions, sheet.state.velocities, poses, velocities, kFrame);
  }
};

PoseForcesSettings exact(double velocity) {
  PoseForcesSettings settings;
  settings.velocity = velocity;
  settings.ridge = 1e-12;
  return settings;
}

}  // namespace

TEST_CASE("forces bring held vertices where their poses are", "[mpc]") {
  const Case c;
  Dynamics dynamics = c.dynamics(exact(0));
  REQUIRE(c.solve(dynamics));
  CHECK(dynamics.input().driven_vertices.empty());
  const MatrixX<double> reached = c.after(dynamics.input());
  CHECK((reached.leftCols(2) - c.poses.driven_positions).cwiseAbs().maxCoeff() < 1e-8);
  // Other forces, springs to points and wind are part of the frame.
  Case gusty;
  gusty.poses.wind = {0.0, 3.0, 0.0};
  gusty.poses.force_vertices = {7, gusty.poses.driven_vertices[1]};
  gusty.poses.forces = clothctl_test::noise<double>(4, 2, 0.01);
  gusty.poses.attached_vertices = {12};
  gusty.poses.attached_positions = gusty.sheet.state.positions.col(12) + Vector3<double>(0, 0.1, 0);
  gusty.poses.attachment_stiffness = VectorX<double>::Constant(1, 2.0);
  REQUIRE(gusty.solve(dynamics));
  REQUIRE(dynamics.input().forces.cols() == 4);
  CHECK(dynamics.input().attached_vertices == gusty.poses.attached_vertices);
  CHECK((gusty.after(dynamics.input()).leftCols(2) - gusty.poses.driven_positions)
            .cwiseAbs()
            .maxCoeff() < 1e-8);
}

TEST_CASE("forces weigh positions against velocities", "[mpc]") {
  const Case c;
  for (const double velocity : {0.3, 1.0}) {
    Dynamics dynamics = c.dynamics(exact(velocity));
    REQUIRE(c.solve(dynamics));
    const auto cost = [&](const ClothInput<double>& input) {
      const MatrixX<double> reached = c.after(input);
      const double weight = velocity * kFrame;
      return (reached.leftCols(2) - c.poses.driven_positions).squaredNorm() +
             weight * weight * (reached.rightCols(2) - c.velocities).squaredNorm();
    };
    const double least = cost(dynamics.input());
    for (unsigned seed = 0; seed < 8; ++seed) {
      ClothInput<double> other = dynamics.input();
      other.forces += clothctl_test::noise<double>(20 + seed, 2, 1e-3);
      CHECK(least < cost(other));
    }
  }
}

TEST_CASE("finger forces obey the contact law, and add up to what is sent", "[mpc]") {
  for (const double limit : {20.0, 0.05}) {  // the second cannot carry the sheet
    Case c;
    c.setup = clothctl_test::corner_setup(c.sheet, 1, 0.5, limit);
    Dynamics dynamics = c.dynamics({});
    double most = 0.0;
    for (int frame = 0; frame < 3; ++frame) {
      REQUIRE(c.solve(dynamics));
      Points<double> sum = Points<double>::Zero(3, 2);
      for (const FingerForce<double>& f : dynamics.finger_forces()) {
        CHECK(cone_violation<double>(f.force, f.normal, 0.5, limit) <= 1e-9 * limit);
        CHECK(f.vertex == dynamics.held()[static_cast<std::size_t>(f.grip)]);
        sum.col(f.grip) += f.force;
        most = (std::max)(most, f.force.dot(f.normal));
      }
      CHECK((sum - dynamics.input().forces).cwiseAbs().maxCoeff() <= 1e-12 * limit);
    }
    CHECK((limit == 20.0) == (most < 0.99 * limit));
  }
}

TEST_CASE("a finger that sticks may pull, and no harder than it can", "[mpc]") {
  using Contact = AdhesiveFinger<double>;
  Case c;
  PlannerSetup<double, Contact> setup;
  setup.triangles = c.sheet.network.triangles;
  for (const int v : c.poses.driven_vertices) {  // one finger on each corner, from one side
    Grip<double, Contact> grip;
    grip.fingers.push_back({{v}, 1.0, Contact{{0.9, 8}, 0.5}, 20.0});
    setup.grips.push_back(grip);
  }
  setup.features.add_point(c.sheet.lower_left());
  auto dynamics = PoseForces<MassSpring<double>, PlannerSetup<double, Contact>>::create(
                      c.model, setup, exact(0))
                      .value();
  double least = 0, missed = 0;
  for (const double distance : {0.0, 0.001, -0.001, 0.1, -0.1}) {
    Case moved = c;
    for (Index j = 0; j < 2; ++j) {
      const int v = c.poses.driven_vertices[static_cast<std::size_t>(j)];
      moved.poses.driven_positions.col(j) =
          c.sheet.state.positions.col(v) + Vector3<double>(0, distance, 0);
    }
    REQUIRE(dynamics.solve(c.sheet.state.positions, c.sheet.state.velocities, moved.poses,
                           c.velocities, kFrame));
    for (const FingerForce<double>& f : dynamics.finger_forces()) {
      CHECK(cone_violation<double>(f.force + 0.5 * f.normal, f.normal, 0.9, 20.5) <= 1e-8);
      least = (std::min)(least, f.force.dot(f.normal));
    }
    const MatrixX<double> after = c.after(dynamics.input());
    missed = (std::max)(missed, std::abs(after(1, 0) - moved.poses.driven_positions(1, 0)));
  }
  CHECK(least < -0.1);  // it pulls
  CHECK(-0.5 - 1e-9 <= least);
  CHECK(0.01 < missed);  // that is not enough for 0.1 m
}

TEST_CASE("more linearisations come closer where steps are not linear in the forces", "[mpc]") {
  Case c;
  c.model = c.sheet.model(Integration::Newton);
  c.poses.driven_positions.row(2).array() += 0.02;
  double last = 1.0;
  for (const int steps : {1, 2, 4}) {
    PoseForcesSettings settings = exact(0);
    settings.newton_steps = steps;
    Dynamics dynamics = c.dynamics(settings);
    REQUIRE(c.solve(dynamics));
    const double error = (c.after(dynamics.input()).leftCols(2) - c.poses.driven_positions).norm();
    CAPTURE(steps, error);
    CHECK(error < 0.5 * last);
    last = error;
  }
}

TEST_CASE("what does not fit is refused, and changes nothing", "[mpc]") {
  const Case c;
  PoseForcesSettings bad;
  bad.difference = 0;
  CHECK(Dynamics::create(c.model, c.setup, bad).error() == "difference is 0, must be positive");
  bad = {};
  bad.ridge = std::numeric_limits<double>::quiet_NaN();
  CHECK(Dynamics::create(c.model, c.setup, bad).error() == "ridge is nan, must be positive");
  bad = {};
  bad.velocity = -1;
  CHECK(Dynamics::create(c.model, c.setup, bad).error().find("velocity is -1") == 0);
  bad = {};
  bad.newton_steps = 0;
  CHECK(Dynamics::create(c.model, c.setup, bad).error().find("newton_steps is 0") == 0);
  PlannerSetup<double> off = c.setup;
  off.grips[1].fingers[0].vertices = {25};
  CHECK(Dynamics::create(c.model, off).error().find("vertex 25") != std::string::npos);

  Dynamics dynamics = c.dynamics({});
  REQUIRE(c.solve(dynamics));
  const ClothInput<double> before = dynamics.input();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Points<double>&x = c.sheet.state.positions, &v = c.sheet.state.velocities;
  Case other = c;
  other.poses.driven_vertices = {c.poses.driven_vertices[1], c.poses.driven_vertices[0]};
  CHECK_FALSE(other.solve(dynamics));
  other = c;
  other.poses.driven_positions(1, 1) = nan;
  CHECK_FALSE(other.solve(dynamics));
  other = c;
  other.velocities.conservativeResize(3, 1);
  CHECK_FALSE(other.solve(dynamics));
  other = c;
  other.poses.force_vertices = {99};  // the step refuses it
  other.poses.forces.setZero(3, 1);
  CHECK_FALSE(other.solve(dynamics));
  other = c;
  other.sheet.state.velocities(2, 3) = nan;
  CHECK_FALSE(other.solve(dynamics));
  CHECK_FALSE(dynamics.solve(x.leftCols(24), v, c.poses, c.velocities, kFrame));
  for (const double dt : {0.0, -0.02, nan})
    CHECK_FALSE(dynamics.solve(x, v, c.poses, c.velocities, dt));
  CHECK(dynamics.input().forces == before.forces);
  CHECK(dynamics.input().force_vertices == before.force_vertices);
}

TEST_CASE("forces are found without allocation, and the same ones after a reset", "[mpc]") {
  Case c;
  c.model = c.sheet.model(Integration::Newton);  // whose steps are not linear in the forces
  Dynamics dynamics = c.dynamics({});
  REQUIRE(c.solve(dynamics));
  const Points<double> first = dynamics.input().forces;
  const long before = clothctl_test::allocations();
  const bool solved = c.solve(dynamics);
  const long made = clothctl_test::allocations() - before;
  REQUIRE(solved);
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(dynamics.input().forces != first);  // it starts from the forces of the last frame
  dynamics.reset();
  REQUIRE(c.solve(dynamics));
  CHECK(dynamics.input().forces == first);
}

TEST_CASE("forces make a position-based sheet follow planned poses", "[mpc]") {
  HangingSheet sheet = clothctl_test::hanging_sheet(9);
  using Sheet = PositionBased<double>;
  PositionBasedSettings<double> settings;
  settings.drag = 0.5;
  const Sheet model = Sheet::create(sheet.network, settings).value();
  PositionBasedSettings<double> calm = settings;  // unfinished sweeps let it hang lower
  calm.drag = 10;
  calm.pinned = {sheet.upper_left(), sheet.upper_right()};
  ModelPlant<Sheet> settled(Sheet::create(sheet.network, calm).value());
  settled.set_state(sheet.state);
  for (int i = 0; i < 150; ++i) REQUIRE(settled.advance(kFrame).advanced);
  sheet.state = settled.state();
  const clothctl_test::AsyncTarget target(sheet, 1.5);
  const auto setup = clothctl_test::corner_setup(sheet);
  PlannerSettings<double> damped = PlannerSettings<double>::rollout();
  damped.weights.smooth = 0.3;
  damped.weights.step = 0.05;
  using Simulated = SimulatorPredictor<Sheet>;
  auto planner = Planner<Simulated>::create(
                     setup, clothctl_test::corner_settings(sheet, GripInput::Pose, 12, damped),
                     Simulated(model), sheet.state.positions)
                     .value();
  auto dynamics = PoseForces<Sheet>::create(model, setup).value();
  ModelPlant<Sheet> plant(model);
  plant.set_state(sheet.state);
  PlanResult<double> result = planner.make_result();
  const int frames = clothctl_test::kSanitized ? 20 : clothctl_test::trials(60, 250);
  double error = 0.0;
  for (int frame = 0; frame < frames; ++frame) {
    const double t = frame * kFrame;
    REQUIRE(planner.plan(plant.positions(), plant.velocities(), t, target, result) ==
            PlanStatus::Planned);
    const Points<double> next = result.plan.col(1).reshaped(3, 2);
    REQUIRE(dynamics.solve(plant.positions(), plant.velocities(), result.input, next, kFrame));
    plant.apply(dynamics.input());
    REQUIRE(plant.advance(kFrame).advanced);
    for (Index i = 0; i < 2; ++i) {
      const int corner = clothctl_test::corners(sheet)[static_cast<std::size_t>(i)];
      error += (plant.positions().col(corner) - target(i, t + kFrame)).norm() / (2.0 * frames);
    }
  }
  CAPTURE(error);
  CHECK(error < 0.012);
}
