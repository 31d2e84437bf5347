#pragma once

// Collision geometry: shapes, meshes, unions and moving colliders, and where a sheet touches them.

#include "clothctl/collision/body_contacts.hpp"
#include "clothctl/collision/collider_union.hpp"
#include "clothctl/collision/convex_shape.hpp"
#include "clothctl/collision/mesh_collider.hpp"
#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/collision/self_contacts.hpp"
#include "clothctl/collision/shapes.hpp"
#include "clothctl/collision/sheet_collider.hpp"
#include "clothctl/collision/sheet_contacts.hpp"
#include "clothctl/collision/triangle_sweep.hpp"
