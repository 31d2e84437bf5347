#pragma once

// Scalars, statuses, reports, results and the values that everything shares.

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/executor.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/scalar.hpp"
#include "clothctl/core/status.hpp"
#include "clothctl/core/types.hpp"
