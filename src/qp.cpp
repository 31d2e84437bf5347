// The templates of qp/ that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/math.hpp"

// From here on CLOTHCTL_INSTANTIATE defines.
#undef CLOTHCTL_EXTERN
#define CLOTHCTL_EXTERN

#include "clothctl/qp.hpp"
