#pragma once

// The sheets of the comparison: 1 m × 1 m, 0.2 kg/m², horizontal, pinned at two corners of one
// side.

#include "engine.hpp"

namespace versus {

/// N × N vertices in rows; the edges of the cells and one diagonal of each, all in the same
/// direction. A cell gives a quarter of its mass to each corner.
Sheet grid_sheet(int side);

/// The same, but inner vertices are moved by up to 0.3 spacings, those of the border along it, and
/// each cell's diagonal is drawn. A triangle gives a third of its mass to each corner.
Sheet irregular_sheet(int side, unsigned seed);

}  // namespace versus
