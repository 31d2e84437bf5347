// The archetype satisfies its concept, has nothing else, obeys the laws, and works in a planner.

#include "archetypes/predictor.hpp"

#include <type_traits>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"
#include "clothctl/prediction/rollout_predictor.hpp"
#include "laws/predictor_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::PredictorArchetype;

template <class P, class S = double>
inline constexpr bool kPredicts = Predictor<P, WindowRequest<S>, WindowResponse<S>>;

static_assert(kPredicts<PredictorArchetype<float>, float> && kPredicts<PredictorArchetype<double>>);
static_assert(kPredicts<LinearisedPredictor<MassSpringResponse<float>, double>> &&
              kPredicts<LinearisedPredictor<MassSpringResponse<float>, float>, float>);
static_assert(kPredicts<RolloutPredictor<MassSpring<double>,
                                         LinearisedPredictor<MassSpringResponse<float>, double>>>);
static_assert(!kPredicts<int> && !kPredicts<MassSpring<double>> &&
              !kPredicts<PredictorArchetype<float>, double>);
static_assert(!std::is_copy_constructible_v<PredictorArchetype<double>> &&
              !std::is_default_constructible_v<PredictorArchetype<double>>);

namespace {

template <class S>
ClothState<S> row_of_four() {
  ClothState<S> state{Points<S>::Zero(3, 4), Points<S>::Zero(3, 4)};
  for (Index i = 0; i < 4; ++i) state.positions(0, i) = S(0.1) * S(i);
  return state;
}

}  // namespace

TEMPLATE_TEST_CASE("the archetype of a predictor obeys the laws", "[archetypes]", float, double) {
  clothctl_test::PredictorLaws<TestType> laws;
  laws.tolerance = std::is_same_v<TestType, float> ? TestType(1e-3) : TestType(1e-9);
  clothctl_test::check_predictor_laws([] { return PredictorArchetype<TestType>(1); },
                                      row_of_four<TestType>(), {3}, laws);
}

TEMPLATE_TEST_CASE("a planner needs no more from its predictor than the concept names",
                   "[archetypes]", float, double) {
  using S = TestType;
  PlannerSetup<S> setup;
  setup.features.add_point(0);
  setup.grips.push_back(make_pinch<S>({3}, S(0.5), S(5)));
  const ClothState<S> state = row_of_four<S>();
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    PlannerSettings<S> settings;
    settings.horizon = 4;
    settings.input = input;
    auto made = Planner<PredictorArchetype<S>>::create(setup, settings, PredictorArchetype<S>(1),
                                                       state.positions);
    REQUIRE(made.has_value());
    auto planner = std::move(made).value();
    PlanResult<S> result = planner.make_result();
    const auto target = [](Index, S) { return Vector3<S>(S(0.001), S(0), S(0)); };
    CHECK(planner.plan(state.positions, state.velocities, S(0), target, result) ==
          PlanStatus::Planned);
    CHECK(all_finite(result.plan));
  }
}
