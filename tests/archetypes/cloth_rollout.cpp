// The archetype satisfies its concept, has nothing else, obeys the laws, and works in a
// RolloutPredictor.

#include "archetypes/cloth_rollout.hpp"

#include <type_traits>

#include "archetypes/cloth.hpp"
#include "archetypes/predictor.hpp"
#include "clothctl/prediction/rollout_predictor.hpp"
#include "laws/cloth_rollout_laws.hpp"
#include "laws/predictor_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ClothRolloutArchetype;
using clothctl_test::PredictorArchetype;

static_assert(ClothRollout<ClothRolloutArchetype<float>, float> &&
              ClothRollout<ClothRolloutArchetype<double>, double>);
static_assert(!ClothRollout<ClothRolloutArchetype<float>, double>);
static_assert(!ClothRollout<clothctl_test::ModelArchetype<double>> && !ClothRollout<int> &&
              !ClothRollout<void*>);
static_assert(!std::is_copy_constructible_v<ClothRolloutArchetype<double>> &&
              !std::is_default_constructible_v<ClothRolloutArchetype<double>> &&
              !std::is_copy_constructible_v<ClothRolloutArchetype<double>::Scratch>);

namespace {

template <class S>
ClothState<S> row_of_four() {
  ClothState<S> state{Points<S>::Zero(3, 4), Points<S>::Constant(3, 4, S(0.1))};
  for (Index i = 0; i < 4; ++i) state.positions(0, i) = S(0.1) * S(i);
  return state;
}

template <class S>
using Rolling = RolloutPredictor<ClothRolloutArchetype<S>, PredictorArchetype<S>>;

}  // namespace

TEMPLATE_TEST_CASE("the archetype of a rollout model obeys the laws", "[archetypes]", float,
                   double) {
  clothctl_test::ClothRolloutLaws<TestType> laws;
  laws.tolerance = std::is_same_v<TestType, float> ? TestType(1e-4) : TestType(1e-12);
  clothctl_test::check_cloth_rollout_laws(ClothRolloutArchetype<TestType>(4),
                                          row_of_four<TestType>(), {3, 1}, laws);
}

TEMPLATE_TEST_CASE("a rollout predictor needs no more from its model than the concept names",
                   "[archetypes]", float, double) {
  using S = TestType;
  clothctl_test::PredictorLaws<S> laws;
  laws.linear = false;
  clothctl_test::check_predictor_laws(
      [] { return Rolling<S>(ClothRolloutArchetype<S>(4), PredictorArchetype<S>(1)); },
      row_of_four<S>(), {3}, laws);
}

TEST_CASE("the free response with the archetype is its free fall", "[archetypes]") {
  Rolling<double> predictor(ClothRolloutArchetype<double>(4), PredictorArchetype<double>(1));
  WindowRequest<double> request;
  request.horizon = 5;
  request.dt = 0.02;
  request.kind = GripInput::Pose;
  request.held = {3};
  request.outputs.add_point(0);
  request.outputs.add_point(3);
  request.held_outputs = 1;
  request.plan.setConstant(3, 5, 0.5);
  request.applied.setZero(3);
  request.wind.setZero(3, 5);
  WindowResponse<double> response;
  predictor.reserve(request, response);
  response.plan = request.plan;
  const ClothState<double> state = row_of_four<double>();
  REQUIRE(predictor.predict(state.positions, state.velocities, request, response));
  for (int k = 1; k <= 5; ++k) {
    // Implicit Euler: x_k = x_0 + k h v + k (k + 1)/2 h² g. The hand moves along its path.
    const double fall = 9.81 * 0.0002 * k * (k + 1);
    const Vector3<double> free = response.free_response.col(k - 1).head<3>();
    const Vector3<double> hand = response.free_response.col(k - 1).tail<3>();
    const Vector3<double> moved = Vector3<double>::Constant(0.1 * 0.02 * k);
    CHECK((free - moved - Vector3<double>(0, 0, -fall)).norm() <= 1e-13);
    CHECK((hand - state.positions.col(3) - Vector3<double>::Constant(0.01 * k)).norm() <= 1e-13);
  }
}
