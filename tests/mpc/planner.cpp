// The planner as a component: what it refuses, what it leaves unchanged, and that it repeats.
// Closed loops are in planner_forces.cpp, planner_patches.cpp and planner_tracking.cpp.

#include "clothctl/mpc/planner.hpp"

#include <limits>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"
#include "mpc/instances.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"

using namespace clothctl;
using clothctl_test::AsyncTarget;
using clothctl_test::HangingSheet;
using V = Vector3<double>;

namespace {

constexpr double kDt = clothctl_test::kFrame;
using Predicting = LinearisedPredictor<MassSpringResponse<float>, double>;
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
  for (int side : {0, 1})
    out.grips.push_back(make_pinch<double>(sheet().corner_patch(side, 1), 0.5, limit));
  return out;
}

PlannerSettings<double> settings(GripInput input = GripInput::Force) {
  PlannerSettings<double> out;
  out.horizon = 8;
  out.input = input;
  if (input == GripInput::Force) out.gravity_load = sheet().gravity_load();
  return out;
}

Result<Planning> try_planner(const PlannerSetup<double>& s, const PlannerSettings<double>& p,
                             const Points<double>& start = sheet().state.positions) {
  return Planning::create(
      s, p, Predicting(MassSpringResponse<float>(sheet().model(Integration::LinearlyImplicit))),
      start);
}
Planning planner_for(const PlannerSetup<double>& s, const PlannerSettings<double>& p) {
  return try_planner(s, p).value();
}

V calm(double) { return V::Zero(); }

bool same(const PlanResult<double>& a, const PlanResult<double>& b) {
  if (!(a.status == b.status && a.plan == b.plan && a.predicted == b.predicted &&
        a.input.forces == b.input.forces && a.input.driven_positions == b.input.driven_positions &&
        a.prediction_error == b.prediction_error && a.agreement == b.agreement &&
        a.patch_residual == b.patch_residual && a.qp_iterations == b.qp_iterations &&
        a.qp_status == b.qp_status && a.used_rows == b.used_rows &&
        a.finger_forces.size() == b.finger_forces.size())) {
    return false;
  }
  for (std::size_t i = 0; i < a.finger_forces.size(); ++i) {
    if (!(a.finger_forces[i].force == b.finger_forces[i].force &&
          a.finger_forces[i].normal == b.finger_forces[i].normal))
      return false;
  }
  return true;
}

Plant started() {
  Plant plant(sheet().model(Integration::LinearlyImplicit));
  plant.set_state(sheet().state);
  return plant;
}

}  // namespace

TEST_CASE("setups that cannot be planned for are refused with a message", "[mpc]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refusal = [](const PlannerSetup<double>& s, const PlannerSettings<double>& p,
                          const Points<double>& start) {
    const auto made = try_planner(s, p, start);
    return made ? std::string() : made.error();
  };
  const Points<double>& start = sheet().state.positions;
  CHECK(refusal(setup(), settings(), start).empty());
  const auto names = [&](const std::string& text, const std::string& part) {
    CAPTURE(text, part);
    CHECK(text.find(part) != std::string::npos);
  };
  // The setup is validated for the sheet at `start` (plan_types.cpp).
  PlannerSetup<double> s = setup();
  s.features.add_point(49);
  names(refusal(s, settings(), start), "vertex 49");
  s = setup();
  s.grips[1].fingers[0].contact.friction = nan;
  names(refusal(s, settings(), start), "grip 1 finger 0");
  s = setup();
  s.anchors.resize(1);
  names(refusal(s, settings(), start), "1 anchors for 2 grips");
  names(refusal(setup(), settings(), start.leftCols(48)), "48");
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

TEST_CASE("invalid input changes nothing, not even the next valid frame", "[mpc]") {
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               inf = std::numeric_limits<double>::infinity();
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    Planning planner = planner_for(setup(), settings(input)),
             twin = planner_for(setup(), settings(input));
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
        const auto late = [&](Index i, double s) {
          return i == 1 && s > t + 0.15 ? V(0.0, bad, 0.0) : target(i, s);
        };
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
  PlanResult<double> not_made;
  CHECK(planner.plan(x, sheet().state.velocities, 0.0, target, not_made) ==
        PlanStatus::InvalidInput);
  PlanResult<double> of_poses = planner_for(setup(), settings(GripInput::Pose)).make_result();
  CHECK(planner.plan(x, sheet().state.velocities, 0.0, target, of_poses) ==
        PlanStatus::InvalidInput);
  CHECK(planner.plan(x, sheet().state.velocities, 0.0, target, result) == PlanStatus::Planned);
}

TEST_CASE("check_input reports which input is wrong, where, and its value", "[mpc]") {
  PlannerSettings<double> swinging = settings();
  swinging.heavy_chain_axes = HeavyChainAxes::Horizontal;
  Planning planner = planner_for(setup(), swinging);
  PlanResult<double> result = planner.make_result();
  const AsyncTarget target(sheet());
  const Points<double>&x = sheet().state.positions, &v = sheet().state.velocities;
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               inf = std::numeric_limits<double>::infinity();
  CHECK(planner.check_input(x, v, 0.0, target, calm, result) == "");
  CHECK(planner.check_input(x, v, 0.0, target, result) == "");
  CHECK(planner.check_input(x.leftCols(40), v, 0.0, target, result) ==
        "there are 40 columns of position for 49 vertices");
  CHECK(planner.check_input(x, v.leftCols(0), 0.0, target, result) ==
        "there are 0 columns of velocity for 49 vertices");
  CHECK(planner.check_input(x, v, inf, target, result) == "the time is inf");
  Points<double> broken = Points<double>::Zero(3, 49);
  broken(1, 7) = nan;
  CHECK(planner.check_input(broken, v, 0.0, target, result) ==
        "the position of vertex 7 is (0, nan, 0)");
  CHECK(planner.check_input(x, broken, 0.0, target, result) ==
        "the velocity of vertex 7 is (0, nan, 0)");
  const auto gust = [&](double t) { return t > 0.05 ? V(1.0, 2.0, inf) : V(V::Zero()); };
  CHECK(planner.check_input(x, v, 0.0, target, gust, result) ==
        "the wind at 0.06 s is (1, 2, inf)");
  const auto lost = [&](Index i, double t) {
    return i == 1 && t > 0.05 ? V(-inf, 0.0, 0.0) : target(i, t);
  };
  CHECK(planner.check_input(x, v, 0.0, lost, result) ==
        "the target of feature 1 at 0.06 s is (-inf, 0, 0), must be finite and within 1e+06 m");
  // Finite, but beyond any sheet. Once this was planned as a zero force and called applicable.
  const auto away = [&](Index i, double t) {
    return i == 1 && t > 0.05 ? V(0.0, 1e30, 0.0) : target(i, t);
  };
  CHECK(planner.plan(x, v, 0.0, away, result) == PlanStatus::InvalidInput);
  CHECK(planner.check_input(x, v, 0.0, away, result) ==
        "the target of feature 1 at 0.06 s is (0, 1e+30, 0), must be finite and within 1e+06 m");
  // After the window, where an anchor looks ahead.
  const auto later = [&](Index i, double t) { return t > 0.2 ? V(nan, nan, nan) : target(i, t); };
  CHECK(planner.plan(x, v, 0.0, later, result) == PlanStatus::InvalidInput);
  CHECK(planner.check_input(x, v, 0.0, later, result).find("where grip 0 belongs at 0.02 s") == 0);
  CHECK(planner.check_input(x, v, 0.0, target, PlanResult<double>()) ==
        "the result was not made by make_result of this planner");
}

TEST_CASE("any weight but that of the features may be zero", "[mpc]") {
  using Weights = PlannerWeights<double>;
  const std::vector<double Weights::*> members{
      &Weights::force,  &Weights::cone,  &Weights::velocity, &Weights::smooth, &Weights::shape,
      &Weights::anchor, &Weights::patch, &Weights::jerk,     &Weights::step};
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    for (std::size_t zero = 0; zero <= members.size(); ++zero) {  // the last time, all of them
      CAPTURE(static_cast<int>(input), zero);
      PlannerSettings<double> weighed = settings(input);
      for (std::size_t i = 0; i < members.size(); ++i) {
        if (i == zero || zero == members.size()) weighed.weights.*members[i] = 0;
      }
      Planning planner = planner_for(setup(), weighed);
      PlanResult<double> result = planner.make_result();
      Plant plant = started();
      const AsyncTarget target(sheet());
      for (int k = 0; k < 5; ++k) {
        const PlanStatus status =
            planner.plan(plant.positions(), plant.velocities(), k * kDt, target, result);
        INFO(to_string(status) << ", qp " << to_string(result.qp_status));
        REQUIRE((status == PlanStatus::Planned || status == PlanStatus::Suboptimal));
        REQUIRE(all_finite(result.plan));
        for (const FingerForce<double>& f : result.finger_forces)
          CHECK(cone_violation<double>(f.force, f.normal, 0.5, 20.0) < 1e-9);
        plant.apply(result.input);
        REQUIRE(plant.advance(kDt).advanced);
      }
    }
  }
}

TEST_CASE("planning does not allocate", "[mpc]") {
  if (!clothctl_test::allocation_counting_works()) return;
  struct Case {
    GripInput input;
    PlantCommand command;
    double limit;
  };
  // The last case runs in frames with active grip limits, so that the row solver runs.
  for (const Case& c : {Case{GripInput::Force, PlantCommand::Force, 20.0},
                        Case{GripInput::Force, PlantCommand::Position, 20.0},
                        Case{GripInput::Pose, PlantCommand::Force, 20.0},
                        Case{GripInput::Force, PlantCommand::Force, 0.28}}) {
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
      const PlanStatus status =
          planner.plan(plant.positions(), plant.velocities(), k * kDt, target, result);
      made += clothctl_test::allocations() - before;
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

TEST_CASE("planning with hard patches does not allocate, even if their rows cannot be satisfied",
          "[mpc]") {
  if (!clothctl_test::allocation_counting_works()) return;
  for (const double limit : {20.0, 0.3}) {
    PlannerSetup<double> s = setup();
    for (int side : {0, 1})
      s.grips[static_cast<std::size_t>(side)] =
          make_pinch<double>(sheet().corner_patch(side, 3), 0.5, limit);
    PlannerSettings<double> p = settings();
    p.horizon = 3;
    p.patch = PatchMode::Hard;
    Planning planner = planner_for(s, p);
    PlanResult<double> result = planner.make_result();
    const AsyncTarget target(sheet());
    Plant plant = started();
    long made = 0;
    int rows = 0;
    for (int k = 0; k < 8; ++k) {
      const long before = clothctl_test::allocations();
      const PlanStatus status =
          planner.plan(plant.positions(), plant.velocities(), k * kDt, target, result);
      made += clothctl_test::allocations() - before;
      rows += result.used_rows ? 1 : 0;
      REQUIRE(status != PlanStatus::Failed);
      plant.apply(result.input);
      REQUIRE(plant.advance(kDt).advanced);
    }
    CHECK(rows == 8);
    CHECK(made == 0);
  }
}

TEST_CASE("a frame that fails sends the rest of the last plan", "[mpc]") {
  bool fails = false;
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    for (const PlantCommand command : {PlantCommand::Force, PlantCommand::Position}) {
      if (input == GripInput::Pose && command == PlantCommand::Position) continue;
      PlannerSettings<double> p = settings(input);
      p.command = command;
      auto planner =
          Planner<clothctl_test::FailingPredictor>::create(
              setup(), p,
              clothctl_test::FailingPredictor{Predicting(MassSpringResponse<float>(
                                                  sheet().model(Integration::LinearlyImplicit))),
                                              &fails},
              sheet().state.positions)
              .value();
      PlanResult<double> result = planner.make_result();
      const AsyncTarget target(sheet());
      Plant plant = started();
      const auto plan = [&](int k) {
        return planner.plan(plant.positions(), plant.velocities(), k * kDt, target, result);
      };
      // Before the first plan: no force and no motion.
      fails = true;
      CHECK(plan(0) == PlanStatus::Failed);
      CHECK(result.plan.isZero());
      CHECK(result.input.forces.isZero());
      for (Index j = 0; j < result.input.driven_positions.cols(); ++j)
        CHECK(result.input.driven_positions.col(j) ==
              plant.positions().col(planner.held()[static_cast<std::size_t>(j)]));
      fails = false;
      for (int k = 0; k < 4; ++k) {
        REQUIRE(plan(k) == PlanStatus::Planned);
        plant.apply(result.input);
        REQUIRE(plant.advance(kDt).advanced);
      }
      const PlanResult<double> last = result;
      fails = true;
      for (int k = 4; k < 6; ++k) {
        CHECK(plan(k) == PlanStatus::Failed);
        CHECK(result.plan.col(0) == last.plan.col(k - 3));
        if (command == PlantCommand::Force && input == GripInput::Force) {
          const Eigen::Map<const Points<double>> promised(last.plan.col(k - 3).data(), 3, 2);
          CHECK((result.input.forces - promised).norm() < 1e-12);
        } else {
          // The hands continue as planned.
          for (Index j = 0; j < 2; ++j) {
            const V step = result.input.driven_positions.col(j) -
                           plant.positions().col(planner.held()[static_cast<std::size_t>(j)]);
            CHECK(step.norm() > 1e-7);
            CHECK(step.norm() < 0.01);
          }
        }
        CHECK(result.predicted.allFinite());
        CHECK(result.used_rows == false);
        plant.apply(result.input);
        REQUIRE(plant.advance(kDt).advanced);
      }
      fails = false;
      CHECK(plan(6) == PlanStatus::Planned);
      CHECK(result.agreement == 1.0);
    }
  }
}

TEST_CASE("positions sent for planned forces keep to the largest step", "[mpc]") {
  for (const double most : {0.05, 2e-4}) {
    PlannerSettings<double> p = settings();
    p.command = PlantCommand::Position;
    p.max_step = most;
    Planning planner = planner_for(setup(), p);
    PlanResult<double> result = planner.make_result();
    const AsyncTarget target(sheet(), 2.0);
    Plant plant = started();
    double largest = 0.0;
    for (int k = 0; k < 30; ++k) {
      REQUIRE(planner.plan(plant.positions(), plant.velocities(), k * kDt, target, result) ==
              PlanStatus::Planned);
      for (Index j = 0; j < 2; ++j) {
        const V step = result.input.driven_positions.col(j) -
                       plant.positions().col(planner.held()[static_cast<std::size_t>(j)]);
        largest = std::max(largest, step.cwiseAbs().maxCoeff());
      }
      plant.apply(result.input);
      REQUIRE(plant.advance(kDt).advanced);
    }
    CHECK(largest <= most * (1 + 1e-12));
    CHECK(largest > 0.9 * std::min(most, 1e-3));
  }
}

TEST_CASE("a change of forces that would move the hands abruptly is damped", "[mpc]") {
  // After the first frame the target jumps by 5 cm. Without a limit, the plan follows at once.
  double shift = 0.0;
  const auto jump = [&](Index i, double) {
    const V place =
        sheet().state.positions.col(i == 0 ? sheet().lower_left() : sheet().lower_right());
    return V(place + V(shift, 0.0, 0.0));
  };
  double speed[2];
  for (const bool limited : {false, true}) {
    PlannerSettings<double> p = settings();
    p.max_change = limited ? 0.02 : 0.0;
    p.weights.step = limited ? 0.01 : 0.0;
    Planning planner = planner_for(setup(), p);
    PlanResult<double> result = planner.make_result();
    Plant plant = started();
    for (int k = 0; k < 2; ++k) {
      shift = k == 0 ? 0.0 : 0.05;
      REQUIRE(planner.plan(plant.positions(), plant.velocities(), k * kDt, jump, result) ==
              PlanStatus::Planned);
      plant.apply(result.input);
      REQUIRE(plant.advance(kDt).advanced);
    }
    speed[limited ? 1 : 0] = plant.velocities().col(sheet().upper_left()).norm();
  }
  CAPTURE(speed[0], speed[1]);
  CHECK(speed[1] < 0.5 * speed[0]);
}

namespace other_engine {

// A solver by projected coordinate descent without warm starts. Its answers can be corrupted on
// request.
struct Descent {
  using result_type = QpResult<double>;
  MatrixX<double> h;
  static inline bool spoilt = false;
  static inline double shift = 0;  // added to the answer
  void reserve(Index) {}
  QpStatus set_hessian(const MatrixX<double>& hessian) {
    h = hessian;
    return QpStatus::Solved;
  }
  QpStatus solve(const Eigen::Ref<const VectorX<double>>& g,
                 const Eigen::Ref<const VectorX<double>>& lb,
                 const Eigen::Ref<const VectorX<double>>& ub, result_type& result) {
    result.x = VectorX<double>::Zero(g.size()).cwiseMax(lb).cwiseMin(ub);
    result.bound_multipliers.setZero(g.size());
    for (int sweep = 0; sweep < 4000; ++sweep) {
      for (Index i = 0; i < g.size(); ++i) {
        const double free = result.x[i] - (g[i] + h.col(i).dot(result.x)) / h(i, i);
        result.x[i] = std::min(ub[i], std::max(lb[i], free));
      }
    }
    result.x.array() += shift;
    if (spoilt) result.x[3] = std::numeric_limits<double>::quiet_NaN();
    return QpStatus::IterationLimit;
  }
};
static_assert(BoxQpSolver<Descent>);

}  // namespace other_engine

using ForeignPlanner = Planner<Predicting, PlannerSetup<double>, other_engine::Descent>;

static ForeignPlanner foreign_planner(const PlannerSettings<double>& p) {
  Predicting predictor(MassSpringResponse<float>(sheet().model(Integration::LinearlyImplicit)));
  return ForeignPlanner::create(setup(), p, std::move(predictor), sheet().state.positions).value();
}

TEST_CASE("a foreign box solver works in the planner, and its corrupted answers are not sent",
          "[mpc]") {
  PlannerSettings<double> p = settings(GripInput::Pose);
  p.horizon = 3;
  ForeignPlanner foreign = foreign_planner(p);
  Planning ours = planner_for(setup(), p);
  PlanResult<double> a = foreign.make_result(), b = ours.make_result();
  const AsyncTarget target(sheet());
  const Points<double> x = sheet().state.positions, v = sheet().state.velocities;
  CHECK(foreign.plan(x, v, 0.2, target, a) == PlanStatus::Suboptimal);
  CHECK(ours.plan(x, v, 0.2, target, b) == PlanStatus::Planned);
  CHECK((a.plan - b.plan).norm() < 1e-3 * b.plan.norm());
  other_engine::Descent::spoilt = true;
  CHECK(foreign.plan(x, v, 0.2, target, a) == PlanStatus::Failed);
  other_engine::Descent::spoilt = false;
  CHECK(a.plan.allFinite());
  CHECK(a.input.driven_positions.allFinite());
}

TEST_CASE("a finger never pulls, whatever a foreign box solver answers", "[mpc]") {
  PlannerSettings<double> p = settings(GripInput::Force);
  p.horizon = 3;
  ForeignPlanner foreign = foreign_planner(p);
  PlanResult<double> a = foreign.make_result();
  const AsyncTarget target(sheet());
  other_engine::Descent::shift = -1.0;
  const PlanStatus status =
      foreign.plan(sheet().state.positions, sheet().state.velocities, 0.2, target, a);
  other_engine::Descent::shift = 0.0;
  REQUIRE(can_apply(status));
  for (const FingerForce<double>& f : a.finger_forces) {
    CHECK(f.force.dot(f.normal) >= 0.0);
    const double slide = (f.force - f.force.dot(f.normal) * f.normal).norm();
    CHECK(slide <= 0.5 * f.force.dot(f.normal) + 1e-12);
  }
}

TEST_CASE("equal planners give equal bits, and reset makes a planner like new", "[mpc]") {
  for (const double limit : {20.0, 0.28}) {
    Planning first = planner_for(setup(limit), settings()),
             second = planner_for(setup(limit), settings());
    PlanResult<double> a = first.make_result(), b = second.make_result();
    const AsyncTarget target(sheet());
    Plant plant = started();
    std::vector<MatrixX<double>> plans;
    for (int k = 0; k < 15; ++k) {
      REQUIRE(first.plan(plant.positions(), plant.velocities(), k * kDt, target, a) ==
              PlanStatus::Planned);
      REQUIRE(second.plan(plant.positions(), plant.velocities(), k * kDt, target, b) ==
              PlanStatus::Planned);
      CHECK(same(a, b));
      plans.push_back(a.plan);
      plant.apply(a.input);
      REQUIRE(plant.advance(kDt).advanced);
    }
    first.reset();
    plant = started();
    for (int k = 0; k < 15; ++k) {
      REQUIRE(first.plan(plant.positions(), plant.velocities(), k * kDt, target, a) ==
              PlanStatus::Planned);
      CHECK(a.plan == plans[static_cast<std::size_t>(k)]);
      if (k == 0) CHECK(a.agreement == 1.0);
      plant.apply(a.input);
      REQUIRE(plant.advance(kDt).advanced);
    }
  }
}

TEST_CASE("a known external force enters the plan", "[mpc]") {
  // An external force of half the weight halves the force of the hands at rest.
  Planning planner = planner_for(setup(), settings()), lifted = planner_for(setup(), settings());
  PlanResult<double> a = planner.make_result(), b = lifted.make_result();
  Points<double> push = Points<double>::Zero(3, sheet().state.positions.cols());
  push.row(2) = 0.5 * 9.81 * sheet().network.mass.transpose();
  CHECK(lifted.set_outer_force(push));
  CHECK_FALSE(lifted.set_outer_force(
      Points<double>::Zero(3, 5)));  // for another sheet: refused, the first stays
  Points<double> broken = push;
  broken(0, 3) = std::numeric_limits<double>::quiet_NaN();
  CHECK_FALSE(lifted.set_outer_force(broken));
  const auto stay = [](Index i, double) {
    return V(sheet().state.positions.col(i == 0 ? sheet().lower_left() : sheet().lower_right()));
  };
  Plant plant = started();
  REQUIRE(planner.plan(plant.positions(), plant.velocities(), 0.0, stay, calm, a) ==
          PlanStatus::Planned);
  REQUIRE(lifted.plan(plant.positions(), plant.velocities(), 0.0, stay, calm, b) ==
          PlanStatus::Planned);
  CHECK(a.input.forces.row(2).sum() == Approx(sheet().gravity_load()[2]).epsilon(0.1));
  CHECK(b.input.forces.row(2).sum() < 0.75 * a.input.forces.row(2).sum());
}

TEST_CASE("a single-precision planner plans the same as a double-precision one", "[mpc]") {
  using SingleResponse = MassSpringResponse<float>;
  const GripInput input = GENERATE(GripInput::Force, GripInput::Pose);
  const PlannerSettings<double> p = settings(input);
  PlannerSetup<float> s;
  s.features.add_point(sheet().lower_left());
  s.features.add_point(sheet().lower_right());
  s.triangles = sheet().network.triangles;
  for (int side : {0, 1})
    s.grips.push_back(make_pinch<float>(sheet().corner_patch(side, 1), 0.5f, 20.0f));
  PlannerSettings<float> q;
  q.horizon = p.horizon;
  q.input = input;
  q.gravity_load = p.gravity_load.cast<float>();
  auto made = Planner<LinearisedPredictor<SingleResponse, float>>::create(
      s, q,
      LinearisedPredictor<SingleResponse, float>(
          SingleResponse(sheet().model(Integration::LinearlyImplicit))),
      sheet().state.positions.cast<float>());
  REQUIRE(made.has_value());
  auto single = std::move(made).value();
  Planning twice = planner_for(setup(), p);
  PlanResult<float> a = single.make_result();
  PlanResult<double> b = twice.make_result();
  const AsyncTarget target(sheet());
  const auto target_f = [&](Index i, float t) {
    return Vector3<float>(target(i, static_cast<double>(t)).cast<float>());
  };
  const Points<double> x = sheet().state.positions, v = sheet().state.velocities;
  REQUIRE(single.plan(x.cast<float>(), v.cast<float>(), 0.2f, target_f, a) == PlanStatus::Planned);
  REQUIRE(twice.plan(x, v, 0.2, target, b) == PlanStatus::Planned);
  CAPTURE(input == GripInput::Force);
  CHECK((a.plan.cast<double>() - b.plan).norm() < 5e-3 * b.plan.norm());
  CHECK((a.predicted.cast<double>() - b.predicted).cwiseAbs().maxCoeff() < 1e-4);
}
