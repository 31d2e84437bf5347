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
#include "clothctl/math/rotation.hpp"
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
  template <class AnyDynamics>
  bool solve(AnyDynamics& dynamics) const {
    return dynamics.solve(sheet.state.positions, sheet.state.velocities, poses, velocities, kFrame);
  }
};

// The same steps without the type Impulses.
struct Stepped {
  using Scalar = double;
  MassSpring<double> model;

  Index vertex_count() const { return model.vertex_count(); }
  ClothState<double> rest_state() const { return model.rest_state(); }
  auto make_workspace() const { return model.make_workspace(); }
  StepReport<double> step(ClothState<double>& state, const ClothInput<double>& input, double dt,
                          MassSpring<double>::Workspace& ws) const {
    return model.step(state, input, dt, ws);
  }
};

// Where the held vertices of two flat patches are that go round and turn, the rest shape scaled.
Points<double> moved_patches(const HangingSheet& sheet, const std::vector<int>& held, double t,
                             double scale) {
  const Points<double>& rest = sheet.network.rest_positions;
  const Matrix3<double> turn = rotation_exp<double>(Vector3<double>(0.2 * std::sin(3 * t), 0, 0));
  const Vector3<double> way(0.05 * std::sin(3 * t), 0.05 * (1 - std::cos(3 * t)), 0);
  Points<double> out(3, 8);
  for (Index g = 0; g < 2; ++g) {
    const int corner = sheet.corner_patch(static_cast<int>(g), 1).front();
    Vector3<double> centre = Vector3<double>::Zero();
    for (Index j = 4 * g; j < 4 * g + 4; ++j)
      centre += rest.col(held[static_cast<std::size_t>(j)]) / 4;
    const Vector3<double> from_corner = centre - rest.col(corner);
    const Vector3<double> middle = sheet.state.positions.col(corner) + way + turn * from_corner;
    for (Index j = 4 * g; j < 4 * g + 4; ++j) {
      const Vector3<double> arm = scale * (rest.col(held[static_cast<std::size_t>(j)]) - centre);
      out.col(j) = middle + turn * arm;
    }
  }
  return out;
}

PoseForcesSettings exact(double velocity) {
  PoseForcesSettings settings;
  settings.velocity = velocity;
  settings.newton_steps = 1;
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
  gusty.poses.attached_vertices = {12, gusty.poses.driven_vertices[0]};  // the second is held
  gusty.poses.attached_positions.resize(3, 2);
  for (Index i = 0; i < 2; ++i)
    gusty.poses.attached_positions.col(i) =
        gusty.sheet.state.positions.col(
            gusty.poses.attached_vertices[static_cast<std::size_t>(i)]) +
        Vector3<double>(0, 0.1, 0);
  gusty.poses.attachment_stiffness = VectorX<double>::Constant(2, 2.0);
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
    auto dynamics = PoseForces<Stepped>::create(Stepped{c.model}, c.setup, settings).value();
    REQUIRE(c.solve(dynamics));
    const double error = (c.after(dynamics.input()).leftCols(2) - c.poses.driven_positions).norm();
    CAPTURE(steps, error);
    CHECK(error < 0.5 * last);
    last = error;
  }
}

TEST_CASE("the matrix of a step gives the forces that differences give", "[mpc]") {
  Case c;
  c.setup = clothctl_test::corner_setup(c.sheet, 2);
  Dynamics by_matrix = c.dynamics({});
  auto by_steps = PoseForces<Stepped>::create(Stepped{c.model}, c.setup).value();
  c.poses.driven_vertices = by_matrix.held();
  c.poses.driven_positions.resize(3, 8);
  c.velocities = clothctl_test::noise<double>(5, 8, 0.2);
  for (unsigned frame = 0; frame < 3; ++frame) {
    for (Index j = 0; j < 8; ++j)
      c.poses.driven_positions.col(j) =
          c.sheet.state.positions.col(c.poses.driven_vertices[static_cast<std::size_t>(j)]);
    c.poses.driven_positions += clothctl_test::noise<double>(7 + frame, 8, 0.001);
    const long before = clothctl_test::allocations();
    const bool solved = c.solve(by_matrix);
    const long made = clothctl_test::allocations() - before;
    REQUIRE(solved);
    if (frame > 0 && clothctl_test::allocation_counting_works()) CHECK(made == 0);
    REQUIRE(c.solve(by_steps));
    Dynamics copy = by_matrix;
    by_matrix = c.dynamics({});  // the copy does not need what it was copied from
    REQUIRE(c.solve(copy));
    by_matrix = copy;
    const double apart = (by_matrix.input().forces - by_steps.input().forces).cwiseAbs().maxCoeff();
    const double size = by_steps.input().forces.cwiseAbs().maxCoeff();
    CAPTURE(frame, apart, size);
    CHECK(apart < 1e-5 * size);
  }
}

TEST_CASE("forces carry patches that they spread", "[mpc]") {
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    for (const double spread : {0.0, 0.03}) {
      Case c;
      c.model = c.sheet.model(integration);
      c.setup = clothctl_test::corner_setup(c.sheet, 2, 0.5, 60.0);
      PoseForcesSettings settings = exact(0);
      settings.spread = spread;
      Dynamics dynamics = c.dynamics(settings);
      c.poses.driven_vertices = dynamics.held();
      c.velocities.setZero(3, 8);
      ModelPlant<MassSpring<double>> plant(c.model);
      plant.set_state(c.sheet.state);
      double late = 0;
      for (int frame = 1; frame <= 60; ++frame) {
        c.poses.driven_positions = moved_patches(c.sheet, dynamics.held(), frame * kFrame, 1.0);
        REQUIRE(
            dynamics.solve(plant.positions(), plant.velocities(), c.poses, c.velocities, kFrame));
        plant.apply(dynamics.input());
        REQUIRE(plant.advance(kFrame).advanced);
        const Points<double> goal =
            moved_patches(c.sheet, dynamics.held(), frame * kFrame, 1.0 + spread);
        double off = 0;
        for (Index j = 0; j < 8; ++j) {
          const int v = dynamics.held()[static_cast<std::size_t>(j)];
          off = (std::max)(off, (plant.positions().col(v) - goal.col(j)).norm());
        }
        if (frame > 20) late = (std::max)(late, off);
      }
      CAPTURE(integration, spread, late);
      if (spread == 0.0 && integration == Integration::Newton) continue;  // some forces buckle it
      CHECK(late < 2e-5);
    }
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
  bad.spread = -0.1;
  CHECK(Dynamics::create(c.model, c.setup, bad).error().find("spread is -0.1") == 0);
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
  Dynamics by_matrix = c.dynamics({});
  auto by_steps = PoseForces<Stepped>::create(Stepped{c.model}, c.setup).value();
  const auto check = [&](auto& dynamics) {
    REQUIRE(c.solve(dynamics));
    const Points<double> first = dynamics.input().forces;
    const long before = clothctl_test::allocations();
    const bool solved = c.solve(dynamics);
    const long made = clothctl_test::allocations() - before;
    REQUIRE(solved);
    if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
    const double apart = (dynamics.input().forces - first).cwiseAbs().maxCoeff();
    dynamics.reset();
    REQUIRE(c.solve(dynamics));
    CHECK(dynamics.input().forces == first);
    return apart;
  };
  CHECK(check(by_matrix) < 1e-9);
  CHECK(0.0 < check(by_steps));  // it starts from the forces of the last frame
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
