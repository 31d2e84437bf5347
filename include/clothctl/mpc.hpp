#pragma once

// The planner: condensed programs over a window, plans, one frame of control.

#include "clothctl/mpc/command_window.hpp"
#include "clothctl/mpc/hand_anchor.hpp"
#include "clothctl/mpc/loose_plant.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/planner_settings.hpp"
#include "clothctl/mpc/pose_forces.hpp"
#include "clothctl/mpc/reachability.hpp"
#include "clothctl/mpc/reachable_targets.hpp"
#include "clothctl/mpc/run_frame.hpp"
#include "clothctl/mpc/stepped_plant.hpp"
#include "clothctl/mpc/whole_curve.hpp"
