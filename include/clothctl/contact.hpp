#pragma once

// Friction cones, grips and the patches of cloth that they hold.

#include "clothctl/contact/affine_patch.hpp"
#include "clothctl/contact/articulated_response.hpp"
#include "clothctl/contact/collider_union.hpp"
#include "clothctl/contact/contact_models.hpp"
#include "clothctl/contact/contact_solver.hpp"
#include "clothctl/contact/friction_cone.hpp"
#include "clothctl/contact/grip.hpp"
#include "clothctl/contact/impulse_responses.hpp"
#include "clothctl/contact/mesh_collider.hpp"
#include "clothctl/contact/moving_collider.hpp"
#include "clothctl/contact/shapes.hpp"
#include "clothctl/contact/sheet_contacts.hpp"
