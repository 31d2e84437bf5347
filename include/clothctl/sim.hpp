#pragma once

// Everything in clothctl/sim.

#include "clothctl/sim/pad_contacts.hpp"
