#pragma once

// Files: comma-separated tables, target curves, meshes, quadratic programs and player pages. The
// umbrella header does not include them.

#include "clothctl/io/csv.hpp"
#include "clothctl/io/file.hpp"
#include "clothctl/io/html_player.hpp"
#include "clothctl/io/obj.hpp"
#include "clothctl/io/player_scene.hpp"
#include "clothctl/io/qp_problem.hpp"
#include "clothctl/io/qps.hpp"
#include "clothctl/io/qpt.hpp"
#include "clothctl/io/qpt_writer.hpp"
#include "clothctl/io/targets.hpp"
