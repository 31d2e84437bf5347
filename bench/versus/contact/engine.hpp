#pragma once

// The interface to every engine of the comparison: names and arrays of numbers, so that libraries
// with other processor flags can take part. All adapters but our own are modules that the program
// opens.

#include <array>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "../support/module_entry.hpp"

namespace versus {

/// An edge of the sheet, by its vertices.
struct Edge {
  int a = 0, b = 0;
};

/// An obstacle around the origin that never moves.
struct Obstacle {
  bool box = false;
  /// Radius of the sphere, or half the sides of the cube (m).
  double size = 0.3;
  double friction = 0.4;
};

/// A level sheet at rest above an obstacle. Gravity is (0, 0, -9.81) m/s².
struct Scene {
  /// Vertices along a side of 1 m, in rows.
  int side = 33;
  /// Three coordinates a vertex (m), and masses (kg).
  std::vector<double> positions, mass;
  std::vector<Edge> edges;
  std::vector<std::array<int, 3>> triangles;
  Obstacle obstacle;
  /// Whether the sheet meets itself.
  bool self = false;
  /// Equal parts that a frame is divided into.
  int substeps = 1;

  int n() const { return static_cast<int>(mass.size()); }
};

inline constexpr double kGravity = 9.81;

/// An engine with a sheet on an obstacle.
class Engine {
 public:
  virtual ~Engine() = default;
  /// Makes the scene. Returns "" or the reason for a failure.
  virtual std::string load(const Scene& scene) = 0;
  /// Advances by dt (s); timed.
  virtual void frame(double dt) = 0;
  /// Writes the positions, three numbers a vertex; not timed.
  virtual void read(double* positions) = 0;
};

/// Which scenes a variant is for.
enum class Use { Always, OnlySelf };

/// One setting of an engine.
struct Variant {
  std::string name;
  /// Distance from obstacles at which the sheet is to rest (m).
  double gap = 0;
  Use use = Use::Always;
  /// Takes part only when it is asked for by name.
  bool extra = false;
  std::function<std::unique_ptr<Engine>()> make;
};

/// An engine of the comparison.
struct Entry {
  std::string name, version;
  std::vector<Variant> variants;
};

}  // namespace versus
