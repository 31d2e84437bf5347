#pragma once

// The command line that the programs share, and its checks. Bad input: one line on stderr, exit 2.

#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

namespace program {

/// Ends the program for bad input.
[[noreturn]] inline void refuse(const std::string& reason) {
  std::fprintf(stderr, "error: %s\n", reason.c_str());
  std::exit(2);
}

/// What the user asked for. Fields that a program does not offer keep their defaults.
struct Options {
  std::string task = "async";
  std::string targets;
  double dt = 0.02;
  int cloth = 17;
  double size = 0.5;
  std::string material = "handkerchief";
  int horizon = 20;
  std::string plant = "newton";
  std::string grip = "force";
  std::string patch = "soft";
  int patch_size = 1;
  std::string predictor = "auto";
  std::string profile = "standard";
  double friction = -1;
  double limit = 20;
  int generators = 4;
  double max_step_mm = 50;
  double spread = 0.9;
  std::uint64_t seed = 1;
  bool json = false;
  std::string out;
  bool dt_given = false;
  bool friction_given = false;
};

/// Adds the keys that every program has.
inline void add_common(CLI::App& app, Options& o) {
  app.add_option("--targets", o.targets,
                 "CSV file with a header t,Lx,Ly,Lz,... ; or LEFT.csv,RIGHT.csv without headers, with --dt");
  app.add_option("--dt", o.dt, "Time between rows of header-less target files, s")->capture_default_str();
  app.add_option("--horizon", o.horizon, "Frames in the planning window")->capture_default_str();
  app.add_option("--plant", o.plant, "Simulated plant: one-solve, newton, pbd or xpbd")
      ->check(CLI::IsMember({"one-solve", "newton", "pbd", "xpbd"}))
      ->capture_default_str();
  app.add_option("--grip", o.grip,
                 "What is planned and sent: force; position; or planned-position (forces planned, positions sent)")
      ->check(CLI::IsMember({"force", "position", "planned-position"}))
      ->capture_default_str();
  app.add_option("--predictor", o.predictor,
                 "frozen: linearised once a frame; rollout: nonlinear free response; auto: rollout for position grips in still "
                 "air, else frozen")
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
  app.add_option("--seed", o.seed, "Seed of the random tasks")->capture_default_str();
  app.add_flag("--json", o.json, "Print the summary as one JSON object on the last line");
  app.add_option("--out", o.out, "Folder for player.html, trajectory.csv and summary.json (made if missing)");
}

/// Parses; --help exits 0, a bad command line exits 2 with one line.
inline void parse(CLI::App& app, Options& o, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::CallForHelp& e) {
    std::exit(app.exit(e));
  } catch (const CLI::ParseError& e) {
    refuse(std::string(e.what()) + " (see --help)");
  }
  o.dt_given = app.count("--dt") > 0;
  o.friction_given = app.count("--friction") > 0;
}

}  // namespace program
