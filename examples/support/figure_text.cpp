#include "support/figure_text.hpp"

#include <cstdio>
#include <nlohmann/json.hpp>

namespace program {

std::string figure_text(const nlohmann::ordered_json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (!value.is_number_float()) return value.dump();
  char number[32];
  std::snprintf(number, sizeof number, "%.4g", value.get<double>());
  return number;
}

}  // namespace program
