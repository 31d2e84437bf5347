// Plans of random tasks: every setting within what `validate` accepts, measurements and targets
// that jump. A frame answers with a status; a plan that may be applied is finite and within the
// cones.

#include <algorithm>
#include <cmath>
#include <vector>

#include "mpc/instances.hpp"
#include "support/catch.hpp"
#include "support/random_bodies.hpp"
#include "support/sheets.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::Draw;
using clothctl_test::FrozenPredictor;
using clothctl_test::HangingSheet;

namespace {

// A weight: the default, nothing, or any size.
double weight(Draw& draw, double usual) {
  if (draw.chance(0.5)) return usual;
  return draw.chance(0.2) ? 0.0 : draw.decades(-9, 9);
}

PlannerSettings<double> random_settings(Draw& draw, const HangingSheet& sheet) {
  auto s = draw.chance(0.5) ? PlannerSettings<double>{} : PlannerSettings<double>::rollout();
  s.horizon = draw.whole(1, 16);
  s.dt = draw.chance(0.5) ? 0.02 : draw.decades(-4, 0);
  s.input = draw.chance(0.5) ? GripInput::Force : GripInput::Pose;
  if (s.input == GripInput::Force && draw.chance(0.5)) s.command = PlantCommand::Position;
  if (draw.chance(0.4)) s.patch = PatchMode::Hard;
  PlannerWeights<double>& w = s.weights;
  for (double* each : {&w.feature, &w.force, &w.cone, &w.velocity, &w.smooth, &w.shape, &w.anchor,
                       &w.patch, &w.limit, &w.jerk, &w.step})
    *each = weight(draw, *each);
  s.heavy_chain_axes = static_cast<HeavyChainAxes>(draw.whole(0, 2));
  if (draw.chance(0.2)) s.gravity = draw.decades(-3, 3);
  if (draw.chance(0.3)) s.least_agreement = draw.uniform(0, 0.99);
  if (draw.chance(0.3)) s.max_step = draw.decades(-6, 2);
  if (draw.chance(0.5)) s.max_change = draw.decades(-4, 2);
  if (draw.chance(0.3)) s.qp.max_iterations = draw.whole(1, 40);
  s.gravity_load = sheet.gravity_load();
  if (draw.chance(0.1)) s.gravity_load = draw.vector(draw.decades(-3, 6));
  return s;
}

PlannerSetup<double> random_setup(Draw& draw, const HangingSheet& sheet) {
  PlannerSetup<double> setup;
  const int n = sheet.grid.rows, patch = draw.whole(1, 2), grips = draw.whole(1, 3);
  for (int g = 0; g < grips; ++g) {
    std::vector<int> vertices;
    const int row = draw.whole(0, n - patch), corner = g == 0 ? 0 : (g == 1 ? n - patch : n / 2);
    for (int r = 0; r < patch; ++r) {
      for (int c = 0; c < patch; ++c) {
        if (corner + c < n) vertices.push_back(sheet.grid.vertex(row + r, corner + c));
      }
    }
    setup.grips.push_back(make_pinch<double>(vertices, draw.chance(0.1) ? 0.0 : draw.decades(-3, 2),
                                             draw.decades(-3, 4), draw.whole(4, 9)));
  }
  if (draw.chance(0.9)) setup.triangles = sheet.grid.triangles;
  const int features = draw.whole(1, 3), count = n * n;
  for (int i = 0; i < features; ++i) setup.features.add_point(draw.whole(0, count - 1));
  return setup;
}

// What the frames of one task measured and wanted.
struct Course {
  double noise, speed, way, jump, wind;

  explicit Course(Draw& draw)
      : noise(draw.chance(0.5) ? 0.0 : draw.decades(-6, 1)),
        speed(draw.chance(0.5) ? 0.0 : draw.decades(-3, 3)),
        way(draw.decades(-3, 1)),
        jump(draw.chance(0.7) ? 0.0 : draw.decades(-2, 5)),
        wind(draw.chance(0.7) ? 0.0 : draw.decades(-2, 3)) {}
};

// Largest violation of a friction cone or limit by a finger, over its largest force.
template <class AnyPlanner>
double worst_violation(const AnyPlanner& planner, const PlanResult<double>& plan) {
  double worst = 0;
  for (std::size_t first = 0; first < plan.finger_forces.size();) {
    const FingerForce<double>& lead = plan.finger_forces[first];
    const auto& finger = planner.grips()[static_cast<std::size_t>(lead.grip)]
                             .fingers[static_cast<std::size_t>(lead.finger)];
    const Index m = static_cast<Index>(finger.vertices.size());
    Points<double> normals(3, m), forces(3, m);
    for (Index j = 0; j < m; ++j) {
      const FingerForce<double>& f = plan.finger_forces[first + static_cast<std::size_t>(j)];
      normals.col(j) = f.normal, forces.col(j) = f.force;
    }
    const double size = forces.cwiseAbs().maxCoeff();
    const double violation =
        finger.contact.violation(normals, normals, forces, finger.max_normal_force);
    worst = std::max(worst, violation / std::max(size, 1e-6));
    first += static_cast<std::size_t>(m);
  }
  return worst;
}

bool all_finite_result(const PlanResult<double>& plan) {
  bool finite = plan.input.forces.allFinite() && plan.input.driven_positions.allFinite() &&
                plan.plan.allFinite() && plan.predicted.allFinite() &&
                std::isfinite(plan.prediction_error) && std::isfinite(plan.patch_residual) &&
                std::isfinite(plan.limit_excess) && std::isfinite(plan.anchor_weight);
  for (const FingerForce<double>& f : plan.finger_forces)
    finite = finite && f.force.allFinite() && f.normal.allFinite();
  return finite;
}

struct Tally {
  int frames = 0, applicable = 0, refused = 0;
};

template <class AnyPlanner, class Predictor>
void run_task(Draw& draw, const HangingSheet& sheet, Predictor predictor, Tally& tally) {
  auto made = AnyPlanner::create(random_setup(draw, sheet), random_settings(draw, sheet),
                                 std::move(predictor), sheet.state.positions);
  if (!made.has_value()) {
    CHECK(!made.error().empty());
    ++tally.refused;
    return;
  }
  AnyPlanner planner = std::move(made).value();
  PlanResult<double> plan = planner.make_result();
  const Course course(draw);
  const double dt = planner.settings().dt;
  for (int k = 0; k < 6; ++k) {
    const auto state = clothctl_test::shaken(
        sheet.state, static_cast<unsigned>(draw.whole(0, 1 << 30)), course.noise, course.speed);
    const Vector3<double> leap = draw.vector(course.jump);
    const auto target = [&](Index i, double t) -> Vector3<double> {
      const Vector3<double> from = sheet.state.positions.col(i == 0 ? 0 : sheet.grid.cols - 1);
      return from + leap + course.way * std::sin(3 * t) * Vector3<double>(0.3, 1, 0.5);
    };
    const auto wind = [&](double) -> Vector3<double> {
      return {course.wind, 0.3 * course.wind, 0};
    };
    const PlanStatus status =
        planner.plan(state.positions, state.velocities, dt * k, target, wind, plan);
    ++tally.frames;
    CAPTURE(k, to_string(status));
    CHECK(status == plan.status);
    CHECK(status != PlanStatus::InvalidInput);
    CHECK(all_finite_result(plan));
    // At most one more QP of each kind after the frame's iterations are used up.
    CHECK(plan.qp_iterations < 4 * planner.settings().qp.max_iterations);
    if (!can_apply(status)) continue;
    ++tally.applicable;
    CHECK(worst_violation(planner, plan) <= 1e-9);
  }
}

}  // namespace

TEST_CASE("plans of random tasks are finite and within the friction cones", "[mpc]") {
  const HangingSheet sheets[2] = {clothctl_test::hanging_sheet(4),
                                  clothctl_test::hanging_sheet(6, 1, 120)};
  Tally tally;
  const int count = clothctl_test::trials(150, 10000, 20);
  for (int seed = 0; seed < count; ++seed) {
    CAPTURE(seed);
    Draw draw(static_cast<std::uint64_t>(seed) + 1);
    const HangingSheet& sheet = sheets[draw.whole(0, 1)];
    const bool air = draw.chance(0.4);
    if (draw.chance(0.4)) {
      const MassSpringResponse<float> response(sheet.model(Integration::LinearlyImplicit, air));
      run_task<clothctl_test::FrozenPlanner>(draw, sheet, FrozenPredictor(response), tally);
    } else {
      const Integration integration =
          draw.chance(0.5) ? Integration::Newton : Integration::LinearlyImplicit;
      run_task<clothctl_test::RollingPlanner>(
          draw, sheet, clothctl_test::rolling_predictor(sheet.model(integration, air)), tally);
    }
  }
  CAPTURE(tally.frames, tally.applicable, tally.refused);
  CHECK(tally.frames > 5 * count);
  CHECK(10 * tally.applicable > 7 * tally.frames);
}
