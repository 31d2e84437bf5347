#include "support/inputs.hpp"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <system_error>

#include "clothctl/io/file.hpp"
#include "support/options.hpp"

namespace program {

clothctl::Material<double> read_material(const std::string& name) {
  if (name.find('.') == std::string::npos && name.find('/') == std::string::npos)
    return must(clothctl::material_preset<double>(name));
  const std::string text = must(clothctl::read_file(name));
  nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
  if (json.is_discarded() || !json.is_object()) refuse(name + ": not a JSON object");
  clothctl::Material<double> material;
  material.name = name;
  for (const auto& [key, value] : json.items()) {  // "stretch" comes before "stretch_warp"
    if (key == "name" && value.is_string()) {
      material.name = value.get<std::string>();
      continue;
    }
    double both = 0;
    double* quantity = key == "area_density"   ? &material.area_density
                       : key == "stretch"      ? &both
                       : key == "stretch_warp" ? &material.stretch_warp
                       : key == "stretch_weft" ? &material.stretch_weft
                       : key == "shear"        ? &material.shear
                       : key == "bending"      ? &both
                       : key == "bending_warp" ? &material.bending_warp
                       : key == "bending_weft" ? &material.bending_weft
                       : key == "damping_time" ? &material.damping_time
                       : key == "drag"         ? &material.drag
                       : key == "friction"     ? &material.friction
                       : key == "air_normal"   ? &material.air_normal
                       : key == "air_tangent"  ? &material.air_tangent
                                               : nullptr;
    if (quantity == nullptr) refuse(name + ": unknown quantity \"" + key + "\"");
    if (!value.is_number())
      refuse(name + ": " + key + " is " + value.dump() + ", expected a number");
    *quantity = value.get<double>();
    if (key == "stretch") material.set_stretch(both);
    if (key == "bending") material.set_bending(both);
  }
  if (std::string problem = material.validate(); !problem.empty()) refuse(problem);
  return material;
}

std::vector<int> read_vertices(const std::string& list, const std::string& option) {
  std::vector<int> out;
  std::stringstream stream(list);
  for (std::string cell; std::getline(stream, cell, ',');) {
    char* end = nullptr;
    const long value = std::strtol(cell.c_str(), &end, 10);
    if (cell.empty() || *end != '\0' || value < -1000000000 || value > 1000000000)
      refuse(option + ": \"" + cell + "\" is not a vertex index");
    if (std::find(out.begin(), out.end(), value) != out.end())
      refuse(option + ": vertex " + std::to_string(value) + " occurs twice");
    out.push_back(static_cast<int>(value));
  }
  return out;
}

std::vector<std::string> curve_files(const std::vector<std::string>& given) {
  std::vector<std::string> files;
  for (const std::string& path : given) {
    if (!std::filesystem::is_directory(path)) {
      files.push_back(path);
      continue;
    }
    std::vector<std::string> inside;
    std::error_code failure;
    for (const auto& entry : std::filesystem::directory_iterator(path, failure)) {
      if (entry.path().extension() == ".csv") inside.push_back(entry.path().string());
    }
    if (failure) refuse("--curves: " + path + ": " + failure.message());
    if (inside.empty()) refuse("--curves: " + path + " has no .csv file");
    std::sort(inside.begin(), inside.end());
    files.insert(files.end(), inside.begin(), inside.end());
  }
  return files;
}

}  // namespace program
