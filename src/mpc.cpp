// The templates of mpc/ that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/cloth.hpp"
#include "clothctl/contact.hpp"
#include "clothctl/prediction.hpp"
#include "clothctl/qp.hpp"

// From here on CLOTHCTL_INSTANTIATE defines.
#undef CLOTHCTL_EXTERN
#define CLOTHCTL_EXTERN

#include "clothctl/mpc.hpp"
