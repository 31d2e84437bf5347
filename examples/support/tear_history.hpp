#pragma once

// The frames of a run whose mesh changes, for the player's page.

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "clothctl/io/player_scene.hpp"
#include "clothctl/mesh/remap.hpp"

namespace program {

/// Frames with different numbers of vertices. On the page all frames have the vertices of the last
/// one: a vertex that was doubled later has two copies in one place.
class TearHistory {
 public:
  /// Adds the positions of a frame, 3×vertices, m.
  void add_frame(const clothctl::Points<double>& x);
  /// Adds a change of the mesh after the last frame.
  void add_change(const clothctl::Remap<double>& remap) { changes_.push_back(remap); }
  /// Returns the number of frames.
  long frame_count() const { return static_cast<long>(frames_.size()); }
  /// Writes player.html to a folder. The scene has the triangles of the
  /// last mesh; `figures` become its table. Ends the program on failure.
  void write(clothctl::PlayerScene scene, clothctl::Index vertices, const std::string& folder,
             const nlohmann::ordered_json& figures) const;

 private:
  std::vector<clothctl::Points<double>> frames_;
  std::vector<std::size_t> changes_before_;  // of each frame
  std::vector<clothctl::Remap<double>> changes_;
};

}  // namespace program
