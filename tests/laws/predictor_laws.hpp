#pragma once

// The laws that every Predictor must obey. Call check_predictor_laws(make, state, held, laws)
// inside a TEST_CASE, where `make()` returns a new predictor for the sheet in `state`.
//
//   finite     free and impulse responses are finite and have the sizes that the request implies
//   repeats    a new predictor gives the same bits, and so does one after reset
//   plan       if `linear`: changing the plan by δ changes the free response by Σ T_{k-j} δ_j and
//              leaves T unchanged
//   causal     an input of frame j changes no output before frame j
//   start      outputs begin at their measured position: |y_1 - y_0| is at most `first_move`
//   memory     predicting does not allocate after reserve

#include <cmath>
#include <random>
#include <vector>

#include "clothctl/concepts/prediction.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/prediction/window.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// The properties of a predictor, and the tolerances of the laws.
template <class Scalar>
struct PredictorLaws {
  /// Whether `free` is an affine function of the plan, with the impulse response as its slope.
  bool linear = true;
  /// Largest relative deviation from that function.
  Scalar tolerance = Scalar(1e-9);
  /// Frames of the window.
  clothctl::Index horizon = 6;
  /// Largest distance that an output moves in the first frame, m.
  Scalar first_step = Scalar(0.2);
  /// The inputs that it predicts.
  std::vector<clothctl::GripInput> kinds{clothctl::GripInput::Force, clothctl::GripInput::Pose};
};

/// Checks the laws, with forces on the vertices `held` and with their velocities as inputs.
template <class Make, class Scalar>
void check_predictor_laws(const Make& make, const clothctl::ClothState<Scalar>& state,
                          const std::vector<int>& held, const PredictorLaws<Scalar>& laws) {
  using namespace clothctl;
  using P = decltype(make());
  static_assert(Predictor<P, WindowRequest<Scalar>, WindowResponse<Scalar>>);
  std::mt19937 random(17);
  std::uniform_real_distribution<double> uniform(-0.3, 0.3);
  for (const GripInput kind : laws.kinds) {
    WindowRequest<Scalar> request;
    request.horizon = laws.horizon;
    request.dt = Scalar(0.02);
    request.kind = kind;
    request.held = held;
    request.outputs.add_point(0);
    request.outputs.add_centroid({1, 2, held.front()});
    request.held_outputs = 2;
    for (int v : held) request.outputs.add_point(v);
    request.plan.setZero(request.inputs(), laws.horizon);
    for (Index i = 0; i < request.plan.size(); ++i) request.plan(i) = Scalar(uniform(random));
    request.applied = request.plan.col(0);
    request.wind = Points<Scalar>::Constant(3, laws.horizon, Scalar(0.5));

    WindowResponse<Scalar> first, second;
    P predictor = make();
    predictor.reserve(request, first);
    first.plan = request.plan;  // the state in which a planner leaves it
    REQUIRE(predictor.predict(state.positions, state.velocities, request, first));
    const Index columns = request.inputs() * laws.horizon;
    REQUIRE((first.free_response.rows() == request.output_rows() &&
             first.free_response.cols() == laws.horizon));
    REQUIRE((first.impulse_response.rows() == request.output_rows() &&
             first.impulse_response.cols() == columns));
    CHECK((all_finite(first.free_response) && all_finite(first.impulse_response)));
    Points<Scalar> start(3, request.outputs.count());
    evaluate_features<Scalar>(request.outputs, state.positions, start);
    CHECK(
        (first.free_response.col(0) - Eigen::Map<const VectorX<Scalar>>(start.data(), start.size()))
            .cwiseAbs()
            .maxCoeff() < laws.first_step);

    P other = make();
    other.reserve(request, second);
    second.plan = request.plan;
    REQUIRE(other.predict(state.positions, state.velocities, request, second));
    CHECK((first.free_response == second.free_response &&
           first.impulse_response == second.impulse_response));
    predictor.reset();
    second.plan = request.plan;
    const long before = allocations();
    const bool again = predictor.predict(state.positions, state.velocities, request, second);
    const long made = allocations() - before;
    REQUIRE(again);
    if (allocation_counting_works()) CHECK(made == 0);
    CHECK((first.free_response == second.free_response &&
           first.impulse_response == second.impulse_response));

    const Index late = laws.horizon / 2;
    MatrixX<Scalar> expected = first.free_response;
    WindowRequest<Scalar> moved = request;
    for (Index j = late; j < laws.horizon; ++j) {
      for (Index i = 0; i < request.inputs(); ++i) moved.plan(i, j) += Scalar(uniform(random));
      for (Index k = j; k < laws.horizon; ++k) {
        expected.col(k) +=
            first.impulse_response.middleCols((k - j) * request.inputs(), request.inputs()) *
            (moved.plan.col(j) - request.plan.col(j));
      }
    }
    predictor.reset();
    second.plan = moved.plan;
    REQUIRE(predictor.predict(state.positions, state.velocities, moved, second));
    CHECK(second.free_response.leftCols(late) == first.free_response.leftCols(late));
    CHECK((second.free_response.col(late) - first.free_response.col(late)).norm() > Scalar(0));
    if (laws.linear) {
      CHECK((second.free_response - expected).norm() <=
            laws.tolerance * (expected.colwise() - expected.col(0)).norm());
      CHECK(second.impulse_response == first.impulse_response);
    }
  }
}

}  // namespace clothctl_test
