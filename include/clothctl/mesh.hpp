#pragma once

// Grids, tetrahedral meshes, flat panels, garments, and the connectivity of triangle meshes.

#include "clothctl/mesh/garment.hpp"
#include "clothctl/mesh/garment_patterns.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/mesh/mesh_editor.hpp"
#include "clothctl/mesh/panel.hpp"
#include "clothctl/mesh/panel_outline.hpp"
#include "clothctl/mesh/pattern_mesh.hpp"
#include "clothctl/mesh/remap.hpp"
#include "clothctl/mesh/stitch.hpp"
#include "clothctl/mesh/surface_cut.hpp"
#include "clothctl/mesh/tetrahedra.hpp"
#include "clothctl/mesh/topology.hpp"
