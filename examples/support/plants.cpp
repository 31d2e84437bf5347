#include "support/plants.hpp"

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mpc/linearised_predictor.hpp"
#include "clothctl/mpc/loose_plant.hpp"
#include "clothctl/mpc/rollout_predictor.hpp"

namespace program {

namespace {

clothctl::MassSpring<double> make_mass_spring(const Body& body, clothctl::Integration integration) {
  clothctl::MassSpringSettings<double> settings;
  settings.integration = integration;
  settings.drag = body.drag;
  settings.air = body.air;
  settings.limit_energy = false;  // the published step, which the planner predicts
  return must(clothctl::MassSpring<double>::create(body.network, settings));
}

}  // namespace

AnyPlant make_plant(const std::string& name, const Body& body, double drag) {
  Body changed = body;
  changed.drag = drag;
  if (name == "linear-implicit")
    return AnyPlant(make_mass_spring(changed, clothctl::Integration::LinearlyImplicit));
  if (name == "newton") return AnyPlant(make_mass_spring(changed, clothctl::Integration::Newton));
  clothctl::PositionBasedSettings<double> settings =
      name == "pbd" ? clothctl::PositionBasedSettings<double>::verlet()
                    : clothctl::PositionBasedSettings<double>();
  settings.drag = drag;
  settings.air = body.air;
  return AnyPlant(must(clothctl::PositionBased<double>::create(body.network, settings)));
}

std::string chosen_predictor(const Options& o, const Body& body) {
  if (o.predictor != "auto") return o.predictor;
  // In wind or with hard patch rows, rollouts can become unstable (docs/performance.md), so the
  // linearised predictor is used.
  const bool better =
      is_implicit(o.plant) && !body.air.enabled() && o.patch == "soft" && o.profile != "paper";
  return better ? "rollout" : "linearised";
}

AnyPredictor make_predictor(const Options& o, const Body& body,
                            clothctl::PlannerSettings<double>& settings) {
  using Response = clothctl::MassSpringResponse<float>;
  const bool implicit = is_implicit(o.plant);
  clothctl::ResponseSettings<float> response;
  clothctl::LinearisedPredictorSettings<double> exact;
  if (!implicit) {
    const auto loose = clothctl::loose_plant<double>(clothctl::WeightBearing::Elongation);
    response = loose.response;
    exact = loose.predictor;
    if (o.profile != "paper") {
      settings.weights.smooth = loose.planner.weights.smooth;
      settings.weights.anchor = loose.planner.weights.anchor;
    }
    if (o.plant == "pbd") {  // Verlet sheets are even softer
      response.scale.geometric = 0.003f;
      if (o.profile != "paper") settings.weights.anchor = 100;
    }
  }
  clothctl::MassSpring<double> model =
      make_mass_spring(body, clothctl::Integration::LinearlyImplicit);
  clothctl::LinearisedPredictor<Response, double> linearised(Response(model, response), exact);
  if (chosen_predictor(o, body) == "linearised") return AnyPredictor(std::move(linearised));
  if (o.profile != "paper") {
    const clothctl::PlannerSettings<double> calm = clothctl::PlannerSettings<double>::rollout();
    settings.weights.jerk = calm.weights.jerk;
    settings.weights.step = calm.weights.step;
    settings.max_change = calm.max_change;
  }
  clothctl::RolloutSettings rollout;
  if (o.plant != "newton") rollout.newton_steps = 0;
  return AnyPredictor(clothctl::RolloutPredictor<clothctl::MassSpring<double>,
                                                 clothctl::LinearisedPredictor<Response, double>>(
      std::move(model), std::move(linearised), rollout));
}

}  // namespace program
