#pragma once

// Steps a garment, records it for a player page and counts its time, while its mesh changes from
// open to sewn.

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "clothctl/cloth/position_based.hpp"
#include "clothctl/io/html_player.hpp"
#include "clothctl/mesh/garment.hpp"
#include "support/timing.hpp"

namespace program {

/// A garment in motion. All recorded frames have the vertices of the open garment, so that one page
/// shows the sewing and what follows.
class Workshop {
 public:
  using Network = clothctl::SpringNetwork<double>;
  using Settings = clothctl::PositionBasedSettings<double>;

  /// Starts at the places of the garment. `all` frames of `dt` (s) are expected; every second one
  /// is recorded if `record` is set.
  Workshop(const clothctl::Garment& garment, clothctl::PlayerScene scene, double dt, long all,
           bool record);

  /// Advances `state` by `count` frames. `vertex_of` gives the vertex of the network for each one
  /// of the open garment. Returns whether all was finite.
  bool advance(const Network& network, const Settings& settings, int count,
               const std::vector<int>& vertex_of);

  /// Adds time figures, prints all figures (as one JSON object if `json`) and, if `out` is a
  /// folder, writes its player.html and shirt.obj.
  void finish(const std::string& out, bool json, const clothctl::PatternMesh& mesh);

  clothctl::ClothState<double> state;
  nlohmann::ordered_json figures;
  long frames = 0;

 private:
  clothctl::PlayerRecorder page_;
  Progress progress_;
  double dt_;
  long all_;
  bool record_;
  double seconds_ = 0;  // of processor time in steps
};

}  // namespace program
