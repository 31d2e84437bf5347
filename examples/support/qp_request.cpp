#include "support/qp_request.hpp"

#include <algorithm>
#include <cctype>
#include <chrono>
#include <filesystem>

#include "clothctl/io/file.hpp"
#include "clothctl/io/qps.hpp"
#include "clothctl/io/qpt.hpp"
#include "support/command_line.hpp"

namespace program {

using clothctl::QpProblem;

namespace {

/// The clock of --time-limit, s.
double wall_clock(void*) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string lower_case_end(const std::string& path) {
  std::string end = path.substr(std::min(path.size(), path.find_last_of('.')));
  for (char& c : end) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return end;
}

/// Refuses two options that name the same file, because the second would overwrite the first.
void keep_apart(const char* what, const std::string& path, const char* other,
                const std::string& other_path) {
  std::error_code none;
  const bool same = path == other_path || std::filesystem::equivalent(path, other_path, none);
  if (!path.empty() && same)
    refuse(std::string(what) + ": '" + path + "' is the same file as " + other);
}

}  // namespace

QpProblem read_problem(const std::string& path) {
  const std::string text = must(clothctl::read_file(path));
  const std::string end = lower_case_end(path);
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  const bool starts_as_qpt = first != std::string::npos && text.compare(first, 3, "qpt") == 0;
  const bool is_qps = end == ".qps" || end == ".mps" || (end != ".qpt" && !starts_as_qpt);
  return must(is_qps ? clothctl::parse_qps(text, path) : clothctl::parse_qpt(text, path));
}

clothctl::QpSettings<double> settings_of(const Request& o) {
  clothctl::QpSettings<double> s;
  if (o.tolerance > 0)
    s.stationarity_tolerance = s.feasibility_tolerance = s.complementarity_tolerance = o.tolerance;
  s.max_iterations = o.max_iterations;
  s.time_limit = o.time_limit;
  s.clock = wall_clock;
  s.closest_point = o.closest_point;
  return s;
}

Request parse_request(int argc, char** argv) {
  Request o;
  CLI::App app{
      "Solves a quadratic program, or every frame of a sequence cold and warm, and checks the "
      "answer on the file's own "
      "numbers. "
      "Exit code 0: solved, or proved infeasible or unbounded, as the file expects; 1: not so; 2: "
      "bad input."};
  app.add_option("FILE", o.file, "QPT file, or QPS/MPS file with a quadratic objective")
      ->required();
  app.add_option("--solution", o.solution,
                 "File for status, objective, x, y, z (or the proof): QPT sections; with H x + g = "
                 "A'y + z, multipliers >= 0 at "
                 "lower bounds; for OBJSENSE MAX those of the negated objective");
  app.add_option("--out", o.out,
                 "CSV file with a row a frame: objective, status, iterations, ms; warm and cold");
  app.add_flag("--json", o.json, "Print the figures as one JSON object on the last line");
  app.add_option("--time-limit", o.time_limit,
                 "Seconds that each solve may take by the wall clock (default: any)")
      ->check(between(1e-6, 1e6));
  app.add_option("--max-iterations", o.max_iterations,
                 "Iterations of a solve (default: 10 (n + m))")
      ->check(between(1, 1e9));
  app.add_option("--tolerance", o.tolerance,
                 "Relative residuals that count as solved (default: 1.6e-9)")
      ->check(between(1e-14, 0.1));
  app.add_flag("--closest-point", o.closest_point,
               "Infeasible programs: go to the closest point; --solution then has its x");
  app.add_option("--passes", o.passes, "Sequences: warm times are the least of this many passes")
      ->check(between(1, 1000))
      ->capture_default_str();
  parse(app, argc, argv);
  keep_apart("--solution", o.solution, "FILE", o.file);
  keep_apart("--out", o.out, "FILE", o.file);
  keep_apart("--out", o.out, "--solution", o.solution);
  return o;
}

}  // namespace program
