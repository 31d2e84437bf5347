// Limits on the acceleration of hands: bounds, and what is sent.

#include "clothctl/mpc/detail/hand_motion.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "clothctl/mpc/run_frame.hpp"
#include "mpc/planner_loops.hpp"
#include "mpc/small_window.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::FrozenPlanner;
using clothctl_test::HangingSheet;
using clothctl_test::kFrame;
using clothctl_test::SmallWindow;

namespace {

using Vec = Vector3<double>;

const HangingSheet& sheet() {
  static const HangingSheet made = clothctl_test::hanging_sheet(9);
  return made;
}

struct Run {
  double acceleration = 0, turn_rate = 0, turn_acceleration = 0;  // the largest that were sent
  double worst_error = 0, last_error = 0;
};

/// The corners go 0.2 m along x within 0.4 s, and stay.
Run run(PlannerSettings<double> settings, int patch) {
  settings = clothctl_test::corner_settings(sheet(), settings.input, 12, settings);
  FrozenPlanner planner =
      clothctl_test::frozen_planner(sheet(), clothctl_test::corner_setup(sheet(), patch), settings);
  auto plant = clothctl_test::sheet_plant(sheet(), Integration::LinearlyImplicit);
  auto result = planner.make_result();
  const Points<double> start = sheet().state.positions(Eigen::all, clothctl_test::corners(sheet()));
  const auto target = [&](Index i, double t) -> Vec {
    const double s = std::clamp(t / 0.4, 0.0, 1.0);
    return Vec(start.col(i)) + Vec(0.2 * s * s * (3 - 2 * s), 0, 0);
  };
  const auto motion = [&](const Points<double>& x, const Points<double>& v, int grip) {
    const auto& held = planner.held();
    const Index size = patch * patch;
    Points<double> p(3, size), w(3, size);
    for (Index j = 0; j < size; ++j) {
      p.col(j) = x.col(held[static_cast<std::size_t>(grip * size + j)]);
      w.col(j) = v.col(held[static_cast<std::size_t>(grip * size + j)]);
    }
    return detail::fit_rigid_velocity<double>(p, w);
  };
  Run out;
  for (int k = 0; k < 100; ++k) {
    const Points<double> x = plant.positions(), v = plant.velocities();
    const auto report = run_frame(planner, plant, kFrame * k, target, result);
    REQUIRE(report.advanced());
    for (const int grip : {0, 1}) {
      const auto before = motion(x, v, grip), after = motion(x, plant.velocities(), grip);
      const Vec change = (after.linear - before.linear) / kFrame,
                turn = (after.angular - before.angular) / kFrame;
      out.acceleration = std::max(out.acceleration, change.cwiseAbs().maxCoeff());
      out.turn_acceleration = std::max(out.turn_acceleration, turn.cwiseAbs().maxCoeff());
      out.turn_rate = std::max(out.turn_rate, after.angular.cwiseAbs().maxCoeff());
    }
    out.worst_error = std::max(out.worst_error, report.max_error);
    out.last_error = report.mean_error;
  }
  return out;
}

PlannerSettings<double> commanding(GripInput input) {
  PlannerSettings<double> settings;
  settings.input = input;
  if (input == GripInput::Force) settings.command = PlantCommand::Position;
  return settings;
}

}  // namespace

TEST_CASE("hands accelerate no more than they can, and still arrive", "[mpc]") {
  for (const GripInput input : {GripInput::Pose, GripInput::Force}) {
    for (const int patch : {1, 2}) {
      PlannerSettings<double> settings = commanding(input);
      const Run free = run(settings, patch);
      settings.max_acceleration = 3;
      const Run slow = run(settings, patch);
      INFO("patch " << patch << ": " << free.acceleration << " " << slow.acceleration << ", errors "
                    << free.worst_error << " " << slow.worst_error << " " << slow.last_error);
      CHECK(free.acceleration > 5);
      CHECK(slow.acceleration <= 3 * (1 + 1e-9));
      CHECK(slow.acceleration > 2.99);
      CHECK(slow.worst_error < 0.1);
      CHECK(slow.last_error < 0.005);
    }
    if (clothctl_test::kSanitized) break;
  }
}

TEST_CASE("hands turn no faster than they can", "[mpc]") {
  PlannerSettings<double> settings = commanding(GripInput::Pose);
  const Run free = run(settings, 2);
  settings.max_turn_rate = free.turn_rate / 2;
  settings.max_turn_acceleration = free.turn_acceleration / 4;
  const Run slow = run(settings, 2);
  INFO(free.turn_rate << " " << slow.turn_rate << ", " << free.turn_acceleration << " "
                      << slow.turn_acceleration);
  // The turn that is sent is exact; what is measured differs by up to half its angle, 0.007.
  CHECK(slow.turn_rate <= settings.max_turn_rate * (1 + 1e-2));
  CHECK(slow.turn_acceleration <= settings.max_turn_acceleration * (1 + 1e-2));
  CHECK(slow.last_error < 0.005);
}

TEST_CASE("bounds of later frames are what can be reached", "[mpc]") {
  PlannerSettings<double> settings = clothctl_test::small_settings(GripInput::Pose);
  settings.max_acceleration = 2;
  settings.max_turn_rate = 0.5;
  SmallWindow window(settings);
  auto& problem = window.problem;
  for (Index j = 0; j < window.held_count(); ++j) problem.motion.velocity.col(j) << 0.3, 0, -0.01;
  const Index p = problem.basis.unknowns();
  VectorX<double> all_lower = VectorX<double>::Constant(p * settings.horizon, -0.1),
                  all_upper = -all_lower;
  detail::narrow_pose_bounds(problem, all_lower, all_upper);
  for (Index k = 0; k < settings.horizon; ++k) {
    const VectorX<double> lower = all_lower.segment(k * p, p), upper = all_upper.segment(k * p, p);
    const double reach = 0.04 * static_cast<double>(k + 1);
    // 0.3 m/s is beyond the bound: slow down as fast as can be.
    CHECK(lower[0] == Approx(std::max(-0.1, 0.3 - reach)));
    CHECK(upper[0] == Approx(std::max(0.1, 0.3 - reach)));
    CHECK(lower[1] == Approx(std::max(-0.1, -reach)));
    CHECK(upper[2] == Approx(std::min(0.1, -0.01 + reach)));
    CHECK(lower[4] == -0.1);
  }
  VectorX<double> lower = VectorX<double>::Constant(p * settings.horizon, -1), upper = -lower;
  detail::narrow_pose_bounds(problem, lower, upper);
  CHECK(lower[3] == -0.5);
  CHECK(upper[p + 5] == 0.5);
}

TEST_CASE("a hand that is too fast slows down, without allocation", "[mpc]") {
  for (const auto& intervals : {std::vector<Index>{}, std::vector<Index>{1, 1, 2, 8}}) {
    for (const int degree : {0, 3}) {
      CAPTURE(intervals.size(), degree);
      PlannerSettings<double> settings =
          clothctl_test::corner_settings(sheet(), GripInput::Pose, 12);
      settings.max_acceleration = 3;
      settings.max_turn_rate = 1;
      settings.max_turn_acceleration = 10;
      settings.input_intervals = intervals;
      settings.input_degree = degree;
      FrozenPlanner planner =
          clothctl_test::frozen_planner(sheet(), clothctl_test::corner_setup(sheet(), 2), settings);
      auto result = planner.make_result();
      Points<double> v = sheet().state.velocities;
      v.row(0).setConstant(3);  // beyond max_step/dt
      for (const int vertex : planner.held())
        v(2, vertex) += 0.5 * sheet().state.positions(0, vertex);
      const Points<double> x = sheet().state.positions;
      const std::vector<int> corners = clothctl_test::corners(sheet());
      const auto target = [&](Index i, double) -> Vec {
        return x.col(corners[static_cast<std::size_t>(i)]);
      };
      const long before = clothctl_test::allocations();
      const PlanStatus status = planner.plan(x, v, 0.0, target, result);
      const long taken = clothctl_test::allocations() - before;
      CHECK(status == PlanStatus::Planned);
      if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
      const Vec step = result.input.driven_positions.col(0) - x.col(planner.held()[0]);
      CHECK(step[0] / kFrame >= 3 - 3 * kFrame - 0.1);  // turning moves single vertices
    }
  }
}
