// The planner as a component: what it refuses, what it leaves alone, and that it repeats. Closed loops are judged in
// planner_forces.cpp, planner_patches.cpp and planner_tracking.cpp.

#include "clothctl/mpc/planner.hpp"

#include <limits>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/mpc/exact_predictor.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"

using namespace clothctl;
using clothctl_test::AsyncTarget;
using clothctl_test::HangingSheet;
using V = Vector3<double>;

namespace {

constexpr double kDt = clothctl_test::kFrame;
using Predicting = ExactPredictor<MassSpringResponse<float>, double>;
using Planning = Planner<Predicting>;
using Plant = ModelPlant<MassSpring<double>>;

const HangingSheet& sheet() {
  static const HangingSheet made = clothctl_test::hanging_sheet(7, 1, 60);
  return made;
}

PlannerSetup<double> setup(double limit = 20.0) {
  PlannerSetup<double> out;
  out.features.add_point(sheet().lower_left());
  out.features.add_point(sheet().lower_right());
  out.triangles = sheet().network.triangles;
  for (int side : {0, 1}) out.grips.push_back(make_pinch<double>(sheet().corner_patch(side, 1), 0.5, limit));
  return out;
}

PlannerSettings<double> settings(GripInput input = GripInput::Force) {
  PlannerSettings<double> out;
  out.horizon = 8;
  out.input = input;
  if (input == GripInput::Force) out.supported = sheet().supported();
  return out;
}

Result<Planning> try_planner(const PlannerSetup<double>& s, const PlannerSettings<double>& p,
                             const Points<double>& start = sheet().state.positions) {
  return Planning::create(s, p, Predicting(MassSpringResponse<float>(sheet().model(Integration::OneSolve))), start);
}
Planning planner_for(const PlannerSetup<double>& s, const PlannerSettings<double>& p) { return try_planner(s, p).value(); }

V calm(double) { return V::Zero(); }

bool same(const PlanResult<double>& a, const PlanResult<double>& b) {
  if (!(a.status == b.status && a.plan == b.plan && a.predicted == b.predicted && a.input.forces == b.input.forces &&
        a.input.driven_positions == b.input.driven_positions && a.prediction_error == b.prediction_error &&
        a.agreement == b.agreement && a.patch_residual == b.patch_residual && a.qp_iterations == b.qp_iterations &&
        a.qp_status == b.qp_status && a.used_rows == b.used_rows && a.finger_forces.size() == b.finger_forces.size())) {
    return false;
  }
  for (std::size_t i = 0; i < a.finger_forces.size(); ++i) {
    if (!(a.finger_forces[i].force == b.finger_forces[i].force && a.finger_forces[i].normal == b.finger_forces[i].normal))
      return false;
  }
  return true;
}

Plant started() {
  Plant plant(sheet().model(Integration::OneSolve));
  plant.set_state(sheet().state);
  return plant;
}

}  // namespace

TEST_CASE("what cannot be planned for is refused with a line that names it", "[mpc]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refusal = [](const PlannerSetup<double>& s, const PlannerSettings<double>& p, const Points<double>& start) {
    const auto made = try_planner(s, p, start);
    return made ? std::string() : made.error();
  };
  const Points<double>& start = sheet().state.positions;
  CHECK(refusal(setup(), settings(), start).empty());
  const auto names = [&](const std::string& text, const std::string& part) {
    CAPTURE(text, part);
    CHECK(text.find(part) != std::string::npos);
  };
  PlannerSetup<double> s = setup();
  s.features.add_point(49);
  names(refusal(s, settings(), start), "vertex 49");
  s = setup();
  s.features = {};
  names(refusal(s, settings(), start), "no features");
  s = setup();
  s.grips.clear();
  names(refusal(s, settings(), start), "no grips");
  s = setup();
  s.grips[1].fingers[0].friction = -0.1;
  names(refusal(s, settings(), start), "grip 1 finger 0");
  s.grips[1].fingers[0].friction = nan;
  names(refusal(s, settings(), start), "friction");
  s = setup();
  s.grips[0].fingers[1].limit = 0.0;
  names(refusal(s, settings(), start), "limit");
  s = setup();
  s.grips[0].fingers[0].vertices = {48, 48};
  names(refusal(s, settings(), start), "twice");
  s = setup();
  s.grips[1] = s.grips[0];
  names(refusal(s, settings(), start), "already");
  s = setup();
  s.grips[0].fingers[0].vertices = {-1};
  names(refusal(s, settings(), start), "vertex -1");
  s = setup();
  s.anchors.resize(1);
  names(refusal(s, settings(), start), "1 anchors for 2 grips");
  s.anchors.resize(2);
  names(refusal(s, settings(), start), "one weight a feature");
  PlannerSettings<double> p = settings();
  p.horizon = 0;
  names(refusal(setup(), p, start), "horizon is 0");
  p = settings();
  p.dt = nan;
  CHECK_FALSE(refusal(setup(), p, start).empty());
  p = settings();
  p.weights.smooth = -1.0;
  CHECK_FALSE(refusal(setup(), p, start).empty());
  Points<double> broken = start;
  broken(1, 5) = nan;
  names(refusal(setup(), settings(), broken), "not finite");
}

TEST_CASE("hostile input changes nothing, and the next good frame is as if it had not been", "[mpc]") {
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    Planning planner = planner_for(setup(), settings(input)), twin = planner_for(setup(), settings(input));
    PlanResult<double> result = planner.make_result(), other = twin.make_result();
    const AsyncTarget target(sheet());
    const auto wind = [](double t) { return V(t, 0.0, 0.1); };
    Plant plant = started();
    for (int k = 0; k < 6; ++k) {
      const double t = k * kDt;
      const Points<double> x = plant.positions(), v = plant.velocities();
      const PlanResult<double> before = result;
      for (const double bad : {nan, inf, -inf}) {
        Points<double> broken = x;
        broken(2, 11) = bad;
        CHECK(planner.plan(broken, v, t, target, wind, result) == PlanStatus::InvalidInput);
        CHECK(planner.plan(x, broken, t, target, wind, result) == PlanStatus::InvalidInput);
        CHECK(planner.plan(x, v, bad, target, wind, result) == PlanStatus::InvalidInput);
        const auto late = [&](Index i, double s) { return i == 1 && s > t + 0.15 ? V(0.0, bad, 0.0) : target(i, s); };
        CHECK(planner.plan(x, v, t, late, wind, result) == PlanStatus::InvalidInput);
        const auto gust = [&](double s) { return s > t + 0.09 ? V(bad, 0.0, 0.0) : wind(s); };
        CHECK(planner.plan(x, v, t, target, gust, result) == PlanStatus::InvalidInput);
      }
      CHECK(same(result, before));
      CHECK(planner.plan(x, v, t, target, wind, result) == PlanStatus::Planned);
      CHECK(twin.plan(x, v, t, target, wind, other) == PlanStatus::Planned);
      CHECK(same(result, other));
      plant.apply(result.input);
      REQUIRE(plant.advance(kDt).advanced);
    }
  }
}

TEST_CASE("positions or velocities of another sheet are refused", "[mpc]") {
  Planning planner = planner_for(setup(), settings());
  PlanResult<double> result = planner.make_result();
  const AsyncTarget target(sheet());
  const Points<double>& x = sheet().state.positions;
  const Points<double> few = x.leftCols(40), none(3, 0);
  CHECK(planner.plan(few, few, 0.0, target, result) == PlanStatus::InvalidInput);
  CHECK(planner.plan(x, few, 0.0, target, result) == PlanStatus::InvalidInput);
  CHECK(planner.plan(none, none, 0.0, target, result) == PlanStatus::InvalidInput);
  CHECK(planner.plan(x, sheet().state.velocities, 0.0, target, result) == PlanStatus::Planned);
}

TEST_CASE("planning allocates nothing", "[mpc]") {
  if (!clothctl_test::allocation_counting_works()) return;
  struct Case {
    GripInput input;
    Command command;
    double limit;
  };
  // The last stands in frames where grip limits bind, so the row solver runs.
  for (const Case& c : {Case{GripInput::Force, Command::Force, 20.0}, Case{GripInput::Force, Command::Position, 20.0},
                        Case{GripInput::Pose, Command::Force, 20.0}, Case{GripInput::Force, Command::Force, 0.28}}) {
    PlannerSettings<double> p = settings(c.input);
    p.command = c.command;
    Planning planner = planner_for(setup(c.limit), p);
    PlanResult<double> result = planner.make_result();
    const AsyncTarget target(sheet());
    Plant plant = started();
    long made = 0;
    int rows = 0;
    for (int k = 0; k < 30; ++k) {
      const long before = clothctl_test::allocations();
      const PlanStatus status = planner.plan(plant.positions(), plant.velocities(), k * kDt, target, result);
      // Results of the QP solvers take their size in their first solve.
      const bool first = k == 0 || (result.used_rows && rows == 0);
      if (!first) made += clothctl_test::allocations() - before;
      rows += result.used_rows ? 1 : 0;
      REQUIRE(status == PlanStatus::Planned);
      plant.apply(result.input);
      REQUIRE(plant.advance(kDt).advanced);
    }
    CAPTURE(rows);
    CHECK(made == 0);
    if (c.limit < 1.0) CHECK(rows > 5);
  }
}

TEST_CASE("equal planners give equal bits, and a reset planner is a new one", "[mpc]") {
  for (const double limit : {20.0, 0.28}) {
    Planning first = planner_for(setup(limit), settings()), second = planner_for(setup(limit), settings());
    PlanResult<double> a = first.make_result(), b = second.make_result();
    const AsyncTarget target(sheet());
    Plant plant = started();
    std::vector<MatrixX<double>> plans;
    for (int k = 0; k < 15; ++k) {
      REQUIRE(first.plan(plant.positions(), plant.velocities(), k * kDt, target, a) == PlanStatus::Planned);
      REQUIRE(second.plan(plant.positions(), plant.velocities(), k * kDt, target, b) == PlanStatus::Planned);
      CHECK(same(a, b));
      plans.push_back(a.plan);
      plant.apply(a.input);
      REQUIRE(plant.advance(kDt).advanced);
    }
    first.reset();
    plant = started();
    for (int k = 0; k < 15; ++k) {
      REQUIRE(first.plan(plant.positions(), plant.velocities(), k * kDt, target, a) == PlanStatus::Planned);
      CHECK(a.plan == plans[static_cast<std::size_t>(k)]);
      if (k == 0) CHECK(a.agreement == 1.0);
      plant.apply(a.input);
      REQUIRE(plant.advance(kDt).advanced);
    }
  }
}

TEST_CASE("a known outer force enters the plan", "[mpc]") {
  // Lifting half of the sheet's weight from outside halves what the hands must carry at rest.
  Planning planner = planner_for(setup(), settings()), lifted = planner_for(setup(), settings());
  PlanResult<double> a = planner.make_result(), b = lifted.make_result();
  Points<double> push = Points<double>::Zero(3, sheet().state.positions.cols());
  push.row(2) = 0.5 * 9.81 * sheet().network.mass.transpose();
  CHECK(lifted.set_outer_force(push));
  CHECK_FALSE(lifted.set_outer_force(Points<double>::Zero(3, 5)));  // another sheet's: refused, the first stays
  Points<double> broken = push;
  broken(0, 3) = std::numeric_limits<double>::quiet_NaN();
  CHECK_FALSE(lifted.set_outer_force(broken));
  const auto stay = [](Index i, double) {
    return V(sheet().state.positions.col(i == 0 ? sheet().lower_left() : sheet().lower_right()));
  };
  Plant plant = started();
  REQUIRE(planner.plan(plant.positions(), plant.velocities(), 0.0, stay, calm, a) == PlanStatus::Planned);
  REQUIRE(lifted.plan(plant.positions(), plant.velocities(), 0.0, stay, calm, b) == PlanStatus::Planned);
  CHECK(a.input.forces.row(2).sum() == Approx(sheet().supported()[2]).epsilon(0.1));
  CHECK(b.input.forces.row(2).sum() < 0.75 * a.input.forces.row(2).sum());
}

TEST_CASE("a single-precision planner plans what a double one does", "[mpc]") {
  using SingleResponse = MassSpringResponse<float>;
  const PlannerSettings<double> p = settings(GripInput::Pose);
  PlannerSetup<float> s;
  s.features.add_point(sheet().lower_left());
  s.features.add_point(sheet().lower_right());
  s.triangles = sheet().network.triangles;
  for (int side : {0, 1}) s.grips.push_back(make_pinch<float>(sheet().corner_patch(side, 1), 0.5f, 20.0f));
  PlannerSettings<float> q;
  q.horizon = p.horizon;
  q.input = GripInput::Pose;
  auto made = Planner<ExactPredictor<SingleResponse, float>>::create(
      s, q, ExactPredictor<SingleResponse, float>(SingleResponse(sheet().model(Integration::OneSolve))),
      sheet().state.positions.cast<float>());
  REQUIRE(made.has_value());
  auto single = std::move(made).value();
  Planning twice = planner_for(setup(), p);
  PlanResult<float> a = single.make_result();
  PlanResult<double> b = twice.make_result();
  const AsyncTarget target(sheet());
  const auto target_f = [&](Index i, float t) { return Vector3<float>(target(i, static_cast<double>(t)).cast<float>()); };
  const Points<double> x = sheet().state.positions, v = sheet().state.velocities;
  REQUIRE(single.plan(x.cast<float>(), v.cast<float>(), 0.2f, target_f, a) == PlanStatus::Planned);
  REQUIRE(twice.plan(x, v, 0.2, target, b) == PlanStatus::Planned);
  CHECK((a.plan.cast<double>() - b.plan).norm() < 5e-3 * b.plan.norm());
}
