// The profile for plants that differ from the predictor.

#include "clothctl/mpc/loose_plant.hpp"

#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("the profile loose_plant is valid and holds the hands firmly", "[mpc]", float,
                   double) {
  using S = TestType;
  for (const WeightBearing weight : {WeightBearing::Tension, WeightBearing::Elongation}) {
    const LoosePlantProfile<S> profile = loose_plant<S>(weight);
    CHECK(profile.planner.validate() == "");
    CHECK(profile.predictor.validate() == "");
    CHECK(profile.planner.input == GripInput::Pose);
    CHECK(profile.planner.weights.anchor == S(100));
    CHECK(profile.planner.weights.smooth == S(10));
    CHECK(profile.planner.least_agreement == S(0.9));
    CHECK(PlannerSettings<S>().least_agreement == S(0));
    CHECK(profile.planner.offset_time == S(5));
    CHECK(PlannerSettings<S>().offset_time == S(0));
    CHECK(profile.planner.weights.anchor < profile.planner.most_anchor);
    CHECK(profile.planner.weights.feature == PlannerSettings<S>().weights.feature);
  }
}

TEST_CASE("a sheet stretched by its own weight is predicted with less tension", "[mpc]") {
  const auto tension = loose_plant<double>(),
             elongation = loose_plant<double>(WeightBearing::Elongation);
  CHECK(tension.response.scale.geometric == 1.0f);
  CHECK(tension.response.scale.axial == 1.0f);
  CHECK(tension.predictor.measured_force == 0.0);
  CHECK(elongation.response.scale.geometric < 0.1f);
  CHECK(elongation.response.scale.axial < 1.0f);
  CHECK(elongation.predictor.measured_force == 1.0);
}

TEST_CASE("an identified response replaces what is set by hand", "[mpc]") {
  IdentifiedResponse<double> found;
  found.response.scale.axial = 0.3f;
  found.response.scale.geometric = 0.1f;
  found.predictor.measured_force = 0.9;
  const LoosePlantProfile<double> profile = loose_plant(found);
  CHECK(profile.response.scale.axial == 0.3f);
  CHECK(profile.response.scale.geometric == 0.1f);
  CHECK(profile.predictor.measured_force == 0.9);
  CHECK(profile.planner.weights.anchor == loose_plant<double>().planner.weights.anchor);
}
