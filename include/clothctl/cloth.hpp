#pragma once

// Models of sheets, ropes and solids, their materials and settings.

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/cloth/mass_spring_settings.hpp"
#include "clothctl/cloth/materials.hpp"
#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/cloth/position_based_settings.hpp"
#include "clothctl/cloth/rope.hpp"
#include "clothctl/cloth/settle.hpp"
#include "clothctl/cloth/sheet.hpp"
#include "clothctl/cloth/solid.hpp"
#include "clothctl/cloth/spring_network.hpp"
