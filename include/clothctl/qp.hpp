#pragma once

// Quadratic programs: the problem, the two solvers, and independent checks of a solution (KKT
// conditions) and of a certificate that there is none.

#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"
#include "clothctl/qp/certificate.hpp"
#include "clothctl/qp/kkt.hpp"
#include "clothctl/qp/problem.hpp"
