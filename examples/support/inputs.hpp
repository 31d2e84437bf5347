#pragma once

// Values that a command line names, with their checks. Bad ones end the program.

#include <string>
#include <vector>

#include "clothctl/cloth/materials.hpp"

namespace program {

/// Reads a preset's name, or a JSON file with the quantities of clothctl::Material.
clothctl::Material<double> read_material(const std::string& name);

/// Reads a list of vertex indices with commas between them, as --features takes it.
std::vector<int> read_vertices(const std::string& list);

}  // namespace program
