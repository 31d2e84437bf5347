#pragma once

// Quadratic programs: problem, solvers, and the independent check of optimality.

#include "clothctl/qp/free_set_factor.hpp"
#include "clothctl/qp/kkt.hpp"
#include "clothctl/qp/problem.hpp"
#include "clothctl/qp/tiled_cholesky.hpp"
