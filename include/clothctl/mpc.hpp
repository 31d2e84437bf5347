#pragma once

// Features, prediction over a window, condensed programs and the planner.

#include "clothctl/mpc/condense.hpp"
#include "clothctl/mpc/exact_predictor.hpp"
#include "clothctl/mpc/features.hpp"
#include "clothctl/mpc/hand_anchor.hpp"
#include "clothctl/mpc/window.hpp"
