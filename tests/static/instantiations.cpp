// The whole library in float and double, or with CLOTHCTL_FLOAT_ALONE in float; see
// instantiations.inc.

#include <clothctl/clothctl.hpp>

#define CLOTHCTL_SCALAR float
#include "instantiations.inc"
#ifndef CLOTHCTL_FLOAT_ALONE
#undef CLOTHCTL_SCALAR
#define CLOTHCTL_SCALAR double
#include "instantiations.inc"
#endif
