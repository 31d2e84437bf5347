// The whole library in double, for clang-tidy; see instantiations.inc.

#include <clothctl/clothctl.hpp>
#include <clothctl/io.hpp>

#define CLOTHCTL_SCALAR double
#include "instantiations.inc"
