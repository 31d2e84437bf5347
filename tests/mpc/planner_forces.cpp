// Planned forces in closed loops, with each solver. Every finger must be inside its friction cone
// and below its limit in every frame, and the plant must receive the sum of the fingers' forces.

#include "mpc/planner_loops.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::AsyncTarget;
using clothctl_test::HangingSheet;

namespace {

struct ForceLoop {
  double worst_cone = 0, worst_sum = 0, worst_low = 0, worst_high = 0;
  int row_frames = 0, at_limit = 0, at_cone = 0;
};

ForceLoop run(const HangingSheet& sheet, int patch, double friction, double limit,
              Integration integration, int frames, PatchMode mode = PatchMode::Soft,
              Index horizon = 12) {
  const PlannerSetup<double> setup = clothctl_test::corner_setup(sheet, patch, friction, limit);
  PlannerSettings<double> settings =
      clothctl_test::corner_settings(sheet, GripInput::Force, horizon);
  settings.patch = mode;
  auto planner = clothctl_test::frozen_planner(sheet, setup, settings);
  auto plant = clothctl_test::sheet_plant(sheet, integration);
  ForceLoop out;
  const auto stats = clothctl_test::run_loop(
      planner, plant, frames, clothctl_test::corners(sheet), AsyncTarget(sheet),
      clothctl_test::NoWind(), [&](int, const PlanResult<double>& result) {
        out.row_frames += result.used_rows ? 1 : 0;
        Points<double> sum = Points<double>::Zero(3, result.input.forces.cols());
        std::vector<std::vector<double>> normal(2, std::vector<double>(2, 0.0));
        for (const FingerForce<double>& f : result.finger_forces) {
          const double f_n = f.force.dot(f.normal), f_t = (f.force - f_n * f.normal).norm();
          out.worst_cone = std::max(out.worst_cone, f_t - friction * f_n);
          out.worst_low = std::max(out.worst_low, -f_n);
          normal[static_cast<std::size_t>(f.grip)][static_cast<std::size_t>(f.finger)] += f_n;
          if (f_n > 1e-3 && f_t > 0.7 * friction * f_n)
            ++out.at_cone;  // of the pyramid with four generators
          for (Index j = 0; j < sum.cols(); ++j) {
            if (result.input.force_vertices[static_cast<std::size_t>(j)] == f.vertex)
              sum.col(j) += f.force;
          }
        }
        for (const auto& grip : normal) {
          for (const double f_n : grip) {
            out.worst_high = std::max(out.worst_high, f_n - limit);
            if (f_n > limit - 1e-6) ++out.at_limit;
          }
        }
        out.worst_sum = std::max(out.worst_sum, (sum - result.input.forces).cwiseAbs().maxCoeff());
      });
  CHECK(stats.failures == 0);
  return out;
}

void check(const ForceLoop& loop) {
  CHECK(loop.worst_cone <= 1e-9);
  CHECK(loop.worst_low <= 0.0);
  CHECK(loop.worst_high <= 1e-9);
  CHECK(loop.worst_sum <= 1e-12);
}

}  // namespace

TEST_CASE("forces are inside cones and limits that are not active", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(9);
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    const ForceLoop loop = run(sheet, 1, 0.5, 20.0, integration, 60);
    check(loop);
    CHECK(loop.row_frames == 0);
  }
}

TEST_CASE("forces are inside cones and limits that are active", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(9);
  // Two fingers carry half of the weight, 0.25 N for each hand, by friction.
  for (const double friction : {0.3, 0.8}) {
    const double limit = 1.15 * 0.5 * 0.5 * sheet.gravity_load()[2] / friction;
    CAPTURE(friction, limit);
    const ForceLoop loop = run(sheet, 1, friction, limit, Integration::LinearlyImplicit, 60);
    check(loop);
    CHECK(loop.row_frames > 10);
    CHECK(loop.at_limit > 0);
    CHECK(loop.at_cone > 0);
  }
  // Too weak to hold the sheet: it falls, and the forces stay within their limits.
  const ForceLoop falling = run(sheet, 1, 0.5, 0.1, Integration::LinearlyImplicit, 15);
  check(falling);
  CHECK(falling.at_limit > 10);
}

TEST_CASE("with hard patches too, forces are inside cones and limits", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(9, 2);
  for (const double limit : {20.0, 0.3}) {
    const ForceLoop loop =
        run(sheet, 2, 0.8, limit, Integration::LinearlyImplicit, 10, PatchMode::Hard, 4);
    check(loop);
    CHECK(loop.row_frames == 10);
  }
}

TEST_CASE("patches with the same finger share its limit", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(9, 2);
  for (const double limit : {20.0, 0.3}) {
    const ForceLoop loop =
        run(sheet, 2, 0.8, limit, Integration::LinearlyImplicit, 20, PatchMode::Soft, 6);
    check(loop);
  }
}

TEST_CASE("in a longer run with a finer sheet, forces are inside cones and limits", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(17, 1, 60);
  const ForceLoop tight = run(sheet, 1, 0.5, 0.3, Integration::LinearlyImplicit,
                              clothctl_test::trials(20, 250), PatchMode::Soft, 12);
  check(tight);
  CHECK(tight.row_frames > 0);
  if (!clothctl_test::full_tier()) return;
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    check(run(sheet, 1, 0.5, 20.0, integration, 250, PatchMode::Soft, 20));
    check(run(clothctl_test::hanging_sheet(17, 2, 60), 2, 0.4, 0.6, integration, 60,
              PatchMode::Soft, 8));
  }
}
