#include "support/hand_figures.hpp"

#include <nlohmann/json.hpp>

#include <cstdio>

#include "support/figure_text.hpp"
#include "support/options.hpp"

namespace program {

void print_figures(const nlohmann::ordered_json& figures, bool json) {
  if (json) {
    std::printf("%s\n",
                figures.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
    return;
  }
  for (const auto& [key, value] : figures.items()) {
    if (value.is_null()) continue;
    std::printf("%-28s %s\n", key.c_str(), figure_text(value).c_str());
  }
}

nlohmann::ordered_json known(double value, bool is_known) {
  return is_known && clothctl::is_finite(value) ? nlohmann::ordered_json(value)
                                                : nlohmann::ordered_json();
}

std::string millimetres(double metres) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g mm", 1000 * metres);
  return text;
}

double smooth_share(double s) {
  return s <= 0 ? 0 : s >= 1 ? 1 : s * s * s * (10 + s * (6 * s - 15));
}

double smooth_speed(double s) { return s <= 0 || s >= 1 ? 0 : 30 * s * s * (1 - s) * (1 - s); }

}  // namespace program
