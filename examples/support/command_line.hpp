#pragma once

// The command line that the programs share, with its checks. Apart from options.hpp because CLI11
// takes long to compile.

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "support/options.hpp"

namespace program {

/// Accepts numbers from `least` to `most`; --help shows the range.
CLI::Validator between(double least, double most);

/// Accepts whole numbers from 0 to 2⁶⁴ - 1.
CLI::Validator seed_number();

/// Adds the options of every program. `tasks`: the built-in motions for --task, an alternative to
/// --targets.
void add_common(CLI::App& app, Options& o, const std::vector<std::string>& tasks,
                const std::string& task_help);

/// Adds the options of planning, plant and fingers; add_common does, too.
void add_planner(CLI::App& app, Options& o);

/// Adds the options of what is wrong with measurements and commands.
void add_measurement(CLI::App& app, Options& o);

/// Adds --cloth, --size and --material of a square sheet.
void add_sheet(CLI::App& app, int& cloth, double& size, std::string& material,
               const std::string& cloth_help = "Vertices along a side");

/// Adds the option of the coarse sheet that predicts the cloth, and returns it.
CLI::Option* add_model(CLI::App& app, int& model);

/// Parses the command line. --help exits with 0; a bad command line prints one line and exits with
/// 2.
void parse(CLI::App& app, int argc, char** argv);
/// The same for a program with `add_common` or `add_planner`.
void parse(CLI::App& app, Options& o, int argc, char** argv);

}  // namespace program
