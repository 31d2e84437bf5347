#include "support/plants.hpp"

#include <algorithm>

#include "bring_your_own/cloth_plant.hpp"
#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/mpc/loose_plant.hpp"
#include "clothctl/prediction/coarse_predictor.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"
#include "clothctl/prediction/rollout_predictor.hpp"
#include "clothctl/prediction/simulator_predictor.hpp"
#include "support/second_thread.hpp"

namespace program {

namespace {

/// The foreign cloth, which can be set to a state.
class ForeignPlant {
 public:
  ForeignPlant(const clothctl::SpringNetwork<double>& network, double drag)
      : network_(network), drag_(static_cast<float>(drag)) {
    set_state({Points::Zero(3, network.vertex_count()), Points::Zero(3, network.vertex_count())});
  }
  const Points& positions() const { return x_; }
  const Points& velocities() const { return v_; }
  void set_state(const clothctl::ClothState<double>& state) {
    cloth_ = game::make_cloth(network_, state.positions);
    cloth_.drag = drag_;
    for (std::size_t i = 0; i < cloth_.v.size(); ++i)
      cloth_.v[i] = game::y_up(state.velocities.col(static_cast<Index>(i)));
    measure();
  }
  void apply(const clothctl::ClothInput<double>& input) { Traits::apply(cloth_, input); }
  clothctl::StepReport<double> advance(double dt) {
    const clothctl::StepReport<double> report = Traits::advance(cloth_, dt);
    measure();
    return report;
  }

 private:
  using Traits = clothctl::plant_traits<game::Cloth>;
  void measure() {
    x_ = Traits::positions(cloth_);
    v_ = Traits::velocities(cloth_);
  }

  clothctl::SpringNetwork<double> network_;
  game::Cloth cloth_;
  float drag_;
  Points x_, v_;
};

using Response = clothctl::MassSpringResponse<float>;
using Linearised = clothctl::LinearisedPredictor<Response, double>;

/// Rolls out a model beside the linearised prediction, on one thread or two.
template <class Model>
clothctl::RolloutPredictor<Model, Linearised> rolled(Model model, Linearised linearised,
                                                     clothctl::RolloutSettings settings,
                                                     bool two_threads) {
  clothctl::RolloutPredictor<Model, Linearised> predictor(std::move(model), std::move(linearised),
                                                          settings);
  if (two_threads) predictor.set_executor(clothctl::ExecutorRef(second_thread()));
  return predictor;
}

/// Returns whether the forces of patches on an implicit plant can follow planned poses. To plan
/// them takes an unknown for each generator of each vertex.
bool may_follow_poses(const Options& o) {
  return o.grip == "force" && is_implicit(o.plant) && 1 < o.patch_size && !o.hands && !o.measured &&
         !(0 < o.unknown) && o.profile != "paper";
}

/// Weights for predictions that roll out the sheet of a body. `step`: the weight of that name.
void damp(const Options& o, const Body& body, double step,
          clothctl::PlannerSettings<double>& settings) {
  if (o.profile == "paper") return;
  const auto calm = clothctl::PlannerSettings<double>::rollout(step);
  // What predicts the plant's own mesh needs less of the anchor. Fingers slip, and are late.
  const bool same = is_implicit(o.plant) && !body.coarse && !o.hands;
  settings.weights.anchor = same ? 1.5 : calm.weights.anchor;
  // Weak, it lets hands swing where targets are further apart than the sheet lets them. Strong, it
  // makes forces on a sheet that is not the model late.
  const bool poses = settings.input == clothctl::GripInput::Pose;
  if (!o.hands) settings.weights.smooth = same || poses ? 0.2 : calm.weights.smooth;
  settings.weights.jerk = calm.weights.jerk;
  settings.weights.step = calm.weights.step;
  settings.max_change = calm.max_change;
}

/// Predicts a plant by its own steps alone.
AnyPredictor make_simulator(const Options& o, const Body& body,
                            clothctl::PlannerSettings<double>& settings) {
  if (!is_implicit(o.plant) && !is_position_based(o.plant))
    refuse("--predictor simulator: the plant " + o.plant + " is no cloth model");
  if (body.coarse) refuse("--predictor simulator: cannot be combined with a coarse --model");
  if (follows_poses(o) && 1 < o.patch_size && is_position_based(o.plant))
    refuse("--patch-size: " + std::to_string(o.patch_size) +
           " cannot be combined with --predictor simulator and --grip force");
  if (settings.input == clothctl::GripInput::Force)
    refuse("--predictor simulator: predicts positions; no forces follow them with these options");
  damp(o, body, 0.01, settings);
  const auto simulated = [&](auto model) {
    clothctl::SimulatorPredictor<decltype(model)> predictor(std::move(model));
    if (o.second_thread) predictor.set_executor(clothctl::ExecutorRef(second_thread()));
    return AnyPredictor(std::move(predictor));
  };
  if (!is_position_based(o.plant)) {
    return simulated(make_mass_spring(body, body.network,
                                      o.plant == "newton"
                                          ? clothctl::Integration::Newton
                                          : clothctl::Integration::LinearlyImplicit));
  }
  if (o.profile != "paper") {  // it bounces more than an implicit sheet
    settings.weights.smooth = 0.3;
    settings.weights.step = 0.05;
  }
  return simulated(make_position_based(o.plant, body));
}

/// A predictor of the body, from one of its coarse sheet if there is one.
template <class Predictor>
AnyPredictor sampled(const Body& body, Predictor predictor) {
  if (!body.coarse) return AnyPredictor(std::move(predictor));
  return AnyPredictor(
      clothctl::CoarsePredictor<Predictor>(body.coarse->sampling, std::move(predictor)));
}

}  // namespace

clothctl::MassSpring<double> make_mass_spring(const Body& body,
                                              const clothctl::SpringNetwork<double>& network,
                                              clothctl::Integration integration) {
  clothctl::MassSpringSettings<double> settings;
  settings.integration = integration;
  settings.drag = body.drag;
  settings.air = body.air;
  settings.limit_energy = false;  // the published step, which the planner predicts
  return must(clothctl::MassSpring<double>::create(network, settings));
}

clothctl::RolloutModelSettings rollout_model_settings(Index vertices) {
  clothctl::RolloutModelSettings settings;
  settings.bending_in_matrix = 33 * 33 < vertices;
  return settings;
}

clothctl::PositionBased<double> make_position_based(const std::string& name, const Body& body) {
  clothctl::PositionBasedSettings<double> settings =
      name == "pbd" ? clothctl::PositionBasedSettings<double>::verlet()
                    : clothctl::PositionBasedSettings<double>();
  settings.drag = body.drag;
  settings.air = body.air;
  return must(clothctl::PositionBased<double>::create(body.network, settings));
}

AnyPlant make_plant(const std::string& name, const Body& body, double drag) {
  Body changed = body;
  changed.drag = drag;
  if (name == "linear-implicit")
    return AnyPlant(
        make_mass_spring(changed, body.network, clothctl::Integration::LinearlyImplicit));
  if (name == "newton")
    return AnyPlant(make_mass_spring(changed, body.network, clothctl::Integration::Newton));
  if (name == "explicit")
    return AnyPlant(AnyPlant::Plant(), ForeignPlant(changed.network, changed.drag));
  return AnyPlant(make_position_based(name, changed));
}

AnyPlant plant_in_state(const std::string& name, const Body& body,
                        const clothctl::ClothState<double>& state) {
  AnyPlant plant = make_plant(name, body, body.drag);
  plant.set_state(state);
  return plant;
}

std::string chosen_predictor(const Options& o) {
  if (o.predictor != "auto") return o.predictor;
  // With hard patch rows, rollouts under planned forces can become unstable (docs/performance.md),
  // so the linearised predictor is used. Poses move patches rigidly.
  const bool rigid = o.grip == "position" || may_follow_poses(o);
  if ((o.patch != "soft" && !rigid) || o.profile == "paper") return "linearised";
  if (is_implicit(o.plant)) return "rollout";
  // A rollout for each coordinate of each held vertex: too many where hands hold patches. In wind
  // hands lead by what the air does, which a simulator does not tell.
  const bool planned = o.grip == "position" || (o.grip == "force" && o.unknown == 0);
  const bool few = planned && o.patch_size == 1 && o.cloth <= std::min(17, o.model) && !o.windy();
  return is_position_based(o.plant) && few ? "simulator" : "linearised";
}

bool follows_poses(const Options& o) {
  if (!is_position_based(o.plant))
    return may_follow_poses(o) &&
           (chosen_predictor(o) == "rollout" || chosen_predictor(o) == "simulator");
  return o.grip == "force" && chosen_predictor(o) == "simulator";
}

AnyPredictor make_predictor(const Options& o, const Body& body,
                            clothctl::PlannerSettings<double>& settings,
                            const std::optional<clothctl::IdentifiedResponse<double>>& identified) {
  if (chosen_predictor(o) == "simulator") return make_simulator(o, body, settings);
  const bool implicit = is_implicit(o.plant);
  clothctl::ResponseSettings<float> response;
  clothctl::LinearisedPredictorSettings<double> exact;
  if (!implicit) {
    const auto loose =
        clothctl::loose_plant<double>(o.plant == "explicit" ? clothctl::WeightBearing::Tension
                                                            : clothctl::WeightBearing::Elongation);
    response = loose.response;
    exact = loose.predictor;
    if (o.profile != "paper") {
      settings.weights.smooth = loose.planner.weights.smooth;
      settings.weights.anchor = loose.planner.weights.anchor;  // constant: tasks take seconds
    }
    if (o.plant == "pbd") {  // Verlet sheets are even softer
      response.scale.geometric = 0.003f;
      if (o.profile != "paper") settings.weights.anchor = 100;
    }
  }
  if (identified) {
    response = identified->response;
    exact = identified->predictor;
  }
  const clothctl::MassSpring<double> model =
      make_mass_spring(body, body.coarse ? body.coarse->network : body.network,
                       clothctl::Integration::LinearlyImplicit);
  const bool rolls = chosen_predictor(o) == "rollout", newton = o.plant == "newton";
  clothctl::RolloutModelSettings fast = rollout_model_settings(model.vertex_count());
  if (body.coarse) fast.factors = clothctl::CoarseFactors::fitted();
  if (!newton) fast.integration = clothctl::Integration::LinearlyImplicit;
  if (rolls) response.bending_in_matrix = fast.bending_in_matrix;
  Linearised linearised(Response(model, response), exact);
  if (!rolls) return sampled(body, std::move(linearised));
  damp(o, body, 0.05, settings);  // what is derived may be damped more
  clothctl::RolloutSettings rollout;
  rollout.step_tolerance = 0.5;  // one step, but where something moves violently
  return sampled(body, rolled(clothctl::MassSpringRollout<double>(model, fast),
                              std::move(linearised), rollout, o.second_thread));
}

}  // namespace program
