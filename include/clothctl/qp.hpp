#pragma once

// Quadratic programs: problem, solvers, and the independent check of optimality.

#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"
#include "clothctl/qp/box_method.hpp"
#include "clothctl/qp/budget.hpp"
#include "clothctl/qp/certificate.hpp"
#include "clothctl/qp/dense_curvature.hpp"
#include "clothctl/qp/free_set_factor.hpp"
#include "clothctl/qp/kkt.hpp"
#include "clothctl/qp/low_rank_curvature.hpp"
#include "clothctl/qp/problem.hpp"
#include "clothctl/qp/problem_data.hpp"
#include "clothctl/qp/proof_search.hpp"
#include "clothctl/qp/proximal_problem.hpp"
#include "clothctl/qp/row_factor.hpp"
#include "clothctl/qp/scaling.hpp"
#include "clothctl/qp/structured_box.hpp"
#include "clothctl/qp/tiled_cholesky.hpp"
#include "clothctl/qp/verdict.hpp"
