#include "support/contact_options.hpp"

#include <cstdio>

#include "support/obstacles.hpp"

namespace program {

void add_contact_options(CLI::App& app, ClothRunOptions& run) {
  app.add_option("--obstacle", run.obstacles, kObstacleHelp);
  app.add_option("--friction", run.friction, "Friction coefficient of the obstacles")
      ->check(between(0, 100))
      ->capture_default_str();
  app.add_flag("--self", run.self, "Let the sheet touch itself");
  app.add_option("--thickness", run.thickness, "Thickness of the sheet for contacts, m")
      ->check(between(1e-5, 0.1))
      ->capture_default_str();
}

nlohmann::ordered_json contact_figures(const ClothFigures& f) {
  nlohmann::ordered_json j;
  j["contacts_max"] = f.contacts_max;
  j["penetration_max_m"] = f.penetration_max_m;
  j["self_crossings"] = f.self_crossings;
  j["momentum_residual"] = f.momentum_residual;
  j["solver_residual_max"] = f.solver_residual_max;
  j["penetration_end_m"] = f.penetration_end_m;
  j["speed_end_m_s"] = f.speed_end_m_s;
  return j;
}

void add_contact_rows(const ClothFigures& f,
                      std::vector<std::pair<std::string, std::string>>& rows) {
  char depth[32];
  std::snprintf(depth, sizeof depth, "%.2f mm", 1000 * f.penetration_max_m);
  rows.emplace_back("Contacts at most", std::to_string(f.contacts_max));
  rows.emplace_back("Largest depth", depth);
  rows.emplace_back("Crossings left", std::to_string(f.self_crossings));
}

}  // namespace program
