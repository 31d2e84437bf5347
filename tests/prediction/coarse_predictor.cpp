// Predictions of a fine sheet by a coarse one: exact where both are the same mesh, near the fine
// sheet's own prediction elsewhere, and good enough to track with.

#include "clothctl/prediction/coarse_predictor.hpp"

#include "clothctl/cloth/mass_spring_rollout.hpp"
#include "laws/predictor_laws.hpp"
#include "mpc/planner_loops.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::AsyncTarget;
using clothctl_test::HangingSheet;
using clothctl_test::LoopStats;

namespace {

using Exact = LinearisedPredictor<MassSpringResponse<double>, double>;
using Frozen = clothctl_test::FrozenPredictor;
using Fast = RolloutPredictor<MassSpringRollout<double>, Frozen>;

WindowRequest<double> request_for(const HangingSheet& sheet, GripInput kind, int patch,
                                  Index horizon) {
  WindowRequest<double> request;
  request.horizon = horizon;
  request.dt = clothctl_test::kFrame;
  request.kind = kind;
  for (int side : {0, 1}) {
    for (int v : sheet.corner_patch(side, patch)) request.held.push_back(v);
  }
  request.outputs.add_point(sheet.lower_left());
  request.outputs.add_centroid({sheet.lower_right(), sheet.grid.vertex(1, 1)});
  request.held_outputs = 2;
  for (int v : request.held) request.outputs.add_point(v);
  request.plan.setZero(request.inputs(), horizon);
  request.path.setZero(request.inputs(), horizon);
  request.applied.setZero(request.inputs());
  request.wind.setZero(3, horizon);
  request.wind.row(1).setLinSpaced(0.0, 2.0);
  const double load = sheet.gravity_load()[2] / static_cast<double>(request.held.size());
  for (Index k = 0; k < horizon; ++k) {
    for (Index j = 0; 3 * j < request.inputs(); ++j) {
      const double side = 3 * j < request.inputs() / 2 ? 1.0 : -0.5;  // grips move as one
      request.plan(3 * j, k) = 0.1 * side * std::sin(0.3 * static_cast<double>(k));
      if (kind == GripInput::Force) request.plan(3 * j + 2, k) = load;
    }
  }
  return request;
}

HangingSheet sheet_of(int n) { return clothctl_test::hanging_sheet(n, 1, 60); }

CoarsePredictor<Exact> exact_coarse(const HangingSheet& fine, const HangingSheet& coarse) {
  return {sample_grids(fine.grid, coarse.grid),
          Exact(MassSpringResponse<double>(coarse.model(Integration::Newton, true)))};
}

double largest(const MatrixX<double>& m) { return m.cwiseAbs().maxCoeff(); }

}  // namespace

TEST_CASE("on its own mesh, a coarse prediction is the inner one", "[mpc]") {
  const HangingSheet sheet = sheet_of(7);
  const ClothState<double> state = clothctl_test::shaken(sheet.state, 3);
  for (const GripInput kind : {GripInput::Force, GripInput::Pose}) {
    for (const int patch : {1, 2}) {
      CAPTURE(patch);
      WindowRequest<double> request = request_for(sheet, kind, patch, 8);
      request.outer_force = Points<double>::Constant(3, 49, 0.001);
      CoarsePredictor<Exact> coarse = exact_coarse(sheet, sheet);
      Exact inner{MassSpringResponse<double>(sheet.model(Integration::Newton, true))};
      WindowResponse<double> a, b;
      coarse.reserve(request, a);
      inner.reserve(request, b);
      REQUIRE(coarse.predict(state.positions, state.velocities, request, a));
      REQUIRE(inner.predict(state.positions, state.velocities, request, b));
      CHECK(largest(a.impulse_response - b.impulse_response) < 1e-14);
      CHECK(largest(a.free_response - b.free_response) < 1e-14);
      CHECK(a.plan == b.plan);
    }
  }
}

TEST_CASE("on its own mesh, features respond as the inner prediction says frame by frame",
          "[mpc]") {
  const HangingSheet sheet = sheet_of(7);
  const ClothState<double> state = clothctl_test::shaken(sheet.state, 3);
  const auto made = [&] {
    return Fast(MassSpringRollout<double>(sheet.model(Integration::Newton, true)),
                Frozen(MassSpringResponse<float>(sheet.model(Integration::Newton, true))));
  };
  for (const GripInput kind : {GripInput::Force, GripInput::Pose}) {
    for (const int patch : {1, 2}) {
      CAPTURE(patch);
      const WindowRequest<double> request = request_for(sheet, kind, patch, 8);
      CoarsePredictor<Fast> coarse(sample_grids(sheet.grid, sheet.grid), made());
      Fast inner = made();
      WindowResponse<double> a, b;
      coarse.reserve(request, a);
      inner.reserve(request, b);
      a.plan = b.plan = request.plan;
      REQUIRE(coarse.predict(state.positions, state.velocities, request, a));
      REQUIRE(inner.predict(state.positions, state.velocities, request, b));
      REQUIRE(a.has_jacobian);
      REQUIRE(b.has_jacobian);
      CHECK(largest(a.jacobian - b.jacobian) < 1e-12 * largest(b.jacobian));
    }
  }
}

TEST_CASE("held vertices share the response to their coarse vertex", "[mpc]") {
  const HangingSheet fine = sheet_of(13), coarse = sheet_of(4);
  const SheetSampling<double> sampling = sample_grids(fine.grid, coarse.grid);
  const MassSpring<double> model = coarse.model(Integration::Newton);
  for (const GripInput kind : {GripInput::Force, GripInput::Pose}) {
    // The four vertices at a corner stand for one coarse vertex.
    WindowRequest<double> request = request_for(fine, kind, 2, 5);
    CoarsePredictor<Fast> predictor(
        sampling, Fast(MassSpringRollout<double>(model), Frozen(MassSpringResponse<float>(model))));
    WindowResponse<double> response;
    predictor.reserve(request, response);
    response.plan = request.plan;
    REQUIRE(predictor.predict(fine.state.positions, fine.state.velocities, request, response));
    REQUIRE(response.has_jacobian);
    WindowRequest<double> single = request_for(coarse, kind, 1, 5);
    single.outputs = {};
    for (Index i = 0; i < request.held_outputs; ++i) {
      std::vector<PointFeatures<double>::Term> terms;
      request.outputs.for_each_term(i, [&](int vertex, const double& weight) {
        sampling.fine_from_coarse.for_each_term(vertex, [&](int c, const double& part) {
          terms.push_back({c, weight * part});
        });
      });
      single.outputs.add_sum(std::move(terms));
    }
    for (const int v : single.held) single.outputs.add_point(v);
    // As the hands move, or as the forces of all vertices of a coarse one together.
    const double count = static_cast<double>(request.held.size() / single.held.size());
    for (Index j = 0; j < 2; ++j) {
      single.plan.middleRows<3>(3 * j).setZero();
      for (Index i = 0; i < static_cast<Index>(count); ++i)
        single.plan.middleRows<3>(3 * j) +=
            request.plan.middleRows<3>(3 * (static_cast<Index>(count) * j + i)) /
            (kind == GripInput::Pose ? count : 1.0);
    }
    Points<double> x(3, coarse.state.positions.cols()), v = x;
    evaluate_features<double>(sampling.coarse_from_fine, fine.state.positions, x);
    evaluate_features<double>(sampling.coarse_from_fine, fine.state.velocities, v);
    Fast inner{MassSpringRollout<double>(model), Frozen(MassSpringResponse<float>(model))};
    WindowResponse<double> expected;
    inner.reserve(single, expected);
    expected.plan = single.plan;
    REQUIRE(inner.predict(x, v, single, expected));
    const double share = kind == GripInput::Pose ? 1 / count : 1.0;
    for (Index k = 0; k < request.horizon; ++k) {
      for (Index i = 0; 3 * i < request.inputs(); ++i) {
        const Index from = i / static_cast<Index>(count);
        const auto found = response.jacobian.middleCols<3>(k * request.inputs() + 3 * i);
        const auto wanted = expected.jacobian.middleCols<3>(k * single.inputs() + 3 * from);
        CHECK((found - share * wanted).norm() < 1e-6 * largest(expected.jacobian));
      }
    }
  }
}

TEST_CASE("a coarse sheet carries its share of every support", "[mpc]") {
  const HangingSheet fine = sheet_of(9), coarse = sheet_of(4);
  WindowRequest<double> carried = request_for(fine, GripInput::Pose, 1, 6), pushed = carried;
  using V = Vector3<double>;
  carried.supports = {{3, V(0, 0, 1), V(0.001, 0, 0.02), 1e-3},
                      {12, V(0, 0.6, 0.8), V(0, 0, 0.03), 2e-3},
                      {40, V(0, 0, 1), V(0.01, 0, -0.01), 1e-3},  // pulls
                      {41, V(0, 0, 1), V(0.01, 0, 0), 1e-3}};     // friction alone
  pushed.outer_force.setZero(3, 81);
  for (const auto& support : carried.supports)
    pushed.outer_force.col(support.vertex) = support.force;
  CoarsePredictor<Exact> predictor = exact_coarse(fine, coarse);
  WindowResponse<double> a, b;
  predictor.reserve(carried, a);
  predictor.reserve(pushed, b);
  const ClothState<double>& state = fine.state;
  const long before = clothctl_test::allocations();
  const bool predicted = predictor.predict(state.positions, state.velocities, carried, a);
  const long taken = clothctl_test::allocations() - before;
  REQUIRE(predicted);
  if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
  REQUIRE(predictor.predict(state.positions, state.velocities, pushed, b));
  CHECK(largest(a.free_response - b.free_response) < 1e-13);
  carried.supports[0].vertex = 81;
  CHECK_FALSE(predictor.predict(state.positions, state.velocities, carried, a));
}

TEST_CASE("a coarse prediction comes nearer to that of the fine sheet with its mesh", "[mpc]") {
  const HangingSheet fine = sheet_of(25);
  WindowRequest<double> request = request_for(fine, GripInput::Pose, 2, 6);
  request.wind.setZero();
  Exact own{MassSpringResponse<double>(fine.model(Integration::Newton, true))};
  WindowResponse<double> exact;
  own.reserve(request, exact);
  REQUIRE(own.predict(fine.state.positions, fine.state.velocities, request, exact));
  double last = 1;
  for (const int n : {4, 7, 13, 25}) {
    CAPTURE(n);
    CoarsePredictor<Exact> predictor = exact_coarse(fine, sheet_of(n));
    WindowResponse<double> response;
    predictor.reserve(request, response);
    REQUIRE(predictor.predict(fine.state.positions, fine.state.velocities, request, response));
    const MatrixX<double> error = response.free_response - exact.free_response;
    CHECK(largest(error.bottomRows(3 * 8)) < 1e-12);  // held vertices move as prescribed
    CHECK(largest(error.topRows(6)) < 0.8 * last);
    last = largest(error.topRows(6));
  }
  CHECK(last < 1e-12);
}

TEST_CASE("several held vertices of one coarse vertex share its motion and force", "[mpc]") {
  const HangingSheet fine = sheet_of(13), coarse = sheet_of(4);
  for (const GripInput kind : {GripInput::Force, GripInput::Pose}) {
    WindowRequest<double> request = request_for(fine, kind, 2, 5);
    CoarsePredictor<Exact> predictor = exact_coarse(fine, coarse);
    WindowResponse<double> response, moved;
    predictor.reserve(request, response);
    predictor.reserve(request, moved);
    REQUIRE(predictor.predict(fine.state.positions, fine.state.velocities, request, response));
    // Linear: what the impulse response says of a change of one vertex is what comes.
    WindowRequest<double> other = request;
    other.plan(4, 1) += 0.01;
    REQUIRE(predictor.predict(fine.state.positions, fine.state.velocities, other, moved));
    for (Index k = 0; k < 5; ++k) {
      VectorX<double> expected = response.free_response.col(k);
      if (1 <= k) expected += 0.01 * response.impulse_response.col((k - 1) * request.inputs() + 4);
      CHECK((moved.free_response.col(k) - expected).cwiseAbs().maxCoeff() < 1e-12);
    }
    // The four vertices of a grip belong to one coarse vertex: they act alike on the features.
    CHECK(largest(response.impulse_response.block(0, 0, 6, 3) -
                  response.impulse_response.block(0, 9, 6, 3)) == 0);
  }
}

TEST_CASE("coarse predictions obey the laws of predictors", "[mpc]") {
  const HangingSheet fine = sheet_of(9), coarse = sheet_of(5);
  const std::vector<int> held{fine.upper_left(), fine.upper_right()};
  clothctl_test::check_predictor_laws([&] { return exact_coarse(fine, coarse); }, fine.state, held,
                                      clothctl_test::PredictorLaws<double>());
  clothctl_test::PredictorLaws<double> laws;
  laws.linear = false;
  clothctl_test::check_predictor_laws(
      [&] {
        const MassSpring<double> model = coarse.model(Integration::Newton, true);
        return CoarsePredictor<Fast>(
            sample_grids(fine.grid, coarse.grid),
            Fast(MassSpringRollout<double>(model, {CoarseFactors::fitted()}),
                 Frozen(MassSpringResponse<float>(model)), RolloutSettings{1, 0.0, 2}));
      },
      fine.state, held, laws);
}

TEST_CASE("a sheet of another size is refused", "[mpc]") {
  const HangingSheet fine = sheet_of(9), coarse = sheet_of(5);
  CoarsePredictor<Exact> predictor = exact_coarse(fine, coarse);
  const WindowRequest<double> request = request_for(fine, GripInput::Pose, 1, 4);
  WindowResponse<double> response;
  predictor.reserve(request, response);
  CHECK(predictor.vertex_count() == 81);
  CHECK_FALSE(
      predictor.predict(coarse.state.positions, coarse.state.velocities, request, response));
  auto planner = Planner<CoarsePredictor<Exact>>::create(
      clothctl_test::corner_setup(coarse), clothctl_test::corner_settings(coarse, GripInput::Pose),
      predictor, coarse.state.positions);
  REQUIRE_FALSE(planner.has_value());
  CHECK(planner.error() == "the predictor is made for 81 vertices, the start positions have 25");
}

TEST_CASE("a coarse rollout tracks a finer sheet", "[mpc]") {
  // Without rollouts, errors are between 4 and 35 mm, by the compiler's flags.
  const HangingSheet fine = clothctl_test::hanging_sheet(25), coarse = sheet_of(13);
  const int frames = clothctl_test::trials(60, 200);
  const AsyncTarget target(fine, 0.75);
  const MassSpring<double> model = coarse.model(Integration::Newton);
  using P = CoarsePredictor<Fast>;
  for (const GripInput input : {GripInput::Pose, GripInput::Force}) {
    Fast fast(MassSpringRollout<double>(model, {CoarseFactors::fitted()}),
              Frozen(MassSpringResponse<float>(model)), RolloutSettings{1, 0.0, 5});
    auto planner =
        Planner<P>::create(
            clothctl_test::corner_setup(fine),
            clothctl_test::corner_settings(fine, input, 20, PlannerSettings<double>::rollout()),
            P(sample_grids(fine.grid, coarse.grid), std::move(fast)), fine.state.positions)
            .value();
    auto plant = clothctl_test::sheet_plant(fine, Integration::Newton);
    const LoopStats rolled =
        clothctl_test::run_loop(planner, plant, frames, clothctl_test::corners(fine), target,
                                clothctl_test::NoWind(), clothctl_test::NoWatch());
    CHECK(rolled.failures == 0);
    CHECK(rolled.mean_error < (frames > 60 ? 0.015 : 0.01));
  }
}
