#pragma once

// Everything in clothctl/linalg.

#include "clothctl/linalg/accurate_sum.hpp"
#include "clothctl/linalg/block_cholesky.hpp"
#include "clothctl/linalg/block_symmetric.hpp"
#include "clothctl/linalg/columns.hpp"
#include "clothctl/linalg/elimination_tree.hpp"
#include "clothctl/linalg/nested_dissection.hpp"
#include "clothctl/linalg/row_factor.hpp"
#include "clothctl/linalg/small_cholesky.hpp"
#include "clothctl/linalg/sparse_ldlt.hpp"
#include "clothctl/linalg/tiled_cholesky.hpp"
#include "clothctl/linalg/updatable_cholesky.hpp"
#include "clothctl/linalg/vector_kernels.hpp"
