#pragma once

// The options and the figures of contacts.

#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "support/cloth_run.hpp"
#include "support/command_line.hpp"

namespace program {

/// Adds --obstacle, --friction, --self and --thickness.
void add_contact_options(CLI::App& app, ClothRunOptions& run);

/// Returns the figures of contacts as a JSON object.
nlohmann::ordered_json contact_figures(const ClothFigures& f);

/// Adds the figures of contacts to the rows of a page.
void add_contact_rows(const ClothFigures& f,
                      std::vector<std::pair<std::string, std::string>>& rows);

}  // namespace program
