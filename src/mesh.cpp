// The templates of mesh/ that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/core.hpp"

// From here on CLOTHCTL_INSTANTIATE defines.
#undef CLOTHCTL_EXTERN
#define CLOTHCTL_EXTERN

#include "clothctl/mesh.hpp"
