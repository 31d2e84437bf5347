#include "support/identified_plant.hpp"

#include <algorithm>

namespace program {

std::optional<clothctl::IdentifiedResponse<double>> identify_plant(
    const Scene& scene, const Options& o, const Body& body,
    const clothctl::ClothState<double>& rest) {
  if (o.predictor != "identified") return {};
  if (scene.body.coarse)
    refuse("--predictor: identified needs a --model of at least --cloth " +
           std::to_string(o.cloth));
  std::vector<std::vector<int>> grips;
  for (const clothctl::Grip<double>& grip : scene.setup.grips) grips.push_back(grip.vertices());
  clothctl::ExcitationSettings<double> sway;
  sway.dt = scene.settings.dt;
  sway.amplitude = 0.04 * o.size;
  AnyPlant plant = plant_in_state(o.plant, body, rest);
  const auto record = must(clothctl::record_motion<AnyPlant, double>(plant, grips, sway));
  clothctl::FitSettings<double> fit;
  fit.horizon = std::min<Index>(scene.settings.horizon, sway.frames / 4);
  const clothctl::MassSpring<double> model =
      make_mass_spring(scene.body, scene.body.network, clothctl::Integration::LinearlyImplicit);
  return must(clothctl::identify_response<double>(model, record, scene.setup.features, fit));
}

}  // namespace program
