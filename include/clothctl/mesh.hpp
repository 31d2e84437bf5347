#pragma once

// Grids, tetrahedral meshes and the connectivity of triangle meshes.

#include "clothctl/mesh/grid.hpp"
#include "clothctl/mesh/tetrahedra.hpp"
#include "clothctl/mesh/topology.hpp"
