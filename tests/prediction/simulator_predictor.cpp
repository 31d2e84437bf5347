// Predictions by a simulator alone, compared with its own steps and with exact derivatives, and
// their effect in closed loops on a position-based sheet.

#include "clothctl/prediction/simulator_predictor.hpp"

#include <array>
#include <limits>
#include <string>
#include <utility>

#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mpc/loose_plant.hpp"
#include "clothctl/prediction/coarse_predictor.hpp"
#include "laws/predictor_laws.hpp"
#include "mpc/planner_loops.hpp"
#include "prediction/window_requests.hpp"
#include "support/catch.hpp"
#include "support/thread_executor.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::HangingSheet;
using clothctl_test::stepped;
using clothctl_test::swaying_hands;

namespace {

using Sheet = PositionBased<double>;
using Simulated = SimulatorPredictor<Sheet>;

Sheet position_based(const HangingSheet& sheet, bool air = true) {
  PositionBasedSettings<double> settings;
  settings.drag = 0.5;
  if (air) settings.air = {1.2, 1.0, 0.2};
  return Sheet::create(sheet.network, settings).value();
}

template <class Predictor>
WindowResponse<double> predicted(Predictor& predictor, const ClothState<double>& state,
                                 const WindowRequest<double>& request) {
  WindowResponse<double> response;
  predictor.reserve(request, response);
  REQUIRE(predictor.predict(state.positions, state.velocities, request, response));
  return response;
}

// A model whose steps fail where the first hand is to be above a ceiling.
struct Brittle {
  using Scalar = double;
  Sheet sheet;
  double ceiling = 1e9;

  Index vertex_count() const { return sheet.vertex_count(); }
  ClothState<double> rest_state() const { return sheet.rest_state(); }
  auto make_workspace() const { return sheet.make_workspace(); }
  StepReport<double> step(ClothState<double>& state, const ClothInput<double>& input, double dt,
                          PositionBasedWorkspace<double>& workspace) const {
    if (ceiling < input.driven_positions(2, 0)) return {};
    return sheet.step(state, input, dt, workspace);
  }
};

}  // namespace

TEST_CASE("the free response of a simulator has the bits of its own steps", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 60);
  const Sheet model = position_based(sheet);
  Points<double> forces = Points<double>::Zero(3, model.vertex_count());
  const WindowRequest<double> windy = swaying_hands(sheet, GripInput::Pose, 8);
  Simulated predictor(model);
  WindowResponse<double> response;
  predictor.reserve(windy, response);
  const auto free = [&](const WindowRequest<double>& request) {
    REQUIRE(predictor.predict(sheet.state.positions, sheet.state.velocities, request, response));
    return response.free_response;
  };
  const MatrixX<double> plain = free(windy);
  CHECK(plain == stepped(model, sheet.state, windy, forces));
  WindowRequest<double> changed = windy;
  changed.wind.setZero();
  CHECK((free(changed) - plain).norm() > 1e-4);
  forces.row(1).setConstant(0.002);
  changed = windy;
  changed.outer_force = forces;
  CHECK(free(changed) == stepped(model, sheet.state, windy, forces));
  VertexSupport<double> support;  // a force that does not end
  support.vertex = sheet.lower_left();
  support.force = Vector3<double>(0.001, 0, 0.01);
  support.release = std::numeric_limits<double>::infinity();
  changed.supports.push_back(support);
  forces.col(support.vertex) += support.force;
  CHECK(free(changed) == stepped(model, sheet.state, windy, forces));
  CHECK(free(windy) == plain);  // nothing carries over
}

TEST_CASE("in a simulation, a support lets go of a vertex that is lifted", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 60);
  WindowRequest<double> lifted = swaying_hands(sheet, GripInput::Pose, 8);
  lifted.plan.setZero();
  lifted.plan.row(2).setConstant(0.5);
  lifted.plan.row(5).setConstant(0.5);
  Simulated predictor(position_based(sheet));
  const MatrixX<double> without = predicted(predictor, sheet.state, lifted).free_response;
  const auto effect = [&](double release) {
    WindowRequest<double> request = lifted;
    VertexSupport<double> support;
    support.vertex = sheet.lower_left();
    support.force = Vector3<double>(0, 0, 0.01);
    support.release = release;
    request.supports.push_back(support);
    return (predicted(predictor, sheet.state, request).free_response - without).norm();
  };
  const double lasting = effect(std::numeric_limits<double>::infinity()), ending = effect(0.002);
  CAPTURE(lasting, ending);
  CHECK(0 < ending);
  CHECK(ending < 0.7 * lasting);
}

TEST_CASE("differences of a simulator are the derivatives of its steps", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 60);
  const ClothState<double> state = clothctl_test::shaken(sheet.state, 3);
  const WindowRequest<double> request = swaying_hands(sheet, GripInput::Pose, 8);
  const Index inputs = request.inputs();
  // A linearly implicit step is an affine function of the input.
  const MassSpring<double> one = sheet.model(Integration::LinearlyImplicit, true);
  SimulatorPredictor<MassSpring<double>> simulated(one);
  LinearisedPredictor<MassSpringResponse<double>, double> exact{MassSpringResponse<double>(one)};
  const WindowResponse<double> a = predicted(simulated, state, request),
                               b = predicted(exact, state, request);
  CHECK((a.free_response.col(0) - b.free_response.col(0)).norm() < 1e-12);
  CHECK((a.impulse_response - b.impulse_response).leftCols(inputs).norm() <
        1e-9 * b.impulse_response.leftCols(inputs).norm());
  // Later frames are not affine: the error of a difference is proportional to the change.
  const MassSpring<double> newton = sheet.model(Integration::Newton, true);
  std::array<MatrixX<double>, 3> response;
  for (std::size_t i = 0; i < 3; ++i) {
    SimulatorPredictor<MassSpring<double>> predictor(
        newton, SimulatorPredictorSettings{1e-3 / (1 << (2 * i))});
    response[i] = predicted(predictor, state, request).impulse_response;
  }
  const double first = (response[0] - response[1]).norm(),
               second = (response[1] - response[2]).norm();
  CAPTURE(first, second);
  CHECK(second > 0);
  CHECK(second < 0.35 * first);  // a quarter
}

TEST_CASE("predictions of a simulator have the same bits with every executor", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 30);
  const WindowRequest<double> request = swaying_hands(sheet, GripInput::Pose, 6);
  clothctl_test::ThreadExecutor threads;
  clothctl_test::BackwardExecutor backward;
  Simulated plain(position_based(sheet)), on_threads = plain, backwards = plain;
  on_threads.set_executor(ExecutorRef(threads));
  backwards.set_executor(ExecutorRef(backward));
  const WindowResponse<double> expected = predicted(plain, sheet.state, request);
  for (Simulated* other : {&on_threads, &backwards}) {
    const WindowResponse<double> found = predicted(*other, sheet.state, request);
    CHECK(found.free_response == expected.free_response);
    CHECK(found.impulse_response == expected.impulse_response);
  }
  CHECK(threads.loops == 1);
}

TEST_CASE("predictions of a simulator obey the laws of predictors", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 30);
  const Sheet model = position_based(sheet);
  clothctl_test::PredictorLaws<double> laws;
  laws.linear = false;
  laws.kinds = {GripInput::Pose};
  clothctl_test::check_predictor_laws([&] { return Simulated(model); }, sheet.state,
                                      std::vector<int>{sheet.upper_left(), sheet.upper_right()},
                                      laws);
}

TEST_CASE("a simulator refuses forces and windows that it was not made for", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 30);
  Simulated predictor(position_based(sheet));
  const auto setup = clothctl_test::corner_setup(sheet);
  const auto forces = clothctl_test::corner_settings(sheet, GripInput::Force, 6);
  using SimulatedPlanner = Planner<Simulated, PlannerSetup<double>>;
  const auto made = SimulatedPlanner::create(setup, forces, predictor, sheet.state.positions);
  REQUIRE_FALSE(made.has_value());
  CHECK(made.error() == "the predictor does not predict planned forces");
  using CoarsePlanner = Planner<CoarsePredictor<Simulated>, PlannerSetup<double>>;
  const auto coarse = CoarsePlanner::create(
      setup, forces, CoarsePredictor<Simulated>(sample_grids(sheet.grid, sheet.grid), predictor),
      sheet.state.positions);
  REQUIRE_FALSE(coarse.has_value());
  CHECK(coarse.error() == made.error());

  WindowRequest<double> request = swaying_hands(sheet, GripInput::Pose, 6);
  WindowResponse<double> response = predicted(predictor, sheet.state, request);
  const WindowResponse<double> before = response;
  const auto refuses = [&](const WindowRequest<double>& changed) {
    return !predictor.predict(sheet.state.positions, sheet.state.velocities, changed, response) &&
           response.free_response == before.free_response;
  };
  WindowRequest<double> changed = request;
  changed.kind = GripInput::Force;
  CHECK(refuses(changed));
  changed = request;
  changed.horizon = 5;
  CHECK(refuses(changed));
  changed = request;
  changed.supports.push_back({25, Vector3<double>::Zero()});
  CHECK(refuses(changed));
  SimulatorPredictorSettings settings;
  settings.difference = 0;
  CHECK(settings.validate() == "difference is 0, must be positive");
}

TEST_CASE("a simulator whose step fails leaves the response as it was", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 30);
  Brittle model{position_based(sheet)};
  WindowRequest<double> request = swaying_hands(sheet, GripInput::Pose, 6);
  SimulatorPredictor<Brittle> sound(model);
  const WindowResponse<double> before = predicted(sound, sheet.state, request);
  request.plan.setZero();
  // Either all rollouts fail, or only the one in which that hand goes up by a millimetre.
  for (const double above : {-1e-3, 0.5e-3}) {
    model.ceiling = sheet.state.positions(2, sheet.upper_left()) + above;
    SimulatorPredictor<Brittle> predictor(model);
    WindowResponse<double> response;
    predictor.reserve(request, response);
    response = before;
    CHECK_FALSE(
        predictor.predict(sheet.state.positions, sheet.state.velocities, request, response));
    CHECK(response.free_response == before.free_response);
    CHECK(response.impulse_response == before.impulse_response);
  }
}

TEST_CASE("a position-based sheet is tracked twice as well by its own simulator", "[mpc]") {
  HangingSheet sheet = clothctl_test::hanging_sheet(9);
  const Sheet model = position_based(sheet, false);  // as the linearised model
  // Unfinished sweeps let it hang lower.
  PositionBasedSettings<double> calm = model.settings();
  calm.drag = 10;
  calm.pinned = {sheet.upper_left(), sheet.upper_right()};
  ModelPlant<Sheet> settled(Sheet::create(sheet.network, calm).value());
  settled.set_state(sheet.state);
  for (int i = 0; i < 150; ++i) REQUIRE(settled.advance(clothctl_test::kFrame).advanced);
  sheet.state = settled.state();
  const clothctl_test::AsyncTarget target(sheet, 1.5);
  const auto setup = clothctl_test::corner_setup(sheet);
  const int frames = clothctl_test::trials(100, 250);

  const auto run = [&](auto planner) {
    ModelPlant<Sheet> plant(model);
    plant.set_state(sheet.state);
    return clothctl_test::run_loop(planner, plant, frames, clothctl_test::corners(sheet), target,
                                   clothctl_test::NoWind(), clothctl_test::NoWatch());
  };
  const LoosePlantProfile<double> loose = loose_plant<double>(WeightBearing::Elongation);
  PlannerSettings<double> firm = loose.planner;
  firm.least_agreement = 0;  // better for seconds
  using Linearised = LinearisedPredictor<MassSpringResponse<float>, double>;
  const auto linearised =
      run(Planner<Linearised, PlannerSetup<double>>::create(
              setup, clothctl_test::corner_settings(sheet, GripInput::Pose, 20, firm),
              Linearised(MassSpringResponse<float>(sheet.model(Integration::LinearlyImplicit),
                                                   loose.response),
                         loose.predictor),
              sheet.state.positions)
              .value());
  PlannerSettings<double> damped = PlannerSettings<double>::rollout();
  damped.weights.smooth = 0.3;
  damped.weights.step = 0.05;
  const auto simulated =
      run(Planner<Simulated, PlannerSetup<double>>::create(
              setup, clothctl_test::corner_settings(sheet, GripInput::Pose, 20, damped),
              Simulated(model), sheet.state.positions)
              .value());
  CAPTURE(linearised.mean_error, simulated.mean_error, simulated.max_error);
  CHECK(linearised.failures == 0);
  CHECK(linearised.mean_error < 0.03);  // not lost
  CHECK(simulated.failures == 0);
  CHECK(simulated.mean_error < 0.012);
  CHECK(simulated.max_error < 0.04);
  CHECK(simulated.mean_error < 0.5 * linearised.mean_error);
}
