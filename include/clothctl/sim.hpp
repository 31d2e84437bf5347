#pragma once

// Everything in clothctl/sim.

#include "clothctl/sim/contact_summary.hpp"
#include "clothctl/sim/hand_setup.hpp"
#include "clothctl/sim/pad_contacts.hpp"
#include "clothctl/sim/rigid_bodies.hpp"
#include "clothctl/sim/rigid_setup.hpp"
#include "clothctl/sim/world.hpp"
#include "clothctl/sim/world_setup.hpp"
