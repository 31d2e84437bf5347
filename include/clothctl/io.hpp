#pragma once

// Files: comma-separated tables, targets, quadratic programs, players. Not part of the umbrella header.

#include "clothctl/io/base64.hpp"
#include "clothctl/io/csv.hpp"
#include "clothctl/io/file.hpp"
#include "clothctl/io/html_player.hpp"
#include "clothctl/io/player_control_script.hpp"
#include "clothctl/io/player_data_script.hpp"
#include "clothctl/io/player_markup.hpp"
#include "clothctl/io/player_plot_script.hpp"
#include "clothctl/io/player_render_script.hpp"
#include "clothctl/io/player_scene.hpp"
#include "clothctl/io/player_style.hpp"
#include "clothctl/io/player_text.hpp"
#include "clothctl/io/player_view_script.hpp"
#include "clothctl/io/qp_problem.hpp"
#include "clothctl/io/qps.hpp"
#include "clothctl/io/qps_fields.hpp"
#include "clothctl/io/qpt.hpp"
#include "clothctl/io/qpt_text.hpp"
#include "clothctl/io/targets.hpp"
#include "clothctl/io/token_reader.hpp"
