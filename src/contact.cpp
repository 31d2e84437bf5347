// The templates of contact/ that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/collision.hpp"
#include "clothctl/robot.hpp"

// From here on CLOTHCTL_INSTANTIATE defines.
#undef CLOTHCTL_EXTERN
#define CLOTHCTL_EXTERN

#include "clothctl/contact.hpp"
