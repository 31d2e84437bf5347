// Compiles what instances.hpp declares: in sanitized builds with optimisation, where the tests have
// none.

#define CLOTHCTL_TEST_EXTERN

#include "instances.hpp"
