// A planner whose grips change between frames: the plan goes on, and so do the features.

#include <cmath>
#include <limits>

#include "clothctl/mpc/run_frame.hpp"
#include "mpc/planner_loops.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::AsyncTarget;
using clothctl_test::FrozenPlanner;
using clothctl_test::HangingSheet;
using clothctl_test::kFrame;
using clothctl_test::RollingPlanner;
using clothctl_test::SheetPlant;

namespace {

using Grips = std::vector<Grip<double>>;

const HangingSheet& sheet() {
  static const HangingSheet made = clothctl_test::hanging_sheet(9);
  return made;
}

Grips grips_of(const std::vector<std::vector<int>>& held, double limit = 20.0) {
  Grips grips;
  for (const std::vector<int>& vertices : held)
    grips.push_back(make_pinch<double>(vertices, 0.5, limit));
  return grips;
}

// The upper corners: patches of 2×2 vertices, and the left one without its inner vertex.
std::vector<int> left() { return sheet().corner_patch(0, 2); }
std::vector<int> right() { return sheet().corner_patch(1, 2); }
std::vector<int> less() {
  std::vector<int> vertices = left();
  vertices.pop_back();
  return vertices;
}
std::vector<std::vector<int>> single() { return {{sheet().upper_left()}, {sheet().upper_right()}}; }
std::vector<std::vector<int>> joined() {
  return {{sheet().upper_left(), sheet().upper_left() + 1}, {sheet().upper_right()}};
}

template <class P>
P planner_at(const Grips& grips, const PlannerSettings<double>& settings, const Points<double>& x) {
  PlannerSetup<double> setup = clothctl_test::corner_setup(sheet());
  setup.grips = grips;
  const MassSpring<double> model = sheet().model(Integration::LinearlyImplicit);
  if constexpr (std::is_same_v<P, RollingPlanner>) {
    return P::create(setup, settings, clothctl_test::rolling_predictor(model), x).value();
  } else {
    const clothctl_test::FrozenPredictor linear{MassSpringResponse<float>(model)};
    return P::create(setup, settings, linear, x).value();
  }
}

PlannerSettings<double> settings_of(GripInput input, bool rollout = false) {
  return clothctl_test::corner_settings(
      sheet(), input, 12, rollout ? PlannerSettings<double>::rollout() : PlannerSettings<double>{});
}

template <class P>
struct Loop {
  P planner;
  PlanResult<double> result = planner.make_result();
  SheetPlant plant = clothctl_test::sheet_plant(sheet(), Integration::LinearlyImplicit);
  AsyncTarget target = AsyncTarget(sheet(), 0.5);
  int frame = 0;

  // Returns the mean error of the features.
  double step() {
    const FrameReport<double> report = run_frame(planner, plant, kFrame * frame++, target, result);
    REQUIRE(report.advanced());
    CHECK(report.plan == PlanStatus::Planned);
    return report.mean_error;
  }
  double run(int frames) {
    double mean = 0;
    for (int k = 0; k < frames; ++k) mean += step() / frames;
    return mean;
  }
  void change(const Grips& grips) {
    REQUIRE(planner.set_grips(grips, plant.positions()) == "");
    result = planner.make_result();
  }
  // The planned vertical force of the first frame, N.
  double lift() const {
    double sum = 0;
    for (Index i = 2; i < result.plan.rows(); i += 3) sum += result.plan(i, 0);
    return sum;
  }
};

template <class P>
Loop<P> loop_of(const Grips& grips, const PlannerSettings<double>& settings) {
  return {planner_at<P>(grips, settings, sheet().state.positions)};
}

template <class P>
bool same_frames(Loop<P>& a, Loop<P>& b, int frames) {
  for (int k = 0; k < frames; ++k) {
    a.step();
    b.step();
    if (!(a.result.plan == b.result.plan && a.result.predicted == b.result.predicted &&
          a.result.qp_iterations == b.result.qp_iterations &&
          a.result.agreement == b.result.agreement && a.plant.positions() == b.plant.positions()))
      return false;
  }
  return true;
}

}  // namespace

TEST_CASE("setting the same grips changes no bit", "[mpc]") {
  const Grips grips = grips_of({left(), right()}, 0.6);
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    auto a = loop_of<FrozenPlanner>(grips, settings_of(input)), b = a;
    for (int change = 0; change < 3; ++change) {
      REQUIRE(a.planner.set_grips(grips, a.plant.positions()) == "");
      CHECK(same_frames(a, b, 6));
    }
  }
  auto a = loop_of<RollingPlanner>(grips_of(single()), settings_of(GripInput::Force, true)), b = a;
  CHECK(same_frames(a, b, 4));
  REQUIRE(a.planner.set_grips(grips_of(single()), a.plant.positions()) == "");
  CHECK(same_frames(a, b, 6));
}

TEST_CASE("bad grips are refused and nothing changes", "[mpc]") {
  auto a = loop_of<FrozenPlanner>(grips_of({left(), right()}), settings_of(GripInput::Force)),
       b = a;
  CHECK(same_frames(a, b, 5));
  const Points<double> x = a.plant.positions();
  const auto refused = [&](const Grips& grips, const Points<double>& at, const std::string& part) {
    const std::string text = a.planner.set_grips(grips, at);
    CAPTURE(text);
    CHECK(text.find(part) != std::string::npos);
  };
  refused({}, x, "no grips");
  refused(grips_of({{3, 3}}), x, "vertex 3 twice");
  refused(grips_of({{3}, {81}}), x, "grip 1 finger 0 holds vertex 81");
  refused(grips_of({{3}, {4, 3}}), x, "which grip 0 holds already");
  refused(grips_of({{3}}, -1.0), x, "largest normal force -1");
  refused(grips_of({{3}}), x.leftCols(80), "80 columns of position for 81 vertices");
  Points<double> broken = x;
  broken(1, 4) = std::numeric_limits<double>::quiet_NaN();
  refused(grips_of({{3}}), broken, "not finite");
  CHECK(a.planner.held() == b.planner.held());
  CHECK(same_frames(a, b, 5));
}

TEST_CASE("a planner goes on with its new grips, and refuses results of the old ones", "[mpc]") {
  auto loop = loop_of<FrozenPlanner>(grips_of(single()), settings_of(GripInput::Force));
  loop.run(3);
  REQUIRE(loop.planner.set_grips(grips_of({{73}, {79}}), loop.plant.positions()) == "");
  CHECK(loop.planner.held() == std::vector<int>{73, 79});
  CHECK(loop.planner.setup().grips[0].vertices() == std::vector<int>{73});
  // As many vertices as before, but others.
  CHECK(loop.planner.plan(loop.plant.positions(), loop.plant.velocities(), 0.0, loop.target,
                          loop.result) == PlanStatus::InvalidInput);
  loop.result = loop.planner.make_result();
  CHECK(loop.result.input.force_vertices == std::vector<int>{73, 79});
  loop.step();
  // Parameters alone keep results, and hold from the next frame on.
  REQUIRE(loop.planner.set_grips(grips_of({{73}, {79}}, 0.3), loop.plant.positions()) == "");
  loop.step();
  CHECK(loop.result.used_rows);
  for (const FingerForce<double>& f : loop.result.finger_forces)
    CHECK(f.force.dot(f.normal) < 0.3 + 1e-9);
}

TEST_CASE("before the first frame, set_grips is as good as other grips in the setup", "[mpc]") {
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    PlannerSettings<double> settings = settings_of(input);
    settings.heavy_chain_axes = HeavyChainAxes::Off;  // the length of sheet below a hand is kept
    auto a = loop_of<FrozenPlanner>(grips_of({left(), right()}), settings);
    auto b = loop_of<FrozenPlanner>(grips_of({less(), right()}), settings);
    a.change(grips_of({less(), right()}));
    a.step();
    b.step();
    CHECK((a.result.plan - b.result.plan).norm() < 1e-7 * b.result.plan.norm());
  }
}

TEST_CASE("the load stays carried when vertices join and leave", "[mpc]") {
  struct Case {
    std::vector<std::vector<int>> before, after;
  };
  int warm = 0, cold = 0;
  for (const Case& c : {Case{single(), joined()}, Case{{left(), right()}, {less(), right()}}}) {
    for (const double limit : {20.0, 0.35}) {
      if (limit < 1.0 && c.before != single()) continue;  // as good, but slow
      auto loop = loop_of<FrozenPlanner>(grips_of(c.before, limit), settings_of(GripInput::Force));
      loop.run(30);
      for (const auto& held : {c.after, c.before, c.after}) {
        const double before = loop.lift(), weight = sheet().gravity_load()[2];
        auto fresh = loop;
        fresh.planner = planner_at<FrozenPlanner>(
            grips_of(held, limit), settings_of(GripInput::Force), loop.plant.positions());
        fresh.result = fresh.planner.make_result();
        fresh.step();
        loop.change(grips_of(held, limit));
        loop.step();
        CAPTURE(limit, held[0].size(), before, loop.lift(), fresh.lift());
        CHECK(std::abs(loop.lift() - before) < 0.1 * weight);
        CHECK(loop.result.agreement > 0.5);  // the last prediction is remembered
        warm += loop.result.qp_iterations;
        cold += fresh.result.qp_iterations;
        loop.run(9);
      }
    }
  }
  CAPTURE(warm, cold);
  CHECK(warm < cold);
}

TEST_CASE("features follow through changes of the grips as they do without", "[mpc]") {
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    double carried = 0, renewed = 0, unchanged = 0;
    for (const bool fresh : {false, true}) {
      auto loop = loop_of<FrozenPlanner>(grips_of(single()), settings_of(input));
      loop.run(30);
      double last = loop.step(), jump = 0;
      for (int change = 0; change < 6; ++change) {
        const Grips grips = grips_of(change % 2 == 0 ? joined() : single());
        if (fresh) {
          loop.planner =
              planner_at<FrozenPlanner>(grips, settings_of(input), loop.plant.positions());
          loop.result = loop.planner.make_result();
        } else {
          loop.change(grips);
        }
        const double first = loop.step();
        jump = std::max(jump, std::abs(first - last));
        (fresh ? renewed : carried) += loop.run(8) / 6;
        last = loop.step();
      }
      if (!fresh) CHECK(jump < 0.001);
    }
    auto still = loop_of<FrozenPlanner>(grips_of(single()), settings_of(input));
    still.run(31);
    unchanged = still.run(60);
    CAPTURE(carried, renewed, unchanged);
    CHECK(carried < renewed);
    CHECK(carried < 1.2 * unchanged);
  }
}

TEST_CASE("rollouts go on with other grips", "[mpc]") {
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    auto loop = loop_of<RollingPlanner>(grips_of(single()), settings_of(input, true));
    loop.run(30);
    for (const auto& held : {joined(), single(), joined()}) {
      const double before = loop.lift();
      loop.change(grips_of(held));
      loop.step();
      if (input == GripInput::Force)
        CHECK(std::abs(loop.lift() - before) < 0.1 * sheet().gravity_load()[2]);
      const double mean = loop.run(14);
      CAPTURE(mean);
      CHECK(mean < 0.008);
    }
  }
}

TEST_CASE("a grip may be taken away and brought back", "[mpc]") {
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    auto loop = loop_of<FrozenPlanner>(grips_of({left(), right()}), settings_of(input));
    loop.run(20);
    loop.change(grips_of({right()}));
    CHECK(loop.planner.grips().size() == 1);
    loop.run(4);  // the left corner falls
    loop.change(grips_of({left(), right()}));
    loop.run(4);
    loop.change(grips_of({right(), left()}));  // the hands change their numbers alone
    const double mean = loop.run(40);
    CAPTURE(mean);
    CHECK(mean < 0.08);
  }
}

TEST_CASE("given anchors stay with their grips, and move with their centroids", "[mpc]") {
  PlannerSetup<double> setup = clothctl_test::corner_setup(sheet(), 2);
  HandAnchor<double> anchor;
  anchor.feature_weights = {0.25, 0.75};
  anchor.offset = {0.1, 0.2, 0.3};
  setup.anchors = {anchor, anchor};
  setup.anchors[1].offset[2] = 0.4;
  for (HandAnchor<double>& each : setup.anchors) each.hand_gap = 0.17;
  const Points<double>& x = sheet().state.positions;
  auto planner = clothctl_test::frozen_planner(sheet(), setup, settings_of(GripInput::Force));
  REQUIRE(planner.set_grips(grips_of({right(), {40}}), x) == "");
  REQUIRE(planner.setup().anchors.size() == 2);
  CHECK(planner.setup().anchors[0].offset == setup.anchors[1].offset);
  CHECK(planner.setup().anchors[0].hand_gap == 0.17);
  CHECK(planner.setup().validate(81) == "");
  REQUIRE(planner.set_grips(grips_of({{right()[0]}}), x) == "");
  Vector3<double> centroid = Vector3<double>::Zero();
  for (const int v : right()) centroid += x.col(v) / 4;
  CHECK(
      (planner.setup().anchors[0].offset - setup.anchors[1].offset - (x.col(right()[0]) - centroid))
          .norm() < 1e-14);
  CHECK(planner.setup().anchors[0].feature_weights == anchor.feature_weights);
}

TEST_CASE("a frame that fails after a change sends what is left of the last plan", "[mpc]") {
  bool fails = false;
  PlannerSetup<double> setup = clothctl_test::corner_setup(sheet(), 2);
  auto planner =
      Planner<clothctl_test::FailingPredictor>::create(
          setup, settings_of(GripInput::Force),
          clothctl_test::FailingPredictor{clothctl_test::FrozenPredictor(MassSpringResponse<float>(
                                              sheet().model(Integration::LinearlyImplicit))),
                                          &fails},
          sheet().state.positions)
          .value();
  Loop<Planner<clothctl_test::FailingPredictor>> loop{std::move(planner)};
  loop.run(8);
  Vector3<double> promised[2] = {Vector3<double>::Zero(), Vector3<double>::Zero()};
  for (Index j = 0; j < 8; ++j)
    promised[j / 4] += loop.result.plan.block<3, 1>(3 * j, 1);  // of the next frame
  fails = true;
  for (const auto& held : {std::vector<std::vector<int>>{less(), right()},
                           std::vector<std::vector<int>>{sheet().corner_patch(0, 3), right()},
                           std::vector<std::vector<int>>{less()}}) {
    Loop<Planner<clothctl_test::FailingPredictor>> other = loop;
    other.change(grips_of(held));
    CHECK(other.planner.plan(other.plant.positions(), other.plant.velocities(), 8 * kFrame,
                             other.target, other.result) == PlanStatus::Failed);
    const Vector3<double> all = other.result.input.forces.rowwise().sum();
    CHECK((all - promised[0] - promised[1]).norm() < 1e-12);
    if (held.size() == 2) {  // each grip keeps its own
      const Vector3<double> one = other.result.input.forces.rightCols(4).rowwise().sum();
      CHECK((one - promised[1]).norm() < 1e-12);
    }
    for (const FingerForce<double>& f : other.result.finger_forces)
      CHECK(f.normal.norm() == Approx(1.0));
  }
}

TEST_CASE("planning after a change of the grips does not allocate", "[mpc]") {
  if (!clothctl_test::allocation_counting_works()) return;
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    for (const double limit : {20.0, 0.35}) {
      auto loop = loop_of<FrozenPlanner>(grips_of(single(), limit), settings_of(input));
      auto rolling = loop_of<RollingPlanner>(grips_of(single()), settings_of(input, true));
      const auto made = [](auto& l) {
        const Points<double> x = l.plant.positions(), v = l.plant.velocities();
        const long before = clothctl_test::allocations();
        const PlanStatus status = l.planner.plan(x, v, kFrame * l.frame, l.target, l.result);
        const long count = clothctl_test::allocations() - before;
        CHECK(can_apply(status));
        return count;
      };
      for (const auto& held : {joined(), single(), joined()}) {
        loop.run(3);
        loop.change(grips_of(held, limit));
        CHECK(made(loop) == 0);
        if (limit < 1.0) continue;
        rolling.run(3);
        rolling.change(grips_of(held));
        CHECK(made(rolling) == 0);
      }
    }
  }
}
