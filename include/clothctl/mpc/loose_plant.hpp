#pragma once

// Settings that belong together for a plant that is not the predictor: a cloth of another engine, a
// position-based cloth, a real one. Feedback through a model that is slightly wrong can pump energy
// into a lightly damped sheet; a strong hand anchor removes the energy. With this profile, the
// anchor grows stronger while predictions over half a window fail, and takes up constant errors.
// The features of explicit cloths of 9×9 to 17×17 vertices follow a swaying target for ten minutes
// with a mean error of 2 mm (docs/planner.md).

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/mpc/planner_settings.hpp"
#include "clothctl/prediction/identify.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// What carries the weight of the plant's cloth.
enum class WeightBearing {
  /// Tension, as in springs and in fabric.
  Tension,
  /// Elongation that the solver leaves, as in substepped position-based cloth: far more stretch
  /// than its tension explains.
  Elongation
};

/// Settings of planner, predictor and response for a plant that is not the predictor.
template <RealScalar Scalar>
struct LoosePlantProfile {
  /// For the Planner: pose input, high weights on smooth hands and on the anchor. Planned forces
  /// (GripInput::Force) follow about ten times worse.
  PlannerSettings<Scalar> planner = {};
  /// For the LinearisedPredictor.
  LinearisedPredictorSettings<Scalar> predictor = {};
  /// For its MassSpringResponse.
  ResponseSettings<float> response = {};
};

/// Returns the profile for a kind of plant.
template <RealScalar Scalar>
LoosePlantProfile<Scalar> loose_plant(WeightBearing weight = WeightBearing::Tension) {
  LoosePlantProfile<Scalar> profile;
  profile.planner.input = GripInput::Pose;
  profile.planner.weights.smooth = Scalar(10);
  profile.planner.weights.anchor = Scalar(100);
  profile.planner.least_agreement = Scalar(0.9);
  profile.planner.offset_time = Scalar(5);
  if (weight == WeightBearing::Elongation) {
    profile.predictor.measured_force = Scalar(1);
    profile.response.scale.axial = 0.2f;
    profile.response.scale.geometric = 0.04f;
  }
  return profile;
}

/// Returns the profile for a plant whose response was identified (prediction/identify.hpp).
template <RealScalar Scalar>
LoosePlantProfile<Scalar> loose_plant(const IdentifiedResponse<Scalar>& identified) {
  LoosePlantProfile<Scalar> profile = loose_plant<Scalar>();
  profile.predictor = identified.predictor;
  profile.response = identified.response;
  return profile;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
