// Thumb and index push a sheet that lies on a table into a bulge, by friction alone, pinch the
// bulge and lift it ([Bai 2016], section 6.1). The sheet has 4392 vertices; the window has 10
// frames.
//
//   lift_from_table --out out           then open out/player.html
//   lift_from_table --seed 3            other friction, stiffness and place
//   lift_from_table --friction 0.2      too little: the fingers slide over the sheet

#include <nlohmann/json.hpp>

#include "support/command_line.hpp"
#include "support/figure_text.hpp"
#include "support/hand_figures.hpp"
#include "support/hand_lift.hpp"
#include "support/inputs.hpp"
#include "support/timing.hpp"

namespace {

using namespace program;

struct Request {
  LiftOptions lift;
  std::string material = "handkerchief", out;
  bool json = false;
};

Request read_request(int argc, char** argv) {
  Request r;
  CLI::App app{"Thumb and index lift a sheet from a table."};
  const auto add = [&](const char* name, auto& value, double least, double most, const char* help) {
    app.add_option(name, value, help)->check(between(least, most))->capture_default_str();
  };
  add("--cols", r.lift.cols, 11, 200, "Vertices of a row");
  add("--rows", r.lift.rows, 11, 200, "Rows");
  add("--width", r.lift.width, 0.2, 0.9, "Length of a row, m");
  add("--friction", r.lift.friction, 0.01, 10, "Friction coefficient of the fingertips");
  add("--table-friction", r.lift.table_friction, 0, 10, "Friction coefficient of the table");
  add("--press", r.lift.press, 0.05, 10, "Normal force of each finger on the table, N");
  add("--pinch", r.lift.pinch, 0.05, 10, "Normal force of each finger on the bulge, N");
  add("--height", r.lift.height, 0.01, 0.3, "How high to lift it, m");
  add("--attempts", r.lift.attempts, 1, 20, "Times to try before giving up");
  add("--dt", r.lift.dt, 1e-3, 0.02, "Time step, s");
  add("--horizon", r.lift.horizon, 2, 30, "Frames of the window");
  app.add_option("--material", r.material, "Preset or JSON file")->capture_default_str();
  app.add_option("--seed", r.lift.seed, "Of friction, stiffness (20 %) and place (5 mm); 0: none")
      ->check(seed_number())
      ->capture_default_str();
  app.add_flag("--json", r.json, "Print the figures as one JSON object on the last line");
  app.add_option("--out", r.out, "Folder for player.html (made if missing)");
  parse(app, argc, argv);
  r.lift.material = read_material(r.material);
  return r;
}

}  // namespace

int main(int argc, char** argv) {
  const Request r = read_request(argc, argv);
  make_folder(r.out);  // before the work, since it may fail
  const auto task = must(TableLift::create(r.lift, !r.out.empty()));
  const std::string bad = task->run();
  const LiftFigures& f = task->figures();
  const bool lifted = bad.empty() && 0.8 * r.lift.height < f.lift_height_m;
  nlohmann::ordered_json j;
  j["status"] = !bad.empty() ? bad : lifted ? "lifted" : "dropped";
  j["phase"] = f.phase;
  j["vertices"] = task->vertex_count();
  j["lift_height_m"] = f.lift_height_m;
  j["bulge_height_m"] = f.bulge_height_m;
  j["attempts"] = f.attempts;
  j["grasp_firm_share"] = 0.5 * f.firm;
  j["slips"] = f.slips;
  j["grip_force_mean_N"] = known(f.force_sum / static_cast<double>(f.held_steps), f.held_steps > 0);
  j["mean_error_m"] = f.feature_error_m;
  j["ik_error_max_m"] = f.ik_error_max_m;
  j["rectify_residual_max_m"] = f.rectify_residual_max_m;
  j["penetration_max_m"] = known(f.penetration_max_m);
  j["sheet_penetration_max_m"] = f.sheet_penetration_max_m;
  j["torque_max_share"] = f.torque_max_share;
  j["momentum_residual"] = nullptr;  // torques of divided steps are those of the last part
  j["hand_frame_ms"] = quantile(f.hand_ms, 0.5);
  j["hand_frame_ms_p99"] = quantile(f.hand_ms, 0.99);
  j["plan_ms"] = known(quantile(f.plan_ms, 0.5), !f.plan_ms.empty());
  j["plan_ms_p99"] = known(quantile(f.plan_ms, 0.99), !f.plan_ms.empty());
  j["material"] = r.lift.material.name;
  std::vector<std::pair<std::string, std::string>> page;
  for (const auto& [key, value] : j.items()) page.emplace_back(key, figure_text(value));
  if (const std::string error = task->write_page(r.out, std::move(page)); !error.empty())
    refuse(error);
  print_figures(j, r.json);
  if (!r.out.empty() && !r.json) std::printf("open %s/player.html\n", r.out.c_str());
  return lifted ? 0 : 1;
}
