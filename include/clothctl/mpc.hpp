#pragma once

// Features, prediction over a window, condensed programs and the planner.

#include "clothctl/mpc/coarse_predictor.hpp"
#include "clothctl/mpc/features.hpp"
#include "clothctl/mpc/hand_anchor.hpp"
#include "clothctl/mpc/linearised_predictor.hpp"
#include "clothctl/mpc/loose_plant.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/planner_settings.hpp"
#include "clothctl/mpc/rollout_predictor.hpp"
#include "clothctl/mpc/run_frame.hpp"
#include "clothctl/mpc/sheet_sampling.hpp"
#include "clothctl/mpc/window.hpp"
