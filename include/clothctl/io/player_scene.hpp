#pragma once

// What a player page shows besides the recorded motion.

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl {

/// The parts of a player page that do not move. Texts are UTF-8 and may hold anything: they are escaped.
struct PlayerScene {
  /// Heading of the page.
  std::string title{};
  /// One line under the heading; may be empty.
  std::string subtitle{};
  /// Time between frames (s, positive).
  double dt = 0.02;
  /// Triangles of the mesh as indices of vertices; may be empty.
  std::vector<std::array<int, 3>> triangles{};
  /// Segments of a rope as indices of vertices, drawn as thick lines; may be empty.
  std::vector<std::array<int, 2>> segments{};
  /// Rows of the table of figures: name and value, shown as they are.
  std::vector<std::pair<std::string, std::string>> figures{};
  /// Names of the features; missing ones are numbered.
  std::vector<std::string> feature_names{};
  /// What the mesh is; where it is empty: "Sheet", or "Rope" without triangles.
  std::string mesh_name{};
  /// What the arrows stand for.
  std::string arrow_name = "Forces";
  /// Unit of the arrows' lengths.
  std::string arrow_unit = "N";
  /// The first so many frames count for the mean line of the error plot; zero means all.
  Index scored_frames = 0;
};

}  // namespace clothctl
