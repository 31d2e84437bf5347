#pragma once

// What contacts transmit: friction cones, grips and the patches that they hold, and the impulses
// between sheets, bodies and hands.

#include "clothctl/contact/affine_patch.hpp"
#include "clothctl/contact/articulated_response.hpp"
#include "clothctl/contact/contact_models.hpp"
#include "clothctl/contact/contact_solver.hpp"
#include "clothctl/contact/friction_cone.hpp"
#include "clothctl/contact/grip.hpp"
#include "clothctl/contact/impulse_responses.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"
#include "clothctl/contact/obstacle_guard.hpp"
#include "clothctl/contact/sheet_impacts.hpp"
#include "clothctl/contact/sheet_impacts_setup.hpp"
