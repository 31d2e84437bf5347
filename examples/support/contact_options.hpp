#pragma once

// The options and the figures of contacts.

#include <nlohmann/json.hpp>

#include "support/cloth_run.hpp"
#include "support/command_line.hpp"

namespace program {

/// Adds --obstacle, --friction, --self and --thickness.
void add_contact_options(CLI::App& app, ClothRunOptions& run);

/// Returns the figures of contacts as a JSON object.
nlohmann::ordered_json contact_figures(const ClothFigures& f);

}  // namespace program
