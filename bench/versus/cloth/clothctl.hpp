#pragma once

// The adapters of our own models.

#include "engine.hpp"

namespace versus {

/// The position-based model in float: plain sweeps, and with the stretch cap.
Entry clothctl_entry();

/// The implicit sheet that the others' swing is compared with: mass-spring, Newton, in double, 16
/// steps a frame, 10 kN/m on every edge, against compression too.
Entry reference_entry();

}  // namespace versus
