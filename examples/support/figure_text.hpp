#pragma once

// Figures as people read them.

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace program {

/// Returns a figure as text, numbers with four digits.
std::string figure_text(const nlohmann::ordered_json& value);

}  // namespace program
