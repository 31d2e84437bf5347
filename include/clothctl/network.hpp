#pragma once

// What a body is made of: masses, springs, materials, and builders of sheets, ropes and solids.

#include "clothctl/network/garment.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/network_change.hpp"
#include "clothctl/network/plastic_creep.hpp"
#include "clothctl/network/rest_folds.hpp"
#include "clothctl/network/rope.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/network/solid.hpp"
#include "clothctl/network/spring_network.hpp"
#include "clothctl/network/surface_distance.hpp"
#include "clothctl/network/tearing.hpp"
#include "clothctl/network/triangle_elements.hpp"
