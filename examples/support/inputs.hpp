#pragma once

// Values named on a command line, with their checks. A bad value ends the program.

#include <string>
#include <vector>

#include "clothctl/network/materials.hpp"

namespace program {

/// Reads a preset by name, or a JSON file with the quantities of clothctl::Material.
clothctl::Material<double> read_material(const std::string& name);

/// Reads a list of vertex indices separated by commas; `option` is the name for messages.
std::vector<int> read_vertices(const std::string& list, const std::string& option);

/// Returns the files of --curves, with folders replaced by their CSV files, in order of their
/// names.
std::vector<std::string> curve_files(const std::vector<std::string>& given);

}  // namespace program
