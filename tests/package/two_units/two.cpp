// The unit that may be compiled for another instruction set.

#include "checks.hpp"
#include "units.hpp"

namespace two {

double factor_error() { return error_of_factor<float>(); }
double step_error() { return error_of_step<float>(); }

}  // namespace two
