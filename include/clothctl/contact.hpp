#pragma once

// Friction cones, grips and the patches of cloth that they hold.

#include "clothctl/contact/friction_cone.hpp"
#include "clothctl/contact/grip.hpp"
#include "clothctl/contact/patch.hpp"
