#pragma once

// The scenes of the tests of prediction and planning: sheets that hang from their two upper
// corners, targets for their lower corners, and the loop of planner and plant.

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/concepts/cloth.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"

namespace clothctl_test {

using clothctl::Index;

/// Length of a frame, s.
inline constexpr double kFrame = 0.02;

/// A square sheet at rest. It hangs from its two upper corners, which are held at 90 % of their
/// distance in the flat sheet.
struct HangingSheet {
  clothctl::GridMesh<double> grid;
  clothctl::Material<double> material;
  clothctl::SpringNetwork<double> network;
  clothctl::ClothState<double> state;

  int lower_left() const { return grid.vertex(0, 0); }
  int lower_right() const { return grid.vertex(0, grid.cols - 1); }
  int upper_left() const { return grid.vertex(grid.rows - 1, 0); }
  int upper_right() const { return grid.vertex(grid.rows - 1, grid.cols - 1); }
  /// The upward force that balances the sheet's weight, N.
  clothctl::Vector3<double> gravity_load() const { return {0.0, 0.0, 9.81 * network.mass.sum()}; }
  /// The size×size vertices at an upper corner (side 0: left, 1: right).
  std::vector<int> corner_patch(int side, int size) const {
    std::vector<int> vertices;
    for (int r = 0; r < size; ++r) {
      for (int c = 0; c < size; ++c)
        vertices.push_back(grid.vertex(grid.rows - 1 - r, side == 0 ? c : grid.cols - 1 - c));
    }
    return vertices;
  }

  /// Returns a simulator of the sheet; `air` switches its air forces on.
  clothctl::MassSpring<double> model(clothctl::Integration integration, bool air = false,
                                     std::vector<int> pinned = {}) const {
    clothctl::MassSpringSettings<double> settings;
    settings.integration = integration;
    settings.drag = material.drag;
    settings.limit_energy = false;  // the published step, which planners predict
    if (air) {
      settings.air.normal_coefficient = material.air_normal;
      settings.air.tangent_coefficient = material.air_tangent;
    }
    settings.pinned = std::move(pinned);
    return clothctl::MassSpring<double>::create(network, settings).value();
  }
};

/// Makes a sheet of n×n vertices and lets it settle for `frames` frames. Held are `patch`×`patch`
/// vertices at each upper corner, the outermost at 90 % of their distance.
inline HangingSheet hanging_sheet(int n, int patch = 1, int frames = 120,
                                  const std::string& material = "handkerchief", double size = 0.5) {
  HangingSheet sheet;
  sheet.grid = clothctl::make_grid<double>(n, n, size, size).value();
  sheet.material = clothctl::material_preset<double>(material).value();
  sheet.network = clothctl::sheet_network<double>(sheet.grid, sheet.material).value();
  clothctl::MassSpring<double> model = sheet.model(clothctl::Integration::Newton);
  model.set_drag(3.0);
  sheet.state = model.rest_state();
  const double pi = std::acos(-1.0);
  for (Index i = 0; i < sheet.state.positions.cols(); ++i) {
    double& x = sheet.state.positions(0, i);
    sheet.state.positions(1, i) = 0.05 * size * std::cos(pi * x / size);
    x *= 0.95;
  }
  clothctl::ClothInput<double> input;
  for (int side : {0, 1}) {
    const std::vector<int> held = sheet.corner_patch(side, patch);
    input.driven_vertices.insert(input.driven_vertices.end(), held.begin(), held.end());
  }
  input.driven_positions.resize(3, static_cast<Index>(input.driven_vertices.size()));
  for (Index j = 0; j < input.driven_positions.cols(); ++j) {
    clothctl::Vector3<double> p =
        sheet.network.rest_positions.col(input.driven_vertices[static_cast<std::size_t>(j)]);
    p[0] -= (p[0] < 0 ? -1.0 : 1.0) * 0.05 * size;
    input.driven_positions.col(j) = p;
  }
  auto workspace = model.make_workspace();
  for (int k = 0; k < frames; ++k) (void)model.step(sheet.state, input, kFrame, workspace);
  sheet.state.velocities.setZero();
  return sheet;
}

/// Displaces every vertex, and changes its velocity, at random. Returns a state that no simulation
/// reaches.
inline clothctl::ClothState<double> shaken(const clothctl::ClothState<double>& state, unsigned seed,
                                           double displacement = 0.01, double speed = 0.5) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  clothctl::ClothState<double> out = state;
  for (Index i = 0; i < out.positions.size(); ++i) {
    out.positions(i) += displacement * uniform(random);
    out.velocities(i) += speed * uniform(random);
  }
  return out;
}

/// Targets of the lower corners. Each corner starts at rest and swings along its own curve.
struct AsyncTarget {
  clothctl::Vector3<double> start[2];
  double scale = 1.0;

  explicit AsyncTarget(const HangingSheet& sheet, double scale_ = 1.0)
      : start{sheet.state.positions.col(sheet.lower_left()),
              sheet.state.positions.col(sheet.lower_right())},
        scale(scale_) {}

  clothctl::Vector3<double> operator()(Index feature, double t) const {
    if (t < 0) t = 0;
    const double ramp = scale * (1.0 - std::exp(-t * t / 0.3));
    const double a = feature == 0 ? 3.0 : 2.2;
    return start[feature] + ramp * clothctl::Vector3<double>(0.02 * std::sin(a * t),
                                                             0.07 * std::sin(a * t + 0.3),
                                                             0.05 * (1.0 - std::cos(a * t)));
  }
};

/// Measurements of a closed loop.
struct LoopStats {
  double mean_error = 0;
  double max_error = 0;
  double mean_agreement = 0;
  int failures = 0;
  std::vector<clothctl::PlanStatus> statuses = {};
};

/// Runs the closed loop for `frames` frames, reaching the plant through plant_traits alone. The
/// features are single vertices. Calls `watch(frame, result)` after the plant has moved in each
/// frame. Errors are distances at the end of each frame.
template <class PlannerType, class Plant, class Target, class Wind, class Watch>
LoopStats run_loop(PlannerType& planner, Plant& plant, int frames, const std::vector<int>& features,
                   const Target& target, const Wind& wind, const Watch& watch) {
  using traits = clothctl::plant_traits<Plant>;
  using Scalar = typename PlannerType::Scalar;
  LoopStats stats;
  auto result = planner.make_result();
  for (int k = 0; k < frames; ++k) {
    const Scalar t = Scalar(kFrame) * Scalar(k);
    const clothctl::PlanStatus status =
        planner.plan(traits::positions(plant), traits::velocities(plant), t, target, wind, result);
    stats.statuses.push_back(status);
    result.input.wind = wind(t);
    traits::apply(plant, result.input);
    const auto report = traits::advance(plant, Scalar(kFrame));
    if (status == clothctl::PlanStatus::Failed || status == clothctl::PlanStatus::InvalidInput ||
        !report.advanced)
      ++stats.failures;
    stats.mean_agreement += static_cast<double>(result.agreement) / frames;
    for (std::size_t i = 0; i < features.size(); ++i) {
      const clothctl::Vector3<Scalar> y = traits::positions(plant).col(features[i]);
      const clothctl::Vector3<Scalar> wanted = target(static_cast<Index>(i), t + Scalar(kFrame));
      const double error = static_cast<double>((y - wanted).norm());
      stats.mean_error += error / (frames * static_cast<double>(features.size()));
      stats.max_error = std::max(stats.max_error, error);
    }
    watch(k, result);
  }
  return stats;
}

}  // namespace clothctl_test
