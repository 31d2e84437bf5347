#pragma once

// What the units offer to main.cpp, which sees nothing of the library.

namespace one {
bool makes_memory();
double factor_error();
double step_error();
}  // namespace one

namespace two {
double factor_error();
double step_error();
}  // namespace two
