#include "support/evaluate_folder.hpp"

#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "clothctl/config.hpp"
#include "clothctl/io/file.hpp"
#include "support/inputs.hpp"

namespace program {

namespace {

constexpr int kFormat = 1;  // raise it when columns or their meaning change

/// FNV-1a: tells one file from another.
std::string hash_text(const std::string& bytes) {
  std::uint64_t hash = 14695981039346656037u;
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211u;
  char text[24];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
  return text;
}

std::string run_file(const Job& job) {
  char name[48];
  std::snprintf(name, sizeof name, "runs/%03d-%06d.csv", job.study_case, job.seed);
  return name;
}

/// Refuses settings that differ from those of the folder.
void compare(const std::string& path, const nlohmann::ordered_json& settings) {
  const std::string text = must(clothctl::read_file(path));
  const auto found = nlohmann::ordered_json::parse(text, nullptr, false);
  if (found.is_discarded() || !found.is_object()) refuse("--resume: " + path + ": not JSON");
  for (const auto& [key, value] : settings.items()) {
    const std::string had = found.contains(key) ? found[key].dump() : "missing";
    if (had != value.dump())
      refuse("--resume: " + path + ": \"" + key + "\" is " + had + ", this run has " +
             value.dump());
  }
}

}  // namespace

nlohmann::ordered_json settings_json(const Evaluation& e) {
  const Options& o = e.run;
  const clothctl::Material<double> m = read_material(o.material);
  nlohmann::ordered_json j;
  j["format"] = kFormat;
  j["clothctl"] = CLOTHCTL_VERSION_STRING;
  j["study"] = e.study;
  j["seeds"] = e.seeds;
  if (e.curves.empty()) {
    j["kind"] = e.kind;
    j["seconds"] = e.seconds;
  } else {
    for (const std::string& file : e.curves)
      j["curves"][std::filesystem::path(file).filename().string()] =
          hash_text(must(clothctl::read_file(file)));
  }
  j["cloth"] = o.cloth;
  j["model"] = o.model;
  j["size_m"] = o.size;
  j["material"] = {{"name", m.name},
                   {"area_density", m.area_density},
                   {"stretch_warp", m.stretch_warp},
                   {"stretch_weft", m.stretch_weft},
                   {"shear", m.shear},
                   {"bending_warp", m.bending_warp},
                   {"bending_weft", m.bending_weft},
                   {"damping_time", m.damping_time},
                   {"drag", m.drag},
                   {"friction", o.friction_given ? o.friction : m.friction}};
  j["horizon"] = o.horizon;
  j["plant"] = o.plant;
  j["grip"] = o.grip;
  j["predictor"] = o.predictor;
  j["profile"] = o.profile;
  j["limit_N"] = o.limit;
  j["generators"] = o.generators;
  j["max_step_mm"] = o.max_step_mm;
  if (o.max_acceleration > 0) j["max_acceleration"] = o.max_acceleration;
  if (!o.input_intervals.empty()) {
    j["input_intervals"] = o.input_intervals;
    j["input_degree"] = o.input_degree;
  }
  if (o.measured)
    j["measured"] = {{"noise_m", o.noise},
                     {"delay_s", o.delay},
                     {"markers", o.markers},
                     {"latency", o.latency},
                     {"noise_seed", o.noise_seed}};
  for (const std::string& option : options_set_by(e.study)) {
    j.erase(option.substr(2));  // without the dashes
  }
  return j;
}

ResultFolder::ResultFolder(std::string path, const nlohmann::ordered_json& settings, bool resume)
    : path_(std::move(path)) {
  make_folder(path_);
  const std::string file = path_ + "/settings.json";
  if (std::filesystem::exists(file)) {
    if (!resume)
      refuse("--out: " + path_ +
             " has results; go on with them by --resume, or name another folder");
    compare(file, settings);
    return;
  }
  make_folder(path_ + "/runs");
  write("settings.json", settings.dump(2) + "\n");
}

void ResultFolder::save(const Job& job, const Row& row) const {
  write(run_file(job), result_cells(row) + "\n" + time_cells(row) + "\n");
}

std::optional<Row> ResultFolder::read(const Job& job) const {
  const std::string file = path_ + "/" + run_file(job);
  if (!std::filesystem::exists(file)) return std::nullopt;
  const std::string text = must(clothctl::read_file(file));
  const std::size_t first = text.find('\n');
  const std::size_t second = first == std::string::npos ? first : text.find('\n', first + 1);
  if (second == std::string::npos || second + 1 != text.size())
    refuse(file + ": expected two lines; remove it to make the run again");
  Row row;
  const std::string wrong =
      read_row(text.substr(0, first), text.substr(first + 1, second - first - 1), row);
  if (!wrong.empty()) refuse(file + ": " + wrong + "; remove it to make the run again");
  return row;
}

void ResultFolder::write(const std::string& name, const std::string& content) const {
  const std::string file = path_ + "/" + name, beside = file + "." + std::to_string(getpid());
  must(clothctl::write_file(beside, content));
  std::error_code failure;
  std::filesystem::rename(beside, file, failure);
  if (failure) refuse("--out: " + file + ": " + failure.message());
}

std::string table_text(const nlohmann::ordered_json& settings, const std::string& columns,
                       const std::vector<std::string>& lines) {
  std::string text =
      "# clothctl evaluation " + std::to_string(kFormat) + " " + settings.dump() + "\n" + columns;
  text += "\n";
  for (const std::string& line : lines) text += line + "\n";
  return text;
}

}  // namespace program
