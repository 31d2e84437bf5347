// The templates of network/ that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/mesh.hpp"

// From here on CLOTHCTL_INSTANTIATE defines.
#undef CLOTHCTL_EXTERN
#define CLOTHCTL_EXTERN

#include "clothctl/network.hpp"
