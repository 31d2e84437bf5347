// The whole library with a scalar that allows no silent conversion; see instantiations.inc.

#include "explicit_scalar.hpp"

#include <clothctl/clothctl.hpp>

#define CLOTHCTL_EXPLICIT_SCALAR
#define CLOTHCTL_SCALAR clothctl_test::ExplicitDouble
#include "instantiations.inc"
