#pragma once

// The whole library but io/, which reads and writes files, and bridge/, whose adapters each need a
// library of their own.

#include "clothctl/cloth.hpp"
#include "clothctl/collision.hpp"
#include "clothctl/concepts.hpp"
#include "clothctl/config.hpp"
#include "clothctl/contact.hpp"
#include "clothctl/core.hpp"
#include "clothctl/estimate.hpp"
#include "clothctl/grasp.hpp"
#include "clothctl/linalg.hpp"
#include "clothctl/math.hpp"
#include "clothctl/mesh.hpp"
#include "clothctl/mpc.hpp"
#include "clothctl/network.hpp"
#include "clothctl/prediction.hpp"
#include "clothctl/qp.hpp"
#include "clothctl/robot.hpp"
#include "clothctl/sim.hpp"
