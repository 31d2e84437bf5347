#pragma once

// The sheet that is planned for, and the frames that every contender is given: measured states of
// one run, with the targets of their times.

#include <vector>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/planner_settings.hpp"

namespace planner_bench {

using namespace clothctl;
using V = Vector3<double>;

/// What is measured in a frame.
struct Frame {
  /// Positions (m) and velocities (m/s), 3×n.
  Points<double> x, v;
  /// Time, s.
  double t = 0;
};

/// A square sheet of 0.5 m that two pinches hold at the upper corners; its lower corners are the
/// features.
struct Scene {
  int n = 0;
  GridMesh<double> grid;
  MassSpring<double> model;
  PlannerSetup<double> setup;
  std::vector<Frame> frames;

  /// Makes a sheet of n×n vertices and lets it hang for 60 frames. Without frames.
  static Scene make(int n);

  /// Records the frames of a run on the linearly implicit plant: forces planned with a window of
  /// `horizon` frames by the linearised predictor in single precision.
  void record(int count, Index horizon);

  /// The settings of a planner; `roll` adds the damping that rollouts need.
  PlannerSettings<double> settings(GripInput input, Index horizon, bool roll) const;

  /// Returns the vertex that is feature `i`.
  int feature(Index i) const { return grid.vertex(0, i == 0 ? 0 : n - 1); }

  /// Returns where feature `i` should be at time `t` (s), m.
  V target(Index i, double t) const;

 private:
  Scene(int side, GridMesh<double> mesh, MassSpring<double> sheet)
      : n(side), grid(std::move(mesh)), model(std::move(sheet)) {}

  ClothState<double> start_;
};

/// The length of a frame, s.
inline constexpr double kDt = 0.02;

}  // namespace planner_bench
