#pragma once

// A sheet from the command line: its mesh, material, start and pinned vertices. Bad values end the
// program.

#include <cstdint>
#include <string>
#include <vector>

#include "clothctl/network/materials.hpp"
#include "clothctl/network/spring_network.hpp"
#include "support/plants.hpp"

namespace program {

/// The options that describe a sheet.
struct ClothOptions {
  std::string mesh = "grid:33x33";
  double size = 1;
  bool size_given = false;
  std::string material = "handkerchief";
  std::string start = "hanging";
  std::string pin = "corners";
  std::string wind;
  std::uint64_t seed = 1;
};

/// A sheet before its first step.
struct ClothScene {
  clothctl::Material<double> material;
  clothctl::SpringNetwork<double> network;
  std::vector<int> pinned;
  clothctl::ClothState<double> state;
  Vec wind = Vec::Zero();
  /// Largest extent of the mesh along an axis, m.
  double extent = 0;
};

/// Makes the sheet: the mesh at rest, hanging or turned level about its top edge, every coordinate
/// of a free vertex moved by up to 10⁻⁶ of the extent at random, so that folds may start.
ClothScene make_cloth_scene(const ClothOptions& o);

/// Returns three numbers X,Y,Z; `option` is the name for messages.
Vec read_triple(const std::string& text, const std::string& option);

}  // namespace program
