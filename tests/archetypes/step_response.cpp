// The archetype of StepResponse satisfies its concept, obeys its laws and works in the linearised
// predictor. The prediction is compared with steps of the two masses computed here.

#include "archetypes/step_response.hpp"

#include <random>
#include <type_traits>

#include "clothctl/prediction/linearised_predictor.hpp"
#include "laws/step_response_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::StepResponseArchetype;

static_assert(StepResponse<StepResponseArchetype<float>> &&
              StepResponse<StepResponseArchetype<double>>);
static_assert(!std::is_copy_constructible_v<StepResponseArchetype<double>>);

TEMPLATE_TEST_CASE("the archetype of a step response obeys the laws", "[archetypes]", float,
                   double) {
  using S = TestType;
  StepResponseArchetype<S> response;
  Points<S> x(3, 2), v(3, 2);
  x << S(0.1), S(0.4), S(0), S(0.2), S(-0.3), S(-0.5);
  v << S(1), S(0.3), S(-0.2), S(0), S(0.4), S(0.1);
  const S tolerance = std::is_same_v<S, float> ? S(1e-5) : S(1e-13);
  for (const std::vector<int>& driven : {std::vector<int>{}, std::vector<int>{1}}) {
    clothctl_test::check_step_response_laws<StepResponseArchetype<S>>(
        response, x, v, {S(1), S(0), S(2)}, S(0.05), driven, tolerance);
  }
}

TEST_CASE("the linearised predictor predicts the archetype's steps exactly", "[archetypes]") {
  for (const GripInput kind : {GripInput::Force, GripInput::Pose}) {
    CAPTURE(static_cast<int>(kind));
    WindowRequest<double> request;
    request.horizon = 6;
    request.dt = 0.05;
    request.kind = kind;
    request.held = {1};
    request.outputs.add_point(0);
    request.outputs.add_point(1);
    request.held_outputs = 1;
    std::mt19937 random(4);
    std::normal_distribution<double> normal;
    request.plan = MatrixX<double>::NullaryExpr(3, 6, [&] { return normal(random); });
    request.applied = VectorX<double>::Zero(3);
    request.wind = Points<double>::NullaryExpr(3, 6, [&] { return normal(random); });
    Points<double> x(3, 2), v(3, 2);
    x << 0.1, 0.4, 0.0, 0.2, -0.3, -0.5;
    v << 1.0, 0.3, -0.2, 0.0, 0.4, 0.1;
    LinearisedPredictor<StepResponseArchetype<double>> predictor{StepResponseArchetype<double>()};
    WindowResponse<double> window;
    predictor.reserve(request, window);
    REQUIRE(predictor.predict(x, v, request, window));

    // A v⁺ = M v + h (f - K q + u + C (w - w_1)), q⁺ = q + h v⁺.
    StepResponseArchetype<double> own;
    const std::vector<int> driven =
        kind == GripInput::Pose ? std::vector<int>{1} : std::vector<int>{};
    REQUIRE(own.linearise(x, v, request.wind.col(0), request.dt, driven) == 1);
    Points<double> q = Points<double>::Zero(3, 2), speed = v;
    const double h = request.dt;
    for (Index k = 0; k < 6; ++k) {
      Lanes<double, 1> row(1, 6), stiff(1, 6), coupled(1, 6);
      Eigen::Map<Points<double>>(row.data(), 3, 2) = q;
      own.multiply(row, stiff, coupled);
      Points<double> f = own.force() - Eigen::Map<Points<double>>(stiff.data(), 3, 2);
      if (kind == GripInput::Force) f.col(1) += request.plan.col(k);
      own.add_wind_force(request.wind.col(k) - request.wind.col(0), f);
      Points<double> told = Points<double>::Zero(3, 2);
      if (kind == GripInput::Pose) told.col(1) = request.plan.col(k);
      Eigen::Map<Points<double>>(row.data(), 3, 2) = told;
      own.multiply(row, stiff, coupled);
      for (Index i = 0; i < 2; ++i) {
        const bool held = own.held()[static_cast<std::size_t>(i)] != 0;
        for (Index c = 0; c < 3; ++c) {
          const double rhs = own.mass()[i] * speed(c, i) + h * f(c, i) - coupled(0, 3 * i + c);
          row(0, 3 * i + c) = held ? 0.0 : rhs;
        }
      }
      own.solve(row);
      speed = told + Eigen::Map<Points<double>>(row.data(), 3, 2);
      q += h * speed;
      for (Index i = 0; i < 2; ++i) {
        const Vector3<double> expected = x.col(i) + q.col(i);
        CHECK((window.free_response.col(k).segment<3>(3 * i) - expected).cwiseAbs().maxCoeff() <=
              1e-12);
      }
    }
  }
}
