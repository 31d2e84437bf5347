#pragma once

// The adapter of our own worlds.

#include "engine.hpp"

namespace versus {

/// Worlds with a mass-spring sheet and with position-based ones.
Entry clothctl_entry();

}  // namespace versus
