#pragma once

// Scalars, matrix types, the state of a sheet, statuses, reports and results.

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/longest_axis.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/quoted_text.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/scalar.hpp"
#include "clothctl/core/simd.hpp"
#include "clothctl/core/snapshot.hpp"
#include "clothctl/core/status.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/core/types.hpp"
