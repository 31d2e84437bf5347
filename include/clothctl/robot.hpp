#pragma once

// Everything in clothctl/robot.

#include "clothctl/robot/constrained_ik.hpp"
#include "clothctl/robot/forward_dynamics.hpp"
#include "clothctl/robot/forward_kinematics.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/ik_task.hpp"
#include "clothctl/robot/inverse_dynamics.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/kinematic_tree.hpp"
#include "clothctl/robot/kinematic_tree_builder.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "clothctl/robot/prioritised_ik.hpp"
#include "clothctl/robot/stable_pd.hpp"
