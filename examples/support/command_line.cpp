#include "support/command_line.hpp"

#include <charconv>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <sstream>
#include <string>
#include <system_error>

namespace program {

CLI::Validator between(double least, double most) {
  std::ostringstream range;
  range << '[' << least << " to " << most << ']';
  const std::string shown = range.str();
  return CLI::Validator(
      [=](std::string& text) {
        double value = 0;
        const bool inside =
            CLI::detail::lexical_cast(text, value) && least <= value && value <= most;
        return inside ? std::string() : text + " is not within " + shown;
      },
      shown);
}

CLI::Validator seed_number() {
  return CLI::Validator(
      [](const std::string& text) {
        std::uint64_t value = 0;
        const char* const end = text.data() + text.size();
        const auto read = std::from_chars(text.data(), end, value);
        const bool good = read.ec == std::errc() && read.ptr == end;
        return good ? std::string() : text + " is not a whole number from 0 to 2^64 - 1";
      },
      "");
}

namespace {

/// Accepts an older word for a value; --help does not show it.
CLI::Validator old_name(const std::string& old, const std::string& name) {
  return CLI::Validator(
      [=](std::string& text) {
        if (text == old) text = name;
        return std::string();
      },
      "");
}

}  // namespace

void add_planner(CLI::App& app, Options& o) {
  app.add_option("--horizon", o.horizon, "Frames in the planning window")
      ->check(between(1, 200))
      ->capture_default_str();
  app.add_option("--plant", o.plant, "Simulated plant")
      ->transform(old_name("one-solve", "linear-implicit"))
      ->check(CLI::IsMember({"linear-implicit", "newton", "pbd", "xpbd"}))
      ->capture_default_str();
  app.add_option(
         "--grip", o.grip,
         "What is planned and sent: force; position; or planned-position (forces planned, "
         "positions sent). Forces of several vertices a hand follow planned positions where "
         "a rollout or the simulator predicts an implicit plant")
      ->check(CLI::IsMember({"force", "position", "planned-position"}))
      ->capture_default_str();
  app.add_option(
         "--predictor", o.predictor,
         "linearised: once a frame; rollout: nonlinear free response; identified: linearised, with "
         "a tension found from motion of the plant before the run; simulator: free and impulse "
         "response by the plant's own steps, for positions, which --grip force follows by forces; "
         "auto: with standard weights and no hard patches under planned forces, rollout on "
         "implicit plants, and simulator "
         "in still air for single vertices on position-based ones of up to 17 vertices a side; "
         "else linearised")
      ->transform(old_name("frozen", "linearised"))
      ->check(CLI::IsMember({"auto", "linearised", "rollout", "identified", "simulator"}))
      ->capture_default_str();
  app.add_option("--profile", o.profile,
                 "Weights: standard, or paper (40 / 0.01 / 10, no hand anchor)")
      ->check(CLI::IsMember({"standard", "paper"}))
      ->capture_default_str();
  app.add_option("--friction", o.friction,
                 "Friction coefficient between fingers and cloth (default: the material's)")
      ->check(between(0, 100));
  app.add_option("--limit", o.limit, "Largest normal force of a finger, N")
      ->check(between(1e-6, 1e6))
      ->capture_default_str();
  app.add_option("--generators", o.generators, "Generators of a friction cone")
      ->check(between(4, 64))
      ->capture_default_str();
  app.add_option("--max-step", o.max_step_mm,
                 "Largest motion of a commanded grip along each axis in a frame, mm")
      ->check(between(1e-3, 1e4))
      ->capture_default_str();
  app.add_option("--max-acceleration", o.max_acceleration,
                 "Largest acceleration of a commanded grip along each axis, m/s²; 0: any")
      ->check(between(0, 1e6))
      ->capture_default_str();
  app.add_option(
         "--input-intervals", o.input_intervals,
         "With position grips: frames between the knots of splines for the velocities, such as "
         "1,1,2,4,12; their sum is the horizon (default: free velocities in every frame)")
      ->delimiter(',');
  app.add_option("--input-degree", o.input_degree,
                 "Degree of those splines; 0: velocities are constant between knots")
      ->check(CLI::Range(0, 3))
      ->capture_default_str();
}

void add_measurement(CLI::App& app, Options& o) {
  const std::string group = "With position grips: plan for a state estimated from measurements";
  app.add_option("--noise", o.noise, "Standard deviation of each measured coordinate, m")
      ->check(between(0, 1))
      ->capture_default_str()
      ->group(group);
  app.add_option("--delay", o.delay, "Age of measurements, s, rounded to frames of 0.02 s")
      ->check(between(0, 0.5))
      ->capture_default_str()
      ->group(group);
  app.add_option("--markers", o.markers, "Measured vertices along a side; 0: all vertices")
      ->check(between(0, 129))
      ->capture_default_str()
      ->group(group);
  app.add_option("--latency", o.latency, "Frames from a command to its effect")
      ->check(between(0, 25))
      ->capture_default_str()
      ->group(group);
  app.add_option("--noise-seed", o.noise_seed, "Seed of the noise")
      ->check(seed_number())
      ->capture_default_str()
      ->group(group);
}

void add_common(CLI::App& app, Options& o, const std::vector<std::string>& tasks,
                const std::string& task_help) {
  const auto named = [](const std::string& text) {
    return text.empty() ? std::string("is empty") : std::string();
  };
  CLI::Option* targets = app.add_option("--targets", o.targets,
                                        "CSV file with a header t,Lx,Ly,Lz,... ; or "
                                        "LEFT.csv,RIGHT.csv without headers, with --dt")
                             ->check(named);
  app.add_option("--task", o.task, task_help)
      ->check(CLI::IsMember(tasks))
      ->capture_default_str()
      ->excludes(targets);
  app.add_option("--dt", o.dt, "Time between rows of header-less target files, s")
      ->check(between(1e-4, 1))
      ->capture_default_str()
      ->needs(targets);
  add_planner(app, o);
  app.add_option("--seed", o.seed, "Seed of the random tasks")
      ->check(seed_number())
      ->capture_default_str();
  app.add_flag("--json", o.json, "Print the summary as one JSON object on the last line");
  app.add_option("--out", o.out,
                 "Folder for player.html, trajectory.csv and summary.json (made if missing)")
      ->check(named);
}

void add_sheet(CLI::App& app, int& cloth, double& size, std::string& material,
               const std::string& cloth_help) {
  app.add_option("--cloth", cloth, cloth_help)->check(between(3, 129))->capture_default_str();
  app.add_option("--size", size, "Side of the sheet, m")
      ->check(between(0.01, 100))
      ->capture_default_str();
  app.add_option("--material", material, "Preset name or JSON file")->capture_default_str();
}

CLI::Option* add_model(CLI::App& app, int& model) {
  return app
      .add_option("--model", model,
                  "Vertices along a side of the sheet that the planner predicts with, if --cloth "
                  "is larger")
      ->check(between(3, 129))
      ->capture_default_str();
}

void parse(CLI::App& app, int argc, char** argv) {
  // Every program comes here before it makes anything large. The handler must not allocate.
  std::set_new_handler([] {
    std::fputs("error: not enough memory for a body of this size\n", stderr);
    std::_Exit(2);
  });
  try {
    app.parse(argc, argv);
  } catch (const CLI::CallForHelp& e) {
    std::exit(app.exit(e));
  } catch (const CLI::ParseError& e) {
    refuse(std::string(e.what()) + " (see --help)");
  }
}

void parse(CLI::App& app, Options& o, int argc, char** argv) {
  parse(app, argc, argv);
  const CLI::Option* dt = app.get_option_no_throw("--dt");
  o.dt_given = dt != nullptr && dt->count() > 0;
  o.friction_given = app.count("--friction") > 0;
  for (const char* option : {"--noise", "--delay", "--markers", "--latency"}) {
    const CLI::Option* given = app.get_option_no_throw(option);
    o.measured = o.measured || (given != nullptr && given->count() > 0);
  }
  if (o.measured && o.grip != "position")
    refuse("--noise, --delay, --markers and --latency need --grip position");
  if (o.markers == 1 || o.markers > o.cloth)
    refuse("--markers: " + std::to_string(o.markers) + " is not 0 or 2 to " +
           std::to_string(o.cloth));
}

}  // namespace program
