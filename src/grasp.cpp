// The templates of grasp/ that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/qp.hpp"
#include "clothctl/robot.hpp"
#include "clothctl/sim.hpp"

// From here on CLOTHCTL_INSTANTIATE defines.
#undef CLOTHCTL_EXTERN
#define CLOTHCTL_EXTERN

#include "clothctl/grasp.hpp"
