// The free response of rollouts, compared with the model's own steps, and its effect in closed
// loops.

#include "clothctl/prediction/rollout_predictor.hpp"

#include <algorithm>
#include <array>
#include <vector>

#include "clothctl/cloth/mass_spring_rollout.hpp"
#include "clothctl/mpc/run_frame.hpp"
#include "laws/predictor_laws.hpp"
#include "mpc/planner_loops.hpp"
#include "prediction/window_requests.hpp"
#include "support/catch.hpp"
#include "support/thread_executor.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::AsyncTarget;
using clothctl_test::HangingSheet;
using clothctl_test::LoopStats;
using clothctl_test::stepped;
using clothctl_test::swaying_hands;

namespace {

constexpr double kDt = clothctl_test::kFrame;
using Exact = LinearisedPredictor<MassSpringResponse<double>, double>;
using Rolling = RolloutPredictor<MassSpring<double>, Exact>;

Rolling rolling(const MassSpring<double>& model, int newton_steps) {
  return Rolling(model, Exact(MassSpringResponse<double>(model)),
                 RolloutSettings{newton_steps, 0.0});
}

// Rollouts along which the response of the features is derived.
using Derived = RolloutPredictor<MassSpringRollout<double>, Exact>;
using Precise = RolloutPredictor<MassSpringRollout<double, double>, Exact>;

Derived derived(const MassSpring<double>& model, const RolloutSettings& settings) {
  return Derived(MassSpringRollout<double>(model), Exact(MassSpringResponse<double>(model)),
                 settings);
}

// A model whose derivations fail while `broken` is set.
struct BreakingModel : MassSpringRollout<double> {
  using MassSpringRollout<double>::MassSpringRollout;
  inline static bool broken = false;

  struct Derivative : MassSpringDerivative<float> {
    using Base = MassSpringDerivative<float>;
    template <int kColumns>
    bool linearise(const ClothState<float>& from, const ClothState<float>& to, float dt,
                   Base::Step& step, Base::Memory<kColumns>& memory, float compression,
                   const Vector3<float>& wind) const {
      return !broken && Base::linearise(from, to, dt, step, memory, compression, wind);
    }
  };

  Derivative make_derivative(std::vector<int> driven) const {
    return {MassSpringRollout<double>::make_derivative(std::move(driven))};
  }
};
using Breaking = RolloutPredictor<BreakingModel, Exact>;

// Predicts five frames of both kinds on one thread, on two, and with the blocks in reverse.
// Returns how many loops the threads ran. `derives`: whether each prediction has a Jacobian.
template <class Make>
int threaded_loops(const HangingSheet& sheet, bool derives, const Make& make) {
  clothctl_test::ThreadExecutor threads;
  clothctl_test::BackwardExecutor backward;
  for (const GripInput kind : {GripInput::Force, GripInput::Pose}) {
    WindowRequest<double> request = swaying_hands(sheet, kind, 6);
    request.path = MatrixX<double>::Constant(request.inputs(), request.horizon, 0.02);
    std::array<WindowResponse<double>, 3> responses;
    for (std::size_t i = 0; i < 3; ++i) {
      auto predictor = make();
      if (i == 1) predictor.set_executor(ExecutorRef(threads));
      if (i == 2) predictor.set_executor(ExecutorRef(backward));
      predictor.reserve(request, responses[i]);
      for (int frame = 0; frame < 5; ++frame) {
        request.has_path = frame > 0;
        responses[i].plan = request.plan;
        REQUIRE(predictor.predict(sheet.state.positions, sheet.state.velocities, request,
                                  responses[i]));
        CHECK(responses[i].has_jacobian == derives);
      }
      CHECK(responses[i].jacobian == responses[0].jacobian);
      CHECK(responses[i].free_response == responses[0].free_response);
      CHECK(responses[i].impulse_response == responses[0].impulse_response);
      CHECK(responses[i].plan == responses[0].plan);
      CHECK(responses[i].air == responses[0].air);
    }
  }
  return threads.loops;
}

}  // namespace

TEST_CASE("one frame ahead, a rollout of linear steps equals the linearised prediction", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 60);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit, true);
  for (const GripInput kind : {GripInput::Force, GripInput::Pose}) {
    const ClothState<double> state = clothctl_test::shaken(sheet.state, 3);
    const WindowRequest<double> request = swaying_hands(sheet, kind, 8);
    WindowResponse<double> rolled, exact;
    Rolling predictor = rolling(model, 0);
    Exact frozen{MassSpringResponse<double>(model)};
    predictor.reserve(request, rolled);
    frozen.reserve(request, exact);
    for (int repeat = 0; repeat < 2; ++repeat) {
      REQUIRE(predictor.predict(state.positions, state.velocities, request, rolled));
      REQUIRE(frozen.predict(state.positions, state.velocities, request, exact));
      CHECK(rolled.impulse_response == exact.impulse_response);
      CHECK((rolled.free_response.col(0) - exact.free_response.col(0)).norm() < 1e-12);
      CHECK((rolled.free_response.col(7) - exact.free_response.col(7)).norm() >
            1e-6);  // in later frames the sheet is nonlinear
    }
  }
}

TEST_CASE("a rollout with many Newton steps equals the converged plant's motion", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 60);
  const MassSpring<double> newton = sheet.model(Integration::Newton, true),
                           one = sheet.model(Integration::LinearlyImplicit, true);
  WindowRequest<double> request = swaying_hands(sheet, GripInput::Pose, 8);
  const MatrixX<double> expected = stepped(newton, sheet.state, request);
  WindowResponse<double> response;
  // With a model set to one linear solve, the first prediction uses that solve and later ones start
  // Newton steps from it.
  Rolling predictor = rolling(one, 60);
  predictor.reserve(request, response);
  REQUIRE(predictor.predict(sheet.state.positions, sheet.state.velocities, request, response));
  CHECK((response.free_response - stepped(one, sheet.state, request)).norm() < 1e-12);
  REQUIRE(predictor.predict(sheet.state.positions, sheet.state.velocities, request, response));
  CHECK((response.free_response - expected).cwiseAbs().maxCoeff() < 2e-6);
  // After reset, the linear prediction returns.
  predictor.reset();
  REQUIRE(predictor.predict(sheet.state.positions, sheet.state.velocities, request, response));
  CHECK((response.free_response - stepped(one, sheet.state, request)).norm() < 1e-12);
}

TEST_CASE("known external forces enter a rollout", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit);
  WindowRequest<double> request = swaying_hands(sheet, GripInput::Pose, 6);
  request.wind.setZero();
  WindowResponse<double> rolled, exact, without;
  Rolling predictor = rolling(model, 0);
  Exact frozen{MassSpringResponse<double>(model)};
  predictor.reserve(request, rolled);
  frozen.reserve(request, exact);
  REQUIRE(predictor.predict(sheet.state.positions, sheet.state.velocities, request, rolled));
  without = rolled;
  request.outer_force = Points<double>::Zero(3, model.vertex_count());
  request.outer_force.row(1).setConstant(0.002);
  REQUIRE(predictor.predict(sheet.state.positions, sheet.state.velocities, request, rolled));
  REQUIRE(frozen.predict(sheet.state.positions, sheet.state.velocities, request, exact));
  CHECK((rolled.free_response.col(0) - exact.free_response.col(0)).norm() < 1e-12);
  CHECK((rolled.free_response - without.free_response).norm() > 1e-4);
}

TEST_CASE("a rollout prediction has the same bits with every executor", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit, true);
  // Not in the first frame of forces, whose path the inner prediction gives.
  CHECK(threaded_loops(sheet, false, [&] { return rolling(model, 2); }) == 9);
}

TEST_CASE("a derived rollout has the same bits with every executor", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::Newton, true);
  // The first derivation of each kind is a loop of its own.
  CHECK(threaded_loops(sheet, true, [&] { return derived(model, {}); }) == 11);
}

TEST_CASE("features respond as the derived rollout says", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 60);
  const MassSpring<double> model = sheet.model(Integration::Newton);
  for (const GripInput kind : {GripInput::Force, GripInput::Pose}) {
    WindowRequest<double> request = swaying_hands(sheet, kind, 6);
    request.path = 0.1 * MatrixX<double>::Random(request.inputs(), request.horizon);
    request.has_path = true;
    RolloutSettings settings{30, 0.0, 30};
    settings.derivative_interval = settings.derivative_stride = 1;
    settings.first_step_tolerance = 0;
    Precise predictor(MassSpringRollout<double, double>(model, {{}, true}),
                      Exact(MassSpringResponse<double>(model)), settings);
    WindowResponse<double> response;
    predictor.reserve(request, response);
    const auto predict = [&](const WindowRequest<double>& asked) {
      // The second converges, and the third derives it.
      for (int repeat = 0; repeat < 3; ++repeat) {
        response.plan = asked.plan;
        REQUIRE(predictor.predict(sheet.state.positions, sheet.state.velocities, asked, response));
      }
      return response;
    };
    const WindowResponse<double> found = predict(request);
    REQUIRE(found.has_jacobian);
    const Index m = request.inputs(), rows = 3 * request.held_outputs;
    // The Jacobian is that of the last frame, moved on: it does not know the window's first frame.
    MatrixX<double> change = MatrixX<double>::Random(m, request.horizon), shifted = change;
    change.col(0).setZero();
    shifted.leftCols(request.horizon - 1) = change.rightCols(request.horizon - 1);
    // How the hands move: by planned velocities, or as the impulse response says by forces.
    MatrixX<double> motion = change;
    if (kind == GripInput::Force) {
      MatrixX<double> moved = MatrixX<double>::Zero(m, request.horizon);
      for (Index k = 0; k < request.horizon; ++k) {
        for (Index j = 0; j <= k; ++j)
          moved.col(k) += found.impulse_response.block(rows, (k - j) * m, m, m) * change.col(j);
      }
      motion = moved / request.dt;
      for (Index k = 1; k < request.horizon; ++k) motion.col(k) -= moved.col(k - 1) / request.dt;
    }
    const double e = 1e-6 / motion.cwiseAbs().maxCoeff();
    WindowRequest<double> ahead = request, behind = request;
    (kind == GripInput::Force ? ahead.path : ahead.plan) += e * motion;
    (kind == GripInput::Force ? behind.path : behind.plan) -= e * motion;
    const MatrixX<double> forth = predict(ahead).free_response.topRows(rows);
    const MatrixX<double> back = predict(behind).free_response.topRows(rows);
    const Index known = request.horizon - 1;
    const VectorX<double> expected = ((forth - back) / (2 * e)).rightCols(known).reshaped();
    const VectorX<double> reached = (found.jacobian * shifted.reshaped()).head(rows * known);
    CAPTURE(kind == GripInput::Force, expected.norm());
    CHECK((reached - expected).norm() < 1e-4 * expected.norm());
  }
}

TEST_CASE("a derivation serves for as many frames as are set", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::Newton);
  const WindowRequest<double> request = swaying_hands(sheet, GripInput::Pose, 5);
  const auto jacobians = [&](int interval, bool reset) {
    RolloutSettings settings;
    settings.derivative_interval = interval;
    Derived predictor = derived(model, settings);
    WindowResponse<double> response;
    predictor.reserve(request, response);
    std::vector<MatrixX<double>> out;
    for (int frame = 0; frame < 5; ++frame) {
      if (reset && frame == 1) predictor.reset();
      response.plan = request.plan;
      REQUIRE(predictor.predict(sheet.state.positions, sheet.state.velocities, request, response));
      CHECK(response.has_jacobian == (interval > 0));
      out.push_back(response.jacobian);
    }
    return out;
  };
  const auto each = jacobians(1, false), third = jacobians(3, false), again = jacobians(3, true);
  MatrixX<double> moved = each[0];
  CHECK(third[0] == each[0]);
  for (std::size_t frame = 1; frame < 4; ++frame) {
    shift_jacobian(request.horizon, moved);
    CHECK(third[frame] == moved);
  }
  CHECK(each[1] == third[1]);  // there is no older rollout than that of the first frame
  CHECK(each[2] != third[2]);
  CHECK(third[4] == each[4]);  // of the rollout of frame 3, in which both have the same guesses
  CHECK(again[1] == each[0]);
  jacobians(0, false);
}

TEST_CASE("the response of hands to forces is predicted where no rollout is derived", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::Newton);
  WindowRequest<double> request = swaying_hands(sheet, GripInput::Force, 5);
  request.path = MatrixX<double>::Zero(request.inputs(), request.horizon);
  for (const int interval : {1, 2, 3}) {
    RolloutSettings settings;
    settings.derivative_interval = interval;
    Derived predictor = derived(model, settings);
    WindowResponse<double> response;
    predictor.reserve(request, response);
    std::vector<bool> fresh;
    MatrixX<double> last;
    for (unsigned frame = 0; frame < 8; ++frame) {
      const ClothState<double> state = clothctl_test::shaken(sheet.state, 1 + frame);
      request.has_path = frame > 0;
      response.plan = request.plan;
      REQUIRE(predictor.predict(state.positions, state.velocities, request, response));
      REQUIRE(response.has_jacobian);
      fresh.push_back(frame == 0 || response.impulse_response != last);
      last = response.impulse_response;
    }
    // The rollout of frame 0 is derived in it, later ones beside the next rollout: those of frames
    // 1, 2, 3 and so on, 2, 4, 6 or 3, 6. The response is never older than a frame.
    const std::vector<bool> expected =
        interval == 1   ? std::vector<bool>{true, true, false, true, false, true, false, true}
        : interval == 2 ? std::vector<bool>{true, true, true, false, true, false, true, false}
                        : std::vector<bool>{true, true, true, true, false, true, true, false};
    CAPTURE(interval);
    CHECK(fresh == expected);
  }
}

TEST_CASE("a response to other inputs is predicted anew", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::Newton);
  const ClothState<double>& state = sheet.state;
  for (const GripInput first : {GripInput::Force, GripInput::Pose}) {
    const bool force = first == GripInput::Force;
    WindowRequest<double> request = swaying_hands(sheet, first, 5);
    request.path = MatrixX<double>::Zero(request.inputs(), request.horizon);
    request.has_path = true;
    Derived predictor = derived(model, {});
    WindowResponse<double> response, expected;
    predictor.reserve(request, response);
    for (int frame = 0; frame < 3; ++frame) {
      response.plan = request.plan;
      REQUIRE(predictor.predict(state.positions, state.velocities, request, response));
    }
    // The next frame derives a rollout.
    request.kind = force ? GripInput::Pose : GripInput::Force;
    request.plan = swaying_hands(sheet, request.kind, 5).plan;
    response.plan = request.plan;
    REQUIRE(predictor.predict(state.positions, state.velocities, request, response));
    Exact alone{MassSpringResponse<double>(model)};
    alone.reserve(request, expected);
    expected.plan = request.plan;
    REQUIRE(alone.predict(state.positions, state.velocities, request, expected));
    CAPTURE(force);
    CHECK(response.has_jacobian);
    CHECK(response.impulse_response == expected.impulse_response);
  }
}

TEST_CASE("where a derivation fails, the rollout stays", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::Newton);
  for (const GripInput kind : {GripInput::Force, GripInput::Pose}) {
    WindowRequest<double> request = swaying_hands(sheet, kind, 6);
    request.path = MatrixX<double>::Constant(request.inputs(), request.horizon, 0.1);
    RolloutSettings plain;
    plain.derivative_interval = 0;
    Derived without = derived(model, plain);
    Breaking predictor{BreakingModel(model), Exact(MassSpringResponse<double>(model))};
    WindowResponse<double> a, b;
    without.reserve(request, a);
    predictor.reserve(request, b);
    for (int frame = 0; frame < 7; ++frame) {
      BreakingModel::broken = 3 <= frame && frame < 5;
      request.has_path = frame > 0;
      a.plan = b.plan = request.plan;
      REQUIRE(without.predict(sheet.state.positions, sheet.state.velocities, request, a));
      REQUIRE(predictor.predict(sheet.state.positions, sheet.state.velocities, request, b));
      CAPTURE(kind == GripInput::Force, frame);
      CHECK(b.has_jacobian == !BreakingModel::broken);
      CHECK(b.plan == a.plan);
      CHECK(b.free_response == a.free_response);
      if (BreakingModel::broken) CHECK(b.impulse_response == a.impulse_response);
    }
  }
  BreakingModel::broken = false;
}

TEST_CASE("where a rollout fails, the prediction is the inner one", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::Newton);
  const WindowRequest<double> request = swaying_hands(sheet, GripInput::Pose, 5);
  LinearisedPredictorSettings<double> measured;
  measured.measured_force = 1;  // what a second prediction in a frame would spoil
  const Exact inner(MassSpringResponse<double>(model), measured);
  Derived predictor(MassSpringRollout<double>(model), inner);
  Exact alone = inner;
  WindowResponse<double> a, b;
  predictor.reserve(request, a);
  alone.reserve(request, b);
  Points<double> v = sheet.state.velocities;
  for (int frame = 0; frame < 3; ++frame) {
    if (frame == 2) v(1, 7) = 1e30;  // too fast for single precision
    a.plan = b.plan = request.plan;
    REQUIRE(predictor.predict(sheet.state.positions, v, request, a));
    REQUIRE(alone.predict(sheet.state.positions, v, request, b));
    CHECK(a.has_jacobian == (frame < 2));
  }
  CHECK(a.impulse_response == b.impulse_response);
  CHECK(a.free_response == b.free_response);
}

TEST_CASE("rollout predictions obey the laws of predictors", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit, true);
  clothctl_test::PredictorLaws<double> laws;
  laws.linear = false;
  clothctl_test::check_predictor_laws(
      [&] {
        return RolloutPredictor<MassSpring<double>, Exact>(
            model, Exact(MassSpringResponse<double>(model)), RolloutSettings{2, 0.05});
      },
      sheet.state, std::vector<int>{sheet.upper_left(), sheet.upper_right()}, laws);
}

TEST_CASE("on a converged plant, rollouts track better than the linearised prediction", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(13);
  const int frames = clothctl_test::trials(60, 200);
  const AsyncTarget target(sheet, 1.5);
  PlannerSettings<double> frozen_settings = clothctl_test::corner_settings(sheet, GripInput::Pose);
  auto frozen =
      clothctl_test::frozen_planner(sheet, clothctl_test::corner_setup(sheet), frozen_settings);
  auto plant = clothctl_test::sheet_plant(sheet, Integration::Newton);
  const LoopStats plain =
      clothctl_test::run_loop(frozen, plant, frames, clothctl_test::corners(sheet), target,
                              clothctl_test::NoWind(), clothctl_test::NoWatch());

  const PlannerSettings<double> settings = clothctl_test::corner_settings(
      sheet, GripInput::Pose, 20, PlannerSettings<double>::rollout());
  auto made = clothctl_test::RollingPlanner::create(
      clothctl_test::corner_setup(sheet), settings,
      clothctl_test::rolling_predictor(sheet.model(Integration::Newton)), sheet.state.positions);
  REQUIRE(made.has_value());
  auto planner = std::move(made).value();
  auto other = clothctl_test::sheet_plant(sheet, Integration::Newton);
  const LoopStats rolled =
      clothctl_test::run_loop(planner, other, frames, clothctl_test::corners(sheet), target,
                              clothctl_test::NoWind(), clothctl_test::NoWatch());
  CAPTURE(plain.mean_error, rolled.mean_error);
  CHECK(rolled.failures == 0);
  CHECK(rolled.mean_error < plain.mean_error);
}

TEST_CASE("the forces of a rollout move the model along the rollout's path", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 60);
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    const MassSpring<double> model = sheet.model(integration, true);
    WindowRequest<double> request = swaying_hands(sheet, GripInput::Force, 6);
    request.path.setZero(request.inputs(), request.horizon);
    for (Index k = 0; k < request.horizon; ++k) {
      for (Index i = 0; i < request.inputs(); ++i)
        request.path(i, k) = 0.1 * std::cos(0.4 * static_cast<double>(k + i));
    }
    request.has_path = true;
    WindowResponse<double> response;
    Rolling predictor(model, Exact(MassSpringResponse<double>(model)),
                      RolloutSettings{integration == Integration::Newton ? 60 : 0, 0.0, 60});
    predictor.reserve(request, response);
    for (int repeat = 0; repeat < 2; ++repeat)
      REQUIRE(predictor.predict(sheet.state.positions, sheet.state.velocities, request, response));
    // The model under those forces.
    ClothState<double> state = sheet.state;
    auto workspace = model.make_workspace();
    ClothInput<double> input;
    input.force_vertices = request.held;
    input.driven_positions.resize(3, 0);
    Points<double> y(3, request.outputs.count());
    Points<double> path = state.positions(Eigen::all, request.held);
    double worst = 0.0, off_path = 0.0;
    for (Index k = 0; k < request.horizon; ++k) {
      input.forces = Eigen::Map<const Points<double>>(response.plan.col(k).data(), 3, 2);
      input.wind = request.wind.col(k);
      REQUIRE(model.step(state, input, kDt, workspace).advanced);
      evaluate_features<double>(request.outputs, state.positions, y);
      worst = std::max(worst, (response.free_response.col(k) -
                               Eigen::Map<const VectorX<double>>(y.data(), y.size()))
                                  .norm());
      path += kDt * Eigen::Map<const Points<double>>(request.path.col(k).data(), 3, 2);
      off_path = std::max(off_path, (state.positions(Eigen::all, request.held) - path).norm());
    }
    CAPTURE(integration == Integration::Newton, worst, off_path);
    CHECK(worst < (integration == Integration::Newton ? 1e-5 : 1e-9));
    CHECK(off_path < (integration == Integration::Newton ? 1e-5 : 1e-9));
    CHECK((response.plan - request.plan).norm() > 0.1);  // the forces differ from the request's
  }
}

TEST_CASE(
    "with rollouts, planned forces track a converged plant better and stay inside their cones",
    "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(13);
  const int frames = clothctl_test::trials(80, 250);
  const AsyncTarget target(sheet, 1.5);
  auto frozen =
      clothctl_test::frozen_planner(sheet, clothctl_test::corner_setup(sheet),
                                    clothctl_test::corner_settings(sheet, GripInput::Force));
  auto plant = clothctl_test::sheet_plant(sheet, Integration::Newton);
  const LoopStats plain =
      clothctl_test::run_loop(frozen, plant, frames, clothctl_test::corners(sheet), target,
                              clothctl_test::NoWind(), clothctl_test::NoWatch());
  const PlannerSettings<double> settings = clothctl_test::corner_settings(
      sheet, GripInput::Force, 20, PlannerSettings<double>::rollout());
  auto planner =
      clothctl_test::RollingPlanner::create(
          clothctl_test::corner_setup(sheet), settings,
          clothctl_test::rolling_predictor(sheet.model(Integration::Newton)), sheet.state.positions)
          .value();
  auto other = clothctl_test::sheet_plant(sheet, Integration::Newton);
  double cone = 0.0, error = 0.0;
  const LoopStats rolled = clothctl_test::run_loop(
      planner, other, frames, clothctl_test::corners(sheet), target, clothctl_test::NoWind(),
      [&](int, const PlanResult<double>& result) {
        for (const FingerForce<double>& f : result.finger_forces)
          cone = std::max(cone, cone_violation<double>(f.force, f.normal, 0.5, 20.0));
        error = std::max(error, result.prediction_error);
      });
  CAPTURE(plain.mean_error, rolled.mean_error, error);
  CHECK(rolled.failures == 0);
  CHECK(rolled.mean_error < 0.85 * plain.mean_error);
  CHECK(cone <= 1e-9);
  CHECK(error < 1e-3);
}

TEST_CASE("smooth hands do not swing where targets are further apart than the sheet lets them",
          "[mpc]") {
  using Linearised = LinearisedPredictor<MassSpringResponse<float>, double>;
  using Predictor = RolloutPredictor<MassSpringRollout<double>, Linearised>;
  const HangingSheet sheet = clothctl_test::hanging_sheet(13);
  const MassSpring<double> model = sheet.model(Integration::Newton);
  Points<double> wanted(3, 2);
  wanted << sheet.state.positions.col(sheet.lower_left()),
      sheet.state.positions.col(sheet.lower_right());
  const Vector3<double> middle = wanted.rowwise().mean(),
                        across = (wanted.col(1) - wanted.col(0)).normalized();
  wanted.col(0) = middle - 0.2495 * across;  // they hang 0.497 m apart
  wanted.col(1) = middle + 0.2495 * across;
  const auto target = [&](Index i, double) { return Vector3<double>(wanted.col(i)); };
  // Returns how far a hand moves to and fro in the last second, m.
  const auto swing = [&](double smooth) {
    PlannerSettings<double> settings = clothctl_test::corner_settings(
        sheet, GripInput::Pose, 20, PlannerSettings<double>::rollout(0.05));
    settings.weights.anchor = 1.5;
    settings.weights.smooth = smooth;
    auto planner =
        Planner<Predictor>::create(clothctl_test::corner_setup(sheet), settings,
                                   Predictor(MassSpringRollout<double>(model),
                                             Linearised(MassSpringResponse<float>(model))),
                                   sheet.state.positions)
            .value();
    auto plant = clothctl_test::sheet_plant(sheet, Integration::Newton);
    PlanResult<double> result = planner.make_result();
    double front = 1e9, back = -1e9;
    for (int frame = 0; frame < 120; ++frame) {
      const double time = kDt * static_cast<double>(frame);
      REQUIRE(run_frame(planner, plant, time, target, clothctl_test::NoWind(), result).advanced());
      if (frame < 70) continue;
      const double y = plant.state().positions(1, sheet.upper_left());
      front = std::min(front, y);
      back = std::max(back, y);
    }
    return back - front;
  };
  const double rough = swing(PlannerWeights<double>().smooth);
  const double preset = swing(PlannerSettings<double>::rollout().weights.smooth);
  const double smooth = swing(0.2);
  CAPTURE(rough, preset, smooth);
  CHECK(rough > 1.5e-3);
  CHECK(preset < 0.8 * rough);
  CHECK(smooth < 0.4e-3);
}
