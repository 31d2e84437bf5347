// The templates of collision/ that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/math.hpp"
#include "clothctl/mesh.hpp"

// From here on CLOTHCTL_INSTANTIATE defines.
#undef CLOTHCTL_EXTERN
#define CLOTHCTL_EXTERN

#include "clothctl/collision.hpp"
