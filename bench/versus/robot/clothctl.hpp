#pragma once

// The adapter of our own library, and the description of a robot for the others.

#include "peer.hpp"

namespace versus {

/// Reads a robot from a URDF file. Its tips are the links with `tips` in their names. Returns "" or
/// an error.
std::string describe(const std::string& file, const std::string& tips, Model& model);

Entry clothctl_entry();

}  // namespace versus
