// The templates of sim/ that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/cloth.hpp"
#include "clothctl/contact.hpp"
#include "clothctl/robot.hpp"

// From here on CLOTHCTL_INSTANTIATE defines.
#undef CLOTHCTL_EXTERN
#define CLOTHCTL_EXTERN

#include "clothctl/sim.hpp"
