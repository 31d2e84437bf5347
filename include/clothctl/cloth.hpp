#pragma once

// Models of spring networks and their settings.

#include "clothctl/cloth/carried_vertices.hpp"
#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/mass_spring_derivative.hpp"
#include "clothctl/cloth/mass_spring_impulses.hpp"
#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/cloth/mass_spring_rollout.hpp"
#include "clothctl/cloth/mass_spring_settings.hpp"
#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/cloth/position_based_settings.hpp"
#include "clothctl/cloth/settle.hpp"
#include "clothctl/cloth/tearable_sheet.hpp"
