#include "support/options.hpp"

namespace program {

void refuse(const std::string& reason) {
  std::fprintf(stderr, "error: %s\n", reason.c_str());
  std::exit(2);
}

void add_common(CLI::App& app, Options& o) {
  app.add_option("--targets", o.targets,
                 "CSV file with a header t,Lx,Ly,Lz,... ; or LEFT.csv,RIGHT.csv without headers, with --dt");
  app.add_option("--dt", o.dt, "Time between rows of header-less target files, s")->capture_default_str();
  app.add_option("--horizon", o.horizon, "Frames in the planning window, 1 to 200")->capture_default_str();
  app.add_option("--plant", o.plant, "Simulated plant: one-solve, newton, pbd or xpbd")
      ->check(CLI::IsMember({"one-solve", "newton", "pbd", "xpbd"}))
      ->capture_default_str();
  app.add_option("--grip", o.grip,
                 "What is planned and sent: force; position; or planned-position (forces planned, positions sent)")
      ->check(CLI::IsMember({"force", "position", "planned-position"}))
      ->capture_default_str();
  app.add_option("--predictor", o.predictor,
                 "frozen: linearised once a frame; rollout: nonlinear free response; auto: rollout on implicit plants in still "
                 "air with soft patches, else frozen")
      ->check(CLI::IsMember({"auto", "frozen", "rollout"}))
      ->capture_default_str();
  app.add_option("--profile", o.profile, "Weights: standard, or paper (40 / 0.01 / 10, no hand anchor)")
      ->check(CLI::IsMember({"standard", "paper"}))
      ->capture_default_str();
  app.add_option("--friction", o.friction, "Friction coefficient between fingers and cloth (default: the material's)");
  app.add_option("--limit", o.limit, "Largest normal force of a finger, N")->capture_default_str();
  app.add_option("--generators", o.generators, "Generators of a friction cone, at least 4")->capture_default_str();
  app.add_option("--max-step", o.max_step_mm, "Furthest a commanded grip moves in a frame along each axis, mm")
      ->capture_default_str();
  app.add_option("--seed", o.seed, "Seed of the random tasks, 0 or more")
      ->check([](const std::string& text) {
        return text.find('-') == std::string::npos ? std::string() : "--seed is " + text + ", must not be negative";
      })
      ->capture_default_str();
  app.add_flag("--json", o.json, "Print the summary as one JSON object on the last line");
  app.add_option("--out", o.out, "Folder for player.html, trajectory.csv and summary.json (made if missing)");
}

void parse(CLI::App& app, Options& o, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::CallForHelp& e) {
    std::exit(app.exit(e));
  } catch (const CLI::ParseError& e) {
    refuse(std::string(e.what()) + " (see --help)");
  }
  if (o.horizon > 200) refuse("--horizon is " + std::to_string(o.horizon) + ", must be 1 to 200");
  o.dt_given = app.count("--dt") > 0;
  o.friction_given = app.count("--friction") > 0;
}

}  // namespace program
