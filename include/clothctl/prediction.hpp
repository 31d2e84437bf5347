#pragma once

// Features, and how they are predicted to move over a window of frames.

#include "clothctl/prediction/coarse_predictor.hpp"
#include "clothctl/prediction/features.hpp"
#include "clothctl/prediction/identify.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"
#include "clothctl/prediction/motion_record.hpp"
#include "clothctl/prediction/rollout_predictor.hpp"
#include "clothctl/prediction/sheet_sampling.hpp"
#include "clothctl/prediction/simulator_predictor.hpp"
#include "clothctl/prediction/window.hpp"
#include "clothctl/prediction/window_jacobian.hpp"
