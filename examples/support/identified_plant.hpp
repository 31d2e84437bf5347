#pragma once

// --predictor identified: what a plant tells of its tension before a run.

#include <optional>

#include "support/scene.hpp"

namespace program {

/// With --predictor identified, lets the hands of a plant of `body` that hangs in `rest` sway for
/// four seconds and fits the response of the scene's springs to what the features do; for other
/// predictors returns nothing. Ends the program where a coarse sheet predicts, or where nothing can
/// be fitted.
std::optional<clothctl::IdentifiedResponse<double>> identify_plant(
    const Scene& scene, const Options& o, const Body& body,
    const clothctl::ClothState<double>& rest);

}  // namespace program
