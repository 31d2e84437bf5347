// The planner goes on after the sheet has torn: features, grips and start positions follow the
// remap, and a new planner on the torn sheet tracks as well as before.

#include "clothctl/cloth/tearable_sheet.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/run_frame.hpp"
#include "mpc/planner_loops.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::AsyncTarget;
using clothctl_test::FrozenPlanner;
using clothctl_test::FrozenPredictor;
using clothctl_test::HangingSheet;
using clothctl_test::kFrame;

namespace {

using Sheet = TearableSheet<MassSpring<double>>;

/// Makes a planner on the sheet as it is now; `start`: its vertices in the start pose.
FrozenPlanner planner_of(const Sheet& sheet, const PlannerSetup<double>& setup,
                         const PlannerSettings<double>& settings, const Points<double>& start) {
  MassSpringSettings<double> linear = sheet.model().settings();
  linear.integration = Integration::LinearlyImplicit;
  const auto model = MassSpring<double>::create(sheet.network(), linear).value();
  return FrozenPlanner::create(setup, settings, FrozenPredictor(MassSpringResponse<float>(model)),
                               start)
      .value();
}

/// Cuts a sheet of 7×7 vertices twice, in lines of rest vertices: between the features from below,
/// and a notch in the patch of the left hand. Set-up and start positions follow.
void tear(Sheet& sheet, PlannerSetup<double>& setup, Points<double>& start) {
  const Points<double> rest = sheet.network().rest_positions;
  for (const std::array<int, 2>& ends : {std::array<int, 2>{3, 17}, std::array<int, 2>{43, 36}}) {
    Points<double> line(3, 2);
    line << rest.col(ends[0]), rest.col(ends[1]);
    const Remap<double> remap = sheet.cut_at_rest(line).value();
    CHECK(remap.vertex_count() > remap.old_vertex_count());
    setup.features = remap_features(setup.features, remap);
    setup.grips = remap_grips(setup.grips, remap);
    start = remap.interpolate(start);
  }
  setup.triangles = sheet.network().triangles;
}

/// Runs 3/8 of `frames`, tears the sheet or not, and goes on with a new planner. Returns the mean
/// error of the features over the last 3/8.
double tracked(const HangingSheet& hanging, GripInput input, bool torn, int frames) {
  Sheet sheet = Sheet::create(hanging.model(Integration::Newton), {}).value();
  sheet.set_state(hanging.state);
  PlannerSetup<double> setup = clothctl_test::corner_setup(hanging, 2);
  const PlannerSettings<double> settings = clothctl_test::corner_settings(hanging, input);
  const AsyncTarget target(hanging);
  Points<double> start = hanging.state.positions;
  FrozenPlanner planner = planner_of(sheet, setup, settings, start);
  PlanResult<double> result = planner.make_result();
  double mean = 0;
  for (int frame = 0; frame < frames; ++frame) {
    if (frame == 3 * frames / 8) {
      if (torn) {
        tear(sheet, setup, start);
        // The old planner sees that its sheet is gone.
        CHECK(run_frame(planner, sheet, kFrame * frame, target, result).status ==
              FrameStatus::PlantMismatch);
        CHECK(setup.grips[0].vertices().size() == 5);
      }
      planner = planner_of(sheet, setup, settings, start);
      result = planner.make_result();
      CHECK(check_plant(planner, sheet) == "");
    }
    const FrameReport<double> report = run_frame(planner, sheet, kFrame * frame, target, result);
    REQUIRE(report.advanced());
    if (frame >= 5 * frames / 8) mean += report.mean_error / (3 * frames / 8);
  }
  return mean;
}

}  // namespace

TEST_CASE("the planner goes on tracking after a tear", "[mpc]") {
  const HangingSheet hanging = clothctl_test::hanging_sheet(7);
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    const int frames = clothctl_test::trials(160, 160, 16);
    const double whole = tracked(hanging, input, false, frames);
    const double torn = tracked(hanging, input, true, frames);
    INFO("mean error of the whole sheet " << whole << " m, of the torn one " << torn << " m");
    CHECK(torn < 2 * whole + 0.002);
    CHECK(torn < 0.025);
  }
}
