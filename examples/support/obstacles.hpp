#pragma once

// Obstacles from the command line, as colliders and as triangles for the page.

#include <string>
#include <vector>

#include "clothctl/sim/world.hpp"
#include "support/plants.hpp"

namespace program {

/// The forms that `--obstacle` takes.
inline constexpr char kObstacleHelp[] =
    "What the sheet may touch; may be repeated: sphere:X,Y,Z,RADIUS, box:X,Y,Z,A,B,C (middle and "
    "edges), capsule:X,Y,Z,X,Y,Z,RADIUS, cylinder:X,Y,Z,X,Y,Z,RADIUS, floor:Z, or FILE.obj (a "
    "closed mesh), m";

/// Adds the obstacles that the texts describe to a world. Returns the corners of their triangles
/// (3×3t, m). Bad texts end the program.
Points add_obstacles(const std::vector<std::string>& texts, double friction,
                     clothctl::World<double>& world);

}  // namespace program
