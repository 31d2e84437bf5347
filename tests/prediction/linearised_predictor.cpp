// The linearised predictor, compared with an independent dense rollout of the linearised step and
// with the plant itself.

#include "clothctl/prediction/linearised_predictor.hpp"

#include <random>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/prediction/rollout_predictor.hpp"
#include "laws/predictor_laws.hpp"
#include "prediction/dense_step.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using clothctl_test::DenseStep;
using clothctl_test::HangingSheet;

namespace {

constexpr double kDt = clothctl_test::kFrame;

// Outputs: both lower corners, a centroid of three vertices with a held one, a single held vertex,
// a signed sum with a pinned vertex, and the held vertices. These are seven points, more than one
// pass takes in double.
WindowRequest<double> request_for(const HangingSheet& sheet, GripInput kind, Index horizon) {
  WindowRequest<double> request;
  request.horizon = horizon;
  request.dt = kDt;
  request.kind = kind;
  request.held = {sheet.upper_left(), sheet.upper_right()};
  request.outputs.add_point(sheet.lower_left());
  request.outputs.add_point(sheet.lower_right());
  request.outputs.add_centroid({sheet.lower_left(), sheet.upper_left(), sheet.grid.vertex(2, 2)});
  request.outputs.add_point(sheet.upper_right());
  request.outputs.add_sum(
      {{sheet.upper_left(), 0.5}, {sheet.grid.vertex(3, 1), -1.25}, {sheet.upper_right(), 1.75}});
  request.held_outputs = request.outputs.count();
  for (int v : request.held) request.outputs.add_point(v);
  request.plan.setZero(request.inputs(), horizon);
  request.applied.setZero(request.inputs());
  request.wind.setZero(3, horizon);
  return request;
}

void randomise(WindowRequest<double>& request, unsigned seed, double size, bool windy, bool gusty) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (Index i = 0; i < request.plan.size(); ++i) request.plan(i) = size * uniform(random);
  const Vector3<double> wind(3.0 * uniform(random), 5.0 * uniform(random), uniform(random));
  for (Index k = 0; k < request.horizon; ++k) {
    request.wind.col(k).setZero();
    if (windy) request.wind.col(k) = wind;
    if (gusty)
      request.wind.col(k) += Vector3<double>(uniform(random), uniform(random), uniform(random));
  }
}

MatrixX<double> outputs_of(const WindowRequest<double>& request, const MatrixX<double>& positions) {
  MatrixX<double> y = MatrixX<double>::Zero(request.output_rows(), positions.cols());
  for (Index i = 0; i < request.outputs.count(); ++i) {
    request.outputs.for_each_term(i, [&](int vertex, double weight) {
      y.middleRows<3>(3 * i) += weight * positions.middleRows<3>(3 * vertex);
    });
  }
  return y;
}

// A response that declares its internal forces independent of translation.
template <class Scalar>
struct FloatingResponse : MassSpringResponse<Scalar> {
  using MassSpringResponse<Scalar>::MassSpringResponse;
  bool translation_free() const { return true; }
};

// Largest error divided by the largest distance that an output moves.
double relative_error(const WindowRequest<double>& request, const ClothState<double>& state,
                      const MatrixX<double>& predicted, const MatrixX<double>& positions) {
  const MatrixX<double> y = outputs_of(request, positions);
  const MatrixX<double> start = outputs_of(
      request,
      Eigen::Map<const MatrixX<double>>(state.positions.data(), state.positions.size(), 1));
  return (predicted - y).cwiseAbs().maxCoeff() / (y.colwise() - start.col(0)).cwiseAbs().maxCoeff();
}

// One step of the plant under the first column of the plan.
MatrixX<double> plant_step(const MassSpring<double>& model, const ClothState<double>& start,
                           const WindowRequest<double>& request) {
  auto workspace = model.make_workspace();
  ClothState<double> state = start;
  ClothInput<double> input;
  input.wind = request.wind.col(0);
  const Eigen::Map<const Points<double>> u(request.plan.data(), 3,
                                           static_cast<Index>(request.held.size()));
  if (request.kind == GripInput::Force) {
    input.force_vertices = request.held;
    input.forces = u;
  } else {
    input.driven_vertices = request.held;
    input.driven_positions.resize(3, u.cols());
    for (Index j = 0; j < u.cols(); ++j)
      input.driven_positions.col(j) =
          start.positions.col(request.held[static_cast<std::size_t>(j)]) + kDt * u.col(j);
  }
  REQUIRE(model.step(state, input, kDt, workspace).advanced);
  return Eigen::Map<const MatrixX<double>>(state.positions.data(), state.positions.size(), 1);
}

template <class Response>
void compare(const HangingSheet& sheet, Index horizon, int trials, double tolerance) {
  for (int trial = 0; trial < trials; ++trial) {
    const unsigned seed = static_cast<unsigned>(trial);
    const bool air = trial % 2 == 1, gusty = trial % 4 == 3, pinned = trial % 3 == 2;
    const GripInput kind = (trial / 2) % 2 == 0 ? GripInput::Force : GripInput::Pose;
    CAPTURE(trial, air, gusty, pinned, kind == GripInput::Force);
    const std::vector<int> pins =
        pinned ? std::vector<int>{sheet.grid.vertex(4, 4), sheet.grid.vertex(3, 1)}
               : std::vector<int>{};
    const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit, air, pins);
    ClothState<double> state = clothctl_test::shaken(sheet.state, 100 + seed);
    for (int v : pins) state.velocities.col(v).setZero();
    WindowRequest<double> request = request_for(sheet, kind, horizon);
    randomise(request, seed, kind == GripInput::Force ? 0.4 : 0.5, air, gusty);
    WindowResponse<double> response;
    LinearisedPredictor<Response, double> predictor{Response(model)};
    predictor.reserve(request, response);
    REQUIRE(predictor.predict(state.positions, state.velocities, request, response));

    const std::vector<int> driven = kind == GripInput::Pose ? request.held : std::vector<int>{};
    const DenseStep dense(model, state.positions, state.velocities, request.wind.col(0), kDt,
                          driven);
    const MatrixX<double> rolled =
        dense.rollout(state.positions, state.velocities, request.held, request.plan, request.wind);
    CHECK(relative_error(request, state, response.free_response, rolled) < tolerance);
    CHECK(relative_error(request, state, response.free_response.col(0),
                         plant_step(model, state, request)) < tolerance);

    // The impulse response: the same window with another plan.
    WindowRequest<double> other = request;
    randomise(other, 50 + seed, 0.3, false, false);
    other.wind = request.wind;
    MatrixX<double> moved = response.free_response;
    for (Index k = 0; k < horizon; ++k) {
      for (Index j = 0; j <= k; ++j) {
        moved.col(k) +=
            response.impulse_response.middleCols((k - j) * request.inputs(), request.inputs()) *
            (other.plan.col(j) - request.plan.col(j));
      }
    }
    const MatrixX<double> rolled_other =
        dense.rollout(state.positions, state.velocities, request.held, other.plan, request.wind);
    CHECK(relative_error(request, state, moved, rolled_other) < tolerance);
  }
}

}  // namespace

TEST_CASE("forces and stiffness of the dense step are derivatives of the spring energy", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 0);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit);
  // Stretched by a fifth, so that no stiffness block is projected.
  Points<double> x = 1.2 * sheet.network.rest_positions;
  x += clothctl_test::shaken({0.0 * x, 0.0 * x}, 3, 1e-3, 0.0).positions;
  const Points<double> v = Points<double>::Zero(3, x.cols());
  const DenseStep dense(model, x, v, Vector3<double>::Zero(), kDt, {});
  const double e = 1e-6;
  for (Index i = 0; i < x.size(); i += 7) {
    Points<double> up = x, down = x;
    up(i) += e;
    down(i) -= e;
    const double gravity = sheet.network.mass[i / 3] * model.settings().gravity[i % 3];
    const double slope = (detail::spring_energy<double>(sheet.network, up) -
                          detail::spring_energy<double>(sheet.network, down)) /
                         (2 * e);
    CHECK(dense.f[i] - gravity == Approx(-slope).epsilon(1e-6).margin(1e-7));
    const Eigen::VectorXd change = (DenseStep(model, up, v, Vector3<double>::Zero(), kDt, {}).f -
                                    DenseStep(model, down, v, Vector3<double>::Zero(), kDt, {}).f) /
                                   (2 * e);
    CHECK((change + dense.K.col(i)).norm() < 1e-6 * dense.K.col(i).norm());
  }
}

TEST_CASE("the linearised prediction equals the plant's own linear step in each frame", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 60);
  compare<MassSpringResponse<double>>(sheet, 20, 12, 1e-10);
  compare<MassSpringResponse<double>>(sheet, 1, 4, 1e-10);
  compare<FloatingResponse<double>>(sheet, 20, 12, 1e-10);
}

TEST_CASE("a single-precision prediction has single-precision accuracy", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 60);
  compare<FloatingResponse<float>>(sheet, 20, 12, 5e-4);

  // On a finer sheet, single precision loses digits in products K w where w is nearly a
  // translation.
  const HangingSheet fine = clothctl_test::hanging_sheet(17, 1, 20);
  const MassSpring<double> model = fine.model(Integration::LinearlyImplicit);
  const ClothState<double> state = clothctl_test::shaken(fine.state, 1, 0.005, 0.3);
  WindowRequest<double> request = request_for(fine, GripInput::Force, 20);
  WindowResponse<double> coarse, exact;
  LinearisedPredictor<FloatingResponse<float>, double> single{FloatingResponse<float>(model)};
  LinearisedPredictor<MassSpringResponse<double>, double> twice{MassSpringResponse<double>(model)};
  single.reserve(request, coarse);
  twice.reserve(request, exact);
  REQUIRE(single.predict(state.positions, state.velocities, request, coarse));
  REQUIRE(twice.predict(state.positions, state.velocities, request, exact));
  CHECK((coarse.impulse_response - exact.impulse_response).cwiseAbs().maxCoeff() <
        2e-3 * exact.impulse_response.cwiseAbs().maxCoeff());
}

TEST_CASE("one frame ahead on a finer sheet, the prediction equals the plant", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(17, 1, 10);
  for (int trial = 0; trial < 4; ++trial) {
    const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit, trial >= 2);
    const ClothState<double> state =
        clothctl_test::shaken(sheet.state, 7u + static_cast<unsigned>(trial), 0.02, 2.0);
    WindowRequest<double> request =
        request_for(sheet, trial % 2 == 0 ? GripInput::Force : GripInput::Pose, 2);
    randomise(request, static_cast<unsigned>(trial), 0.5, trial >= 2, true);
    WindowResponse<double> response;
    LinearisedPredictor<MassSpringResponse<double>, double> predictor{
        MassSpringResponse<double>(model)};
    predictor.reserve(request, response);
    REQUIRE(predictor.predict(state.positions, state.velocities, request, response));
    CHECK(relative_error(request, state, response.free_response.col(0),
                         plant_step(model, state, request)) < 1e-10);
  }
}

TEST_CASE("known external forces enter the prediction", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit);
  const ClothState<double> state = clothctl_test::shaken(sheet.state, 5);
  WindowRequest<double> request = request_for(sheet, GripInput::Pose, 10);
  randomise(request, 1, 0.3, false, false);
  request.outer_force =
      0.01 *
      clothctl_test::shaken({0.0 * state.positions, 0.0 * state.positions}, 9, 1.0, 0.0).positions;
  WindowResponse<double> response;
  LinearisedPredictor<MassSpringResponse<double>, double> predictor{
      MassSpringResponse<double>(model)};
  predictor.reserve(request, response);
  REQUIRE(predictor.predict(state.positions, state.velocities, request, response));
  DenseStep dense(model, state.positions, state.velocities, Vector3<double>::Zero(), kDt,
                  request.held);
  dense.f +=
      Eigen::Map<const Eigen::VectorXd>(request.outer_force.data(), request.outer_force.size());
  const MatrixX<double> rolled =
      dense.rollout(state.positions, state.velocities, request.held, request.plan, request.wind);
  CHECK(relative_error(request, state, response.free_response, rolled) < 1e-10);
}

TEST_CASE("supports are known forces", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit);
  const ClothState<double> state = clothctl_test::shaken(sheet.state, 5);
  WindowRequest<double> carried = request_for(sheet, GripInput::Pose, 10), pushed = carried;
  carried.supports = {{7, Vector3<double>(0, 0.6, 0.8), Vector3<double>(0.001, 0, 0.02), 0.004},
                      {12, Vector3<double>(0, 0, 1), Vector3<double>(0, 0, 0.03), 0.001}};
  pushed.outer_force.setZero(3, 25);
  for (const auto& support : carried.supports)
    pushed.outer_force.col(support.vertex) = support.force;
  LinearisedPredictor<MassSpringResponse<double>, double> predictor{
      MassSpringResponse<double>(model)};
  WindowResponse<double> a, b;
  predictor.reserve(carried, a);
  predictor.reserve(pushed, b);
  REQUIRE(predictor.predict(state.positions, state.velocities, carried, a));
  REQUIRE(predictor.predict(state.positions, state.velocities, pushed, b));
  CHECK(a.free_response == b.free_response);
  CHECK(a.air == b.air);
  carried.supports[1].vertex = 25;
  CHECK_FALSE(predictor.predict(state.positions, state.velocities, carried, a));
}

TEST_CASE("a measured force replaces the model's force", "[mpc]") {
  // Every vertex of the plant is pushed by the same force. The model does not know it; with the
  // measured force the prediction includes it.
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 60);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit);
  auto workspace = model.make_workspace();
  WindowRequest<double> request = request_for(sheet, GripInput::Force, 1);
  const Vector3<double> share = sheet.gravity_load() / 2.0;
  request.plan << share, share;
  request.applied = request.plan.col(0);
  request.has_applied = true;
  ClothInput<double> input;
  input.force_vertices = request.held;
  const Index n = model.vertex_count();
  input.forces.resize(3, 2 + n);
  input.forces.leftCols(2) << share, share;
  for (Index i = 0; i < n; ++i) {
    input.force_vertices.push_back(static_cast<int>(i));
    input.forces.col(2 + i) = sheet.network.mass[i] * Vector3<double>(0.5, 1.0, 0.0);
  }
  double error[2];
  for (const bool measured : {false, true}) {
    ClothState<double> state = sheet.state;
    LinearisedPredictor<MassSpringResponse<double>, double> predictor{
        MassSpringResponse<double>(model), {measured ? 1.0 : 0.0}};
    WindowResponse<double> response;
    predictor.reserve(request, response);
    for (int k = 0; k < 3; ++k) {
      REQUIRE(predictor.predict(state.positions, state.velocities, request, response));
      REQUIRE(model.step(state, input, kDt, workspace).advanced);
    }
    error[measured ? 1 : 0] =
        (response.free_response.block<3, 1>(0, 0) - state.positions.col(sheet.lower_left())).norm();
  }
  CHECK(error[0] > 1e-4);
  CHECK(error[1] < 0.5 * error[0]);
}

TEST_CASE("a measured force counts air and dampers once and follows changes of the wind", "[mpc]") {
  // A flat sheet moves freely.
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 60);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit, true);
  auto workspace = model.make_workspace();
  WindowRequest<double> request = request_for(sheet, GripInput::Force, 1);
  request.has_applied = true;
  ClothInput<double> input;
  input.forces.resize(3, 0);
  double error[2];
  for (const bool measured : {false, true}) {
    ClothState<double> state = model.rest_state();
    state.velocities.row(1).setConstant(3.0);
    LinearisedPredictor<MassSpringResponse<double>, double> predictor{
        MassSpringResponse<double>(model), {measured ? 1.0 : 0.0}};
    WindowResponse<double> response;
    predictor.reserve(request, response);
    error[measured ? 1 : 0] = 0.0;
    for (int k = 0; k < 12; ++k) {
      request.wind.col(0) =
          k < 6 ? Vector3<double>(0.0, 0.0, 0.0) : Vector3<double>(0.0, -2.0, 0.0);
      input.wind = request.wind.col(0);
      REQUIRE(predictor.predict(state.positions, state.velocities, request, response));
      REQUIRE(model.step(state, input, kDt, workspace).advanced);
      if (k < 1) continue;
      const double miss =
          (response.free_response.block<3, 1>(0, 0) - state.positions.col(sheet.lower_left()))
              .norm();
      error[measured ? 1 : 0] = std::max(error[measured ? 1 : 0], miss);
    }
  }
  CAPTURE(error[0], error[1]);
  CHECK(error[0] < 1e-12);
  CHECK(error[1] < 6e-4);  // air takes 6 mm of 60; springs react to differences of air and leave a
                           // small error its differences
}

TEST_CASE("in single precision the prediction does not depend on position", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(9, 1, 60);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit, true);
  const ClothState<double> state = clothctl_test::shaken(sheet.state, 4);
  for (const GripInput kind : {GripInput::Force, GripInput::Pose}) {
    WindowRequest<double> request = request_for(sheet, kind, 15);
    randomise(request, 3, 0.3, false, true);
    LinearisedPredictor<MassSpringResponse<float>, double> predictor{
        MassSpringResponse<float>(model)};
    WindowResponse<double> here, there;
    predictor.reserve(request, here);
    REQUIRE(predictor.predict(state.positions, state.velocities, request, here));
    const Vector3<double> offset(1000.0, -500.0, 30.0);
    const Points<double> moved = state.positions.colwise() + offset;
    predictor.reserve(request, there);
    REQUIRE(predictor.predict(moved, state.velocities, request, there));
    // What single precision leaves of positions up to 1 m differs by 1e-7 m: so much may change.
    WindowResponse<double> rounded;
    clothctl_test::Numbers random(6);
    Points<double> nudged = state.positions;
    for (Index i = 0; i < nudged.size(); ++i) nudged(i) += random(-1e-7, 1e-7);
    predictor.reserve(request, rounded);
    REQUIRE(predictor.predict(nudged, state.velocities, request, rounded));
    const double rounding = (rounded.free_response - here.free_response).cwiseAbs().maxCoeff();
    double miss = 0.0;
    for (Index i = 0; i < request.outputs.count(); ++i) {
      double weight = 0.0;
      request.outputs.for_each_term(i, [&](int, double w) { weight += w; });
      for (Index k = 0; k < request.horizon; ++k) {
        const Vector3<double> change =
            there.free_response.block<3, 1>(3 * i, k) - here.free_response.block<3, 1>(3 * i, k);
        miss = std::max(miss, (change - weight * offset).norm());
      }
    }
    CAPTURE(miss, rounding);
    CHECK(miss < 2.0 * rounding);
    CHECK(rounding < 1e-4);
    CHECK((there.impulse_response - here.impulse_response).norm() <
          1e-4 * here.impulse_response.norm());
  }
}

TEST_CASE("states of another size and held vertices off the mesh are refused", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 10);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit);
  WindowRequest<double> request = request_for(sheet, GripInput::Pose, 4);
  LinearisedPredictor<MassSpringResponse<double>, double> predictor{
      MassSpringResponse<double>(model)};
  WindowResponse<double> response;
  predictor.reserve(request, response);
  const Points<double> few = sheet.state.positions.leftCols(20);
  CHECK_FALSE(predictor.predict(few, few, request, response));
  CHECK_FALSE(predictor.predict(sheet.state.positions, few, request, response));
  request.held[0] = 25;
  CHECK_FALSE(predictor.predict(sheet.state.positions, sheet.state.velocities, request, response));
  CHECK(LinearisedPredictorSettings<double>{1.5}.validate() ==
        "measured_force is 1.5, must be 0 to 1");
  CHECK(RolloutSettings{-1}.validate().find("newton_steps is -1") == 0);
  RolloutSettings rollout;
  rollout.first_step_tolerance = -1;
  CHECK(rollout.validate().find("first_step_tolerance is -1") == 0);
  rollout = {};
  rollout.derivative_stride = 0;
  CHECK(rollout.validate() == "derivative_stride is 0, must be at least 1");
}

TEST_CASE("the last frame is remembered when vertices are let go", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 60);
  const Points<double>&x = sheet.state.positions, &v = sheet.state.velocities;
  WindowRequest<double> both = request_for(sheet, GripInput::Pose, 2), one = both;
  one.held.pop_back();
  one.plan.setZero(3, 2);
  one.applied.setZero(3);
  const auto predictor = [&](double measured_force) {
    return LinearisedPredictor<MassSpringResponse<double>, double>(
        MassSpringResponse<double>(sheet.model(Integration::LinearlyImplicit)), {measured_force});
  };
  auto goes_on = predictor(1.0), models = predictor(0.0);
  WindowResponse<double> first, measured, modelled;
  goes_on.reserve(both, first);
  REQUIRE(goes_on.predict(x, v, both, first));
  goes_on.reserve(one, measured);
  models.reserve(one, modelled);
  REQUIRE(goes_on.predict(x, v, one, measured));
  REQUIRE(models.predict(x, v, one, modelled));
  // The vertex let go falls, although it was at rest; elsewhere the measured force counts.
  const double falls = modelled.free_response(11, 1) - x(2, sheet.upper_right());
  CHECK(falls < -0.001);
  CHECK(measured.free_response(11, 1) - x(2, sheet.upper_right()) < 0.3 * falls);
  CHECK((measured.free_response - modelled.free_response).norm() > 1e-6);
  goes_on.reset();
  REQUIRE(goes_on.predict(x, v, one, measured));
  CHECK(measured.free_response == modelled.free_response);
}

TEST_CASE("predicting does not allocate and repeats bit by bit", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 10);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit, true);
  const ClothState<double> state = clothctl_test::shaken(sheet.state, 1);
  for (const GripInput kind : {GripInput::Force, GripInput::Pose}) {
    WindowRequest<double> request = request_for(sheet, kind, 12);
    randomise(request, 4, 0.4, true, true);
    WindowResponse<double> first, second;
    LinearisedPredictor<MassSpringResponse<float>, double> predictor{
        MassSpringResponse<float>(model)};
    predictor.reserve(request, second);
    predictor.reserve(request, first);
    REQUIRE(predictor.predict(state.positions, state.velocities, request, first));
    const long before = clothctl_test::allocations();
    const bool again = predictor.predict(state.positions, state.velocities, request, second);
    const long made = clothctl_test::allocations() - before;
    REQUIRE(again);
    if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
    CHECK(first.free_response == second.free_response);
    CHECK(first.impulse_response == second.impulse_response);
  }
}

TEST_CASE("linearised predictions obey the laws of predictors", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 30);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit, true);
  clothctl_test::check_predictor_laws(
      [&] {
        return LinearisedPredictor<MassSpringResponse<double>, double>{
            MassSpringResponse<double>(model)};
      },
      sheet.state, std::vector<int>{sheet.upper_left(), sheet.upper_right()},
      clothctl_test::PredictorLaws<double>());
  clothctl_test::PredictorLaws<double> loose;
  loose.tolerance = 1e-3;
  clothctl_test::check_predictor_laws(
      [&] {
        return LinearisedPredictor<MassSpringResponse<float>, double>{
            MassSpringResponse<float>(model)};
      },
      sheet.state, std::vector<int>{sheet.upper_left(), sheet.upper_right()}, loose);
  const MassSpring<float> single =
      MassSpring<float>::create(sheet.network.cast<float>(), MassSpringSettings<float>()).value();
  const ClothState<float> state{sheet.state.positions.cast<float>(),
                                sheet.state.velocities.cast<float>()};
  clothctl_test::PredictorLaws<float> rounded;
  rounded.tolerance = 2e-3f;
  clothctl_test::check_predictor_laws(
      [&] {
        return LinearisedPredictor<MassSpringResponse<float>, float>{
            MassSpringResponse<float>(single)};
      },
      state, std::vector<int>{sheet.upper_left(), sheet.upper_right()}, rounded);
}

TEST_CASE("the air's acceleration is what it adds to the momentum of a moving sheet", "[mpc]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6);
  const MassSpring<double> airy = sheet.model(Integration::LinearlyImplicit, true);
  LinearisedPredictor<MassSpringResponse<double>> predictor{MassSpringResponse<double>(airy)};
  WindowRequest<double> request = request_for(sheet, GripInput::Force, 3);
  randomise(request, 8, 0.0, true, false);
  WindowResponse<double> response;
  predictor.reserve(request, response);
  const Vector3<double> drift(0.4, -0.7, 0.2);
  ClothState<double> state = sheet.state;
  state.velocities.colwise() = drift;
  REQUIRE(predictor.predict(state.positions, state.velocities, request, response));
  const Points<double> resting = response.air;  // no drift asked for: as if it stood
  request.drift = drift.replicate(1, 3);
  REQUIRE(predictor.predict(state.positions, state.velocities, request, response));
  // All springs together move no centre of mass: what is left of it is gravity and air.
  const double dt = 1e-7;
  auto workspace = airy.make_workspace();
  ClothInput<double> input;
  input.wind = request.wind.col(0);
  REQUIRE(airy.step(state, input, dt, workspace).advanced);
  const VectorX<double>& mass = sheet.network.mass;
  const Vector3<double> rate = (state.velocities * mass / mass.sum() - drift) / dt;
  const Vector3<double> air = rate + Vector3<double>(0, 0, 9.81);
  CAPTURE(air.transpose());
  CHECK(air.norm() > 1.0);
  for (Index k = 0; k < 3; ++k)
    CHECK((Vector3<double>(response.air.col(k)) - air).norm() < 1e-4 * air.norm());
  CHECK((resting.col(0) - response.air.col(0)).norm() > 0.1);
  // Outer forces count too, as far as they do not bear the sheet from below.
  request.outer_force = Vector3<double>(1.5, -0.4, 3.0) * mass.transpose();
  const Points<double> before = response.air;
  REQUIRE(predictor.predict(sheet.state.positions, Points<double>(drift.replicate(1, 36)), request,
                            response));
  const Vector3<double> added = response.air.col(1) - before.col(1);
  CHECK((added - (1 - 3.0 / 9.81) * Vector3<double>(1.5, -0.4, 0.0)).norm() < 1e-9);
}
