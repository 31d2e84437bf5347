// The templates of robot/ that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/math.hpp"
#include "clothctl/qp.hpp"

// From here on CLOTHCTL_INSTANTIATE defines.
#undef CLOTHCTL_EXTERN
#define CLOTHCTL_EXTERN

#include "clothctl/robot.hpp"
