#pragma once

// How far a sheet has slid under soft pads, measured on the sheet at rest.

#include <span>

#include "clothctl/sim/world.hpp"

namespace program {

/// Returns the points of the undeformed sheet, at `rest` (3×n, m), that the samples of pads touch
/// (3 × pads · samples); NaN for those that touch nothing.
clothctl::Points<double> touched_at_rest(const clothctl::World<double>& world,
                                         std::span<const int> pads, clothctl::Index samples,
                                         const clothctl::Points<double>& rest);

/// Returns the length of the mean of the ways (3×n, m) that are finite; 0 for none.
double mean_way(const clothctl::Points<double>& ways);

}  // namespace program
