#pragma once

// Features, prediction over a window, condensed programs and the planner.

#include "clothctl/mpc/condense.hpp"
#include "clothctl/mpc/exact_predictor.hpp"
#include "clothctl/mpc/features.hpp"
#include "clothctl/mpc/grip_basis.hpp"
#include "clothctl/mpc/hand_anchor.hpp"
#include "clothctl/mpc/held_patches.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/planner_settings.hpp"
#include "clothctl/mpc/rigid_command.hpp"
#include "clothctl/mpc/rollout_predictor.hpp"
#include "clothctl/mpc/term_stack.hpp"
#include "clothctl/mpc/window.hpp"
#include "clothctl/mpc/window_cost.hpp"
#include "clothctl/mpc/window_qp.hpp"
