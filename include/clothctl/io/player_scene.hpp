#pragma once

// The content of a player page besides the recorded motion.

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The parts of a player page that do not move. Texts are UTF-8. They may hold any characters,
/// since the page escapes them.
struct PlayerScene {
  /// Heading of the page.
  std::string title{};
  /// One line under the heading; may be empty.
  std::string subtitle{};
  /// Time between frames, s, positive.
  double dt = 0.02;
  /// Triangles of the mesh as vertex indices; may be empty.
  std::vector<std::array<int, 3>> triangles{};
  /// Segments of a rope as vertex indices, drawn as thick lines; may be empty.
  std::vector<std::array<int, 2>> segments{};
  /// Corners of the triangles of what does not move (3×3t, m, three columns a triangle, in the
  /// order that makes normals point outwards): a table, a body. Drawn as solids; may be empty.
  Points<double> solids = Points<double>(3, 0);
  /// Rows of the table of figures: a name and a value, shown unchanged.
  std::vector<std::pair<std::string, std::string>> figures{};
  /// Names of the features. Features without a name get a number.
  std::vector<std::string> feature_names{};
  /// Label of the mesh. Empty means "Sheet", or "Rope" if there are no triangles.
  std::string mesh_name{};
  /// Label of the arrows.
  std::string arrow_name = "Forces";
  /// Unit of the arrows' lengths.
  std::string arrow_unit = "N";
  /// Number of frames, from the first on, over which the error plot takes its mean; zero means all.
  Index scored_frames = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
