#pragma once

// Everything in clothctl/grasp.

#include "clothctl/grasp/fingertip_tracker.hpp"
#include "clothctl/grasp/grasp_controller.hpp"
#include "clothctl/grasp/grasp_poses.hpp"
#include "clothctl/grasp/grasp_sequence.hpp"
#include "clothctl/grasp/grasp_types.hpp"
#include "clothctl/grasp/hand_geometry.hpp"
#include "clothctl/grasp/held_grips.hpp"
#include "clothctl/grasp/joint_path_planner.hpp"
#include "clothctl/grasp/keyframe_path.hpp"
#include "clothctl/grasp/rectify.hpp"
#include "clothctl/grasp/robot_clearance.hpp"
#include "clothctl/grasp/static_contacts.hpp"
