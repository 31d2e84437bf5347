// The templates of prediction/ that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/cloth.hpp"

// From here on CLOTHCTL_INSTANTIATE defines.
#undef CLOTHCTL_EXTERN
#define CLOTHCTL_EXTERN

#include "clothctl/prediction.hpp"
