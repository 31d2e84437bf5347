#pragma once

// Grids, solids, connectivity and orderings of meshes.

#include "clothctl/mesh/grid.hpp"
#include "clothctl/mesh/ordering.hpp"
#include "clothctl/mesh/tetrahedra.hpp"
#include "clothctl/mesh/topology.hpp"
