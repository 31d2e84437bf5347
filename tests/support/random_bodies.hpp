#pragma once

// Random ropes, sheets and balls with random materials, steps and motions of their hands: what the
// robustness tests of the cloth models run.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/mesh/tetrahedra.hpp"
#include "clothctl/network/rope.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/network/solid.hpp"

namespace clothctl_test {

using clothctl::BendStencil;
using clothctl::ClothInput;
using clothctl::ClothState;
using clothctl::Index;
using clothctl::Points;
using clothctl::Spring;
using clothctl::SpringNetwork;
using clothctl::Vector3;
using clothctl::VectorX;

/// Random numbers that are the same on every platform.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return low + (high - low) * (static_cast<double>(engine_() >> 11) / 9007199254740992.0);
  }
  double decades(double low, double high) { return std::pow(10.0, uniform(low, high)); }
  bool chance(double share) { return uniform(0, 1) < share; }
  int whole(int low, int high) {
    return std::min(high, low + static_cast<int>(uniform(0, high - low + 1)));
  }
  Vector3<double> vector(double size) {
    const double x = uniform(-size, size), y = uniform(-size, size), z = uniform(-size, size);
    return {x, y, z};
  }

 private:
  std::mt19937_64 engine_;
};

inline SpringNetwork<double> random_sheet(Draw& draw, double size, bool hinged) {
  clothctl::Material<double> material;
  material.area_density = draw.decades(-2, 1);
  material.set_stretch(draw.decades(0, 5));
  material.shear = material.stretch_warp * draw.decades(-3, 0);
  material.set_bending(draw.chance(0.2) ? 0.0 : draw.decades(-8, -2));
  material.damping_time = draw.chance(0.5) ? 0.0 : draw.decades(-5, -1);
  const int rows = draw.whole(2, 8), cols = draw.whole(2, 8);
  const double height = size * draw.decades(-1, 0);
  const clothctl::GridMesh<double> grid =
      clothctl::make_grid<double>(rows, cols, size, height).value();
  if (!hinged) return clothctl::sheet_network(grid, material).value();
  return clothctl::sheet_network<double>(grid.positions, grid.triangles, material).value();
}

inline SpringNetwork<double> random_rope(Draw& draw, double size) {
  clothctl::RopeSettings<double> settings;
  settings.segments = draw.whole(1, 20);
  settings.length = size;
  settings.mass_per_length = draw.decades(-3, 0);
  settings.stretch = draw.decades(0, 5);
  settings.bending = draw.decades(-8, -2);
  settings.damping_time = draw.chance(0.5) ? 0.0 : draw.decades(-5, -1);
  return clothctl::rope_network(settings).value();
}

inline SpringNetwork<double> random_ball(Draw& draw, double size) {
  clothctl::SolidSettings<double> settings;
  settings.density = draw.decades(0, 3);
  settings.youngs_modulus = draw.decades(2, 7);
  settings.damping_time = draw.chance(0.5) ? 0.0 : draw.decades(-5, -1);
  const auto mesh =
      clothctl::make_ball<double>(size / 2, draw.whole(1, 2), Vector3<double>::Zero());
  return clothctl::solid_network<double>(mesh.value(), settings).value();
}

/// A body with its start and the motion of its hands.
struct Trial {
  SpringNetwork<double> network;
  Vector3<double> gravity = Vector3<double>(0, 0, -9.81);
  double drag = 0;
  std::vector<int> pinned;
  ClothState<double> start;
  std::vector<int> driven;
  Vector3<double> stroke = Vector3<double>::Zero();
  double rate = 0, dt = 0;
  /// Phase of every hand but the first, rad.
  double lag = 1;
  /// Vertices with springs to points, their stiffnesses and the way of the points.
  std::vector<int> attached;
  std::vector<double> stiffness;
  Vector3<double> drift = Vector3<double>::Zero();

  /// `hinged`: a sheet has a hinge at each edge between two triangles.
  explicit Trial(std::uint64_t seed, bool hinged) {
    Draw draw(seed);
    const double size = draw.decades(-1, 0.5);
    const int kind = draw.whole(0, 9);
    network = kind < 6   ? random_sheet(draw, size, hinged)
              : kind < 9 ? random_rope(draw, size)
                         : random_ball(draw, size);
    if (draw.chance(0.2)) gravity.setZero();
    if (draw.chance(0.5)) drag = draw.decades(-2, 1);
    const int n = static_cast<int>(network.vertex_count());
    const int hold = draw.whole(0, 2);  // free, pinned, driven
    std::vector<int> held{0, n - 1};
    if (hold == 1) pinned = held;
    if (hold == 2) driven = held;
    stroke = draw.vector(0.4 * size);
    rate = draw.decades(-0.5, 1.2);
    dt = draw.decades(-3.5, -1.2);
    double edge = size;
    for (const Spring<double>& s : network.springs) edge = std::min(edge, s.rest_length);
    const double crumple = edge * draw.decades(-4, -0.3), speed = draw.decades(-2, 1);
    start = {network.rest_positions, Points<double>::Zero(3, n)};
    for (Index i = 0; i < n; ++i) {
      start.positions.col(i) += draw.vector(crumple);
      start.velocities.col(i) = draw.vector(speed);
    }
  }

  /// Lets a sheet rest folded, holds some more of its vertices and attaches others.
  void add_folds(std::uint64_t seed) {
    Draw draw(seed + 1000000007u);
    const double most = draw.decades(-2, 2);
    for (BendStencil<double>& b : network.bends) {
      if (b.count != 4 || !(b.weight[2] < 0) || !(b.weight[3] < 0) || draw.chance(0.2)) continue;
      b.rest_fold = std::tan(draw.uniform(-1, 1) * std::atan(most));
    }
    const int n = static_cast<int>(network.vertex_count());
    std::vector<int>& held = driven.empty() ? pinned : driven;
    if (!held.empty() && draw.chance(0.7)) {
      for (int v = 1; v + 1 < n && v < 4; ++v) held.push_back(v);
    }
    const int count = draw.whole(0, 3);
    for (int j = 0; j < count; ++j) {
      const int v = draw.whole(0, n - 1);
      if (std::find(attached.begin(), attached.end(), v) != attached.end()) continue;
      attached.push_back(v);  // float rounds the mean point of two springs
      stiffness.push_back(draw.decades(-2, 5));
    }
    drift = draw.vector(draw.decades(-2, 1));
  }

  /// Returns the input of step `k`.
  template <class Scalar>
  ClothInput<Scalar> input(int k) const {
    const auto phase = [&](std::size_t j) { return j == 0 ? 0.0 : lag; };
    Points<double> hands(3, static_cast<Index>(driven.size()));
    for (std::size_t j = 0; j < driven.size(); ++j) {
      const double sway = std::sin(rate * dt * (k + 1) + phase(j)) - std::sin(phase(j));
      hands.col(static_cast<Index>(j)) = start.positions.col(driven[j]) + sway * stroke;
    }
    Points<double> points(3, static_cast<Index>(attached.size()));
    VectorX<double> stiffnesses(points.cols());
    for (std::size_t j = 0; j < attached.size(); ++j) {
      const Index i = static_cast<Index>(j);
      points.col(i) = start.positions.col(attached[j]) + dt * (k + 1) * drift;
      stiffnesses[i] = stiffness[j];
    }
    ClothInput<Scalar> out;
    out.driven_vertices = driven;
    out.driven_positions = hands.cast<Scalar>();
    out.attached_vertices = attached;
    out.attached_positions = points.cast<Scalar>();
    out.attachment_stiffness = stiffnesses.cast<Scalar>();
    return out;
  }

  /// Returns the state at the start.
  template <class Scalar>
  ClothState<Scalar> state() const {
    return {start.positions.cast<Scalar>(), start.velocities.cast<Scalar>()};
  }
};

}  // namespace clothctl_test
