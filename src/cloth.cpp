// The templates of cloth/ that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/contact.hpp"
#include "clothctl/mesh.hpp"
#include "clothctl/network.hpp"
#include "clothctl/qp.hpp"

// From here on CLOTHCTL_INSTANTIATE defines.
#undef CLOTHCTL_EXTERN
#define CLOTHCTL_EXTERN

#include "clothctl/cloth.hpp"
