#pragma once

// Everything in clothctl/robot.

#include "clothctl/robot/forward_dynamics.hpp"
#include "clothctl/robot/half_space_kinematics.hpp"
#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/ik_problem.hpp"
#include "clothctl/robot/ik_report.hpp"
#include "clothctl/robot/ik_task.hpp"
#include "clothctl/robot/inverse_dynamics.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/joint.hpp"
#include "clothctl/robot/kinematics.hpp"
#include "clothctl/robot/limited_bfgs.hpp"
#include "clothctl/robot/limited_step.hpp"
#include "clothctl/robot/mass_matrix.hpp"
#include "clothctl/robot/motion.hpp"
#include "clothctl/robot/priority_kinematics.hpp"
#include "clothctl/robot/stable_pd.hpp"
#include "clothctl/robot/task_priority.hpp"
#include "clothctl/robot/tree.hpp"
#include "clothctl/robot/tree_builder.hpp"
#include "clothctl/robot/tree_model.hpp"
