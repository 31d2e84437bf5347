#pragma once

// The interface to every cloth engine of the comparison. It consists of names and arrays of
// numbers, so that libraries compiled with other processor flags (and other memory layouts of
// Eigen) can take part. All adapters but our own are modules that the program opens.

#include <array>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "../support/module_entry.hpp"

namespace versus {

/// An edge that an engine keeps at its length, by one distance constraint.
struct Edge {
  int a = 0, b = 0;
  /// Distance of the vertices at rest (m).
  float length = 0;
  /// A diagonal of a cell; the other edges are structural.
  bool diagonal = false;
};

/// A sheet in the plane z = 0, at rest. Gravity is (0, 0, -9.81) m/s².
struct Sheet {
  /// "grid" or "irregular".
  std::string mesh;
  /// Vertices along a side.
  int side = 0;
  /// Three coordinates a vertex (m).
  std::vector<double> positions;
  /// Masses (kg), of pinned vertices too.
  std::vector<double> mass;
  std::vector<int> pinned;
  std::vector<Edge> edges;
  std::vector<std::array<int, 3>> triangles;

  int n() const { return static_cast<int>(mass.size()); }
};

inline constexpr double kGravity = 9.81;

/// What a frame costs: the equal parts it is divided into, and the sweeps over all edges in a part.
struct Setting {
  int substeps = 1, sweeps = 1;

  int sweeps_a_frame() const { return substeps * sweeps; }
};

/// An engine with a sheet.
class Engine {
 public:
  virtual ~Engine() = default;
  /// Makes the sheet. Returns "" or the reason for a failure.
  virtual std::string load(const Sheet& sheet, const Setting& setting) = 0;
  /// Advances by dt (s); timed.
  virtual void frame(double dt) = 0;
  /// Writes positions and velocities at the end of the frame, three numbers a vertex; not timed.
  virtual void read(double* positions, double* velocities) = 0;
  /// Multiplies all velocities by a factor: the damping that brings a sheet to rest; not timed.
  virtual void scale_velocities(double factor) = 0;
};

/// One way to use an engine, with one number that makes it better and dearer.
struct Variant {
  /// Name, after that of the engine.
  std::string name;
  /// Which number of the setting grows; the other one is fixed.
  bool grows_substeps = true;
  int fixed = 1;
  /// The least number.
  int start = 1;
  /// Setting of the timed projections, or 0 substeps if the variant does more than to project
  /// edges.
  Setting throughput = {0, 0};
  std::function<std::unique_ptr<Engine>()> make;

  Setting setting(int number) const {
    return grows_substeps ? Setting{number, fixed} : Setting{fixed, number};
  }
};

/// An engine of the comparison.
struct Entry {
  std::string name, version;
  std::vector<Variant> variants;
};

}  // namespace versus
