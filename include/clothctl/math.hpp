#pragma once

// Curves, sparse block matrices and their factors.

#include "clothctl/math/b_spline.hpp"
#include "clothctl/math/block_cholesky.hpp"
#include "clothctl/math/block_symmetric.hpp"
#include "clothctl/math/dense_kernels.hpp"
#include "clothctl/math/front_layout.hpp"
#include "clothctl/math/horn.hpp"
#include "clothctl/math/pack.hpp"
#include "clothctl/math/small_cholesky.hpp"
#include "clothctl/math/solve_kernels.hpp"
