// Our QP solvers beside those that were found when this was built: the same problems in the same process, interleaved, thread
// CPU time, every answer judged on the unscaled data.

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "clothctl/io/file.hpp"
#include "report.hpp"

namespace {

using versus::Entry;

constexpr const char* kUsage =
    "usage: bench_versus_qp --data FOLDER [--sets mm,a,b,c,d,e] [--solvers NAMES] [--passes 3] [--block 0] [--time-limit 10]\n"
    "                       [--json FILE]\n"
    "  FOLDER holds maros_meszaros/*.qpt and synthetic/*.qpt; e are the sequences\n"
    "  --block N       frames of a sequence that a solver does in a row before the next takes its turn; 0 means all\n"
    "  --time-limit S  seconds after which a solver is told to give up, and a pass over a sequence ends\n";

struct Options {
  std::string data, sets = "mm,a,b,c,d,e", solvers, json;
  versus::RunSettings run;
};

[[noreturn]] void refuse(const std::string& message) {
  std::fprintf(stderr, "bench_versus_qp: %s\n%s", message.c_str(), kUsage);
  std::exit(2);
}

double number(const std::string& option, const std::string& text, double least, double most) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !(value >= least && value <= most)) refuse(option + ": '" + text + "' is out of range");
  return value;
}

Options parse(const std::vector<std::string>& words) {
  Options o;
  for (std::size_t i = 0; i < words.size(); i += 2) {
    const std::string& option = words[i];
    if (option == "--help") {
      std::fputs(kUsage, stdout);
      std::exit(0);
    }
    if (i + 1 == words.size()) refuse(option + " needs a value");
    const std::string& value = words[i + 1];
    if (option == "--data") {
      o.data = value;
    } else if (option == "--sets") {
      o.sets = value;
    } else if (option == "--solvers") {
      o.solvers = value;
    } else if (option == "--json") {
      o.json = value;
    } else if (option == "--passes") {
      o.run.passes = static_cast<int>(number(option, value, 1, 1000));
    } else if (option == "--block") {
      o.run.block = static_cast<versus::Index>(number(option, value, 0, 1e6));
    } else if (option == "--time-limit") {
      o.run.time_limit = number(option, value, 1e-3, 1e5);
    } else {
      refuse(option + " is not an option");
    }
  }
  if (o.data.empty()) refuse("--data is missing");
  return o;
}

/// Whether a comma-separated list holds a word.
bool holds(const std::string& list, const std::string& word) {
  return ("," + list + ",").find("," + word + ",") != std::string::npos;
}

std::vector<Entry> entries(const std::string& chosen) {
  std::vector<Entry> all{versus::clothctl_entry()};
#ifdef VERSUS_DAQP_VERSION
  all.push_back(versus::daqp_entry());
#endif
#ifdef VERSUS_PIQP_VERSION
  all.push_back(versus::piqp_entry());
#endif
#ifdef VERSUS_QPOASES_VERSION
  all.push_back(versus::qpoases_entry());
#endif
#ifdef VERSUS_OSQP_VERSION
  all.push_back(versus::osqp_entry());
#endif
#ifdef VERSUS_PROXQP_VERSION
  all.push_back(versus::proxqp_entry());
#endif
#ifdef VERSUS_QPMAD_VERSION
  all.push_back(versus::qpmad_entry());
#endif
#ifdef VERSUS_EIQUADPROG_VERSION
  all.push_back(versus::eiquadprog_entry());
#endif
  if (chosen.empty()) return all;
  std::vector<Entry> some;
  for (const Entry& e : all) {
    if (holds(chosen, e.name)) some.push_back(e);
  }
  if (some.empty()) refuse("--solvers: none of '" + chosen + "' is built in");
  return some;
}

/// The QPT files of a folder whose names begin with `prefix`, sorted.
std::vector<std::string> files(const std::filesystem::path& folder, const std::string& prefix) {
  std::vector<std::string> found;
  std::error_code error;
  for (const auto& item : std::filesystem::directory_iterator(folder, error)) {
    const std::string name = item.path().filename().string();
    if (name.rfind(prefix, 0) == 0 && item.path().extension() == ".qpt") found.push_back(item.path().string());
  }
  if (found.empty()) refuse("no " + prefix + "*.qpt in " + folder.string());
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace

int main(int argc, char** argv) {
  const Options options = parse(std::vector<std::string>(argv + 1, argv + argc));
  const std::filesystem::path data(options.data);
  versus::Report report;
  report.entries = entries(options.solvers);
  report.settings = options.run;
  versus::print_solvers(report.entries);
  const auto set = [&](const char* key, const char* name, const char* folder, const char* prefix) {
    if (!holds(options.sets, key)) return;
    report.sets.emplace_back(name, versus::run_set(report.entries, files(data / folder, prefix), options.run));
    versus::print_set(name, report.sets.back().second);
  };
  set("mm", "maros_meszaros", "maros_meszaros", "");
  set("a", "a strictly convex", "synthetic", "a_");
  set("b", "b semidefinite and linear", "synthetic", "b_");
  set("c", "c infeasible", "synthetic", "c_inf");
  set("c", "c unbounded", "synthetic", "c_unb");
  set("d", "d redundant equalities", "synthetic", "d_");
  if (holds(options.sets, "e")) {
    for (const std::string& file : files(data / "synthetic", "e_")) {
      const clothctl::QpProblem sequence = versus::load(file);
      if (sequence.frames.empty()) refuse(file + " is no sequence");
      report.sequences.push_back(
          {sequence.name, sequence.n(), sequence.m(), versus::run_sequence(report.entries, sequence, options.run)});
      versus::print_sequence(report.sequences.back());
    }
  }
  if (options.json.empty()) return 0;
  const clothctl::Result<std::size_t> written = clothctl::write_file(options.json, versus::to_json(report));
  if (!written) refuse(written.error());
  return 0;
}
