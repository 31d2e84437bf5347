// The whole library in float and double; see instantiations.inc.

#include <clothctl/clothctl.hpp>

#define CLOTHCTL_SCALAR float
#include "instantiations.inc"
#undef CLOTHCTL_SCALAR
#define CLOTHCTL_SCALAR double
#include "instantiations.inc"
