#pragma once

// Our own adapter, and what the others are told of a robot.

#include "peer.hpp"

namespace versus {

/// Reads a robot from a URDF file; its tips are the links with `tips` in their names. "" or what is
/// wrong.
std::string describe(const std::string& file, const std::string& tips, Model& model);

Entry clothctl_entry();

}  // namespace versus
