#pragma once

// The hang test: the same cloth at several resolutions, hung up and brought to rest, must hang to
// the same depth. Works with any ClothModel.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/cloth/settle.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"

namespace clothctl_test {

/// Where a sheet hangs from.
enum class Hung {
  /// All vertices of its top row, at their rest distances.
  TopEdge,
  /// Its two upper corners, at 90 % of their rest distance, so that it falls into folds.
  TwoCorners
};

/// How a hang test runs. Lengths in m, times in s.
struct HangSettings {
  double size = 0.5;
  std::string material = "handkerchief";
  Hung hung = Hung::TopEdge;
  /// Frame of the settling.
  double dt = 0.02;
  /// Longest time to settle.
  double seconds = 10;
  /// The sheet rests when every vertex is slower, m/s.
  double rest_speed = 1e-3;
  /// Mass-proportional drag while it settles, 1/s.
  double drag = 3;
};

/// What a sheet does at rest.
template <class Scalar>
struct HangResult {
  /// Depth of the lowest vertex below the top, m. NaN if a step failed.
  double sag = 0;
  /// Speed of the fastest vertex at the end, m/s.
  double speed = 0;
  /// The sheet at rest.
  clothctl::ClothState<Scalar> state = {};
};

/// Returns a coarse sheet's positions at the vertices of a finer one, bilinearly.
template <class Scalar>
clothctl::Points<Scalar> refined(const clothctl::Points<Scalar>& coarse, int from, int to) {
  clothctl::Points<Scalar> fine(3, static_cast<clothctl::Index>(to) * to);
  const double scale = static_cast<double>(from - 1) / (to - 1);
  for (int row = 0; row < to; ++row) {
    for (int col = 0; col < to; ++col) {
      const double r = scale * row, c = scale * col;
      const int r0 = std::min(static_cast<int>(r), from - 2),
                c0 = std::min(static_cast<int>(c), from - 2);
      const Scalar v = static_cast<Scalar>(r - r0), u = static_cast<Scalar>(c - c0), one(1);
      const auto at = [&](int i, int j) -> clothctl::Vector3<Scalar> {
        return coarse.col(static_cast<clothctl::Index>(r0 + i) * from + c0 + j);
      };
      fine.col(static_cast<clothctl::Index>(row) * to + col) =
          (one - v) * ((one - u) * at(0, 0) + u * at(0, 1)) +
          v * ((one - u) * at(1, 0) + u * at(1, 1));
    }
  }
  return fine;
}

/// Hangs up a sheet of n × n vertices from `start` (positions, 3×n²; empty: bowed a little) and
/// lets it settle. `make_model(network, drag)` returns the model.
template <class Scalar, class MakeModel>
HangResult<Scalar> hang(int n, const HangSettings& settings, const MakeModel& make_model,
                        const clothctl::Points<Scalar>& start = {}) {
  using clothctl::Index;
  const Scalar size = static_cast<Scalar>(settings.size);
  const auto grid = clothctl::make_grid<Scalar>(n, n, size, size).value();
  const auto material = clothctl::material_preset<Scalar>(settings.material).value();
  const auto network = clothctl::sheet_network<Scalar>(grid, material).value();
  clothctl::ModelPlant plant(make_model(network, static_cast<Scalar>(settings.drag)));
  clothctl::ClothState<Scalar> state{grid.positions,
                                     clothctl::Points<Scalar>::Zero(3, grid.positions.cols())};
  std::vector<int> held{grid.vertex(n - 1, 0), grid.vertex(n - 1, n - 1)};
  if (settings.hung == Hung::TopEdge) {
    held.clear();
    for (int col = 0; col < n; ++col) held.push_back(grid.vertex(n - 1, col));
  }
  const double squeeze = settings.hung == Hung::TopEdge ? 1.0 : 0.9, pi = std::acos(-1.0);
  for (Index i = 0; i < state.positions.cols(); ++i) {
    Scalar& x = state.positions(0, i);
    if (settings.hung == Hung::TwoCorners)
      state.positions(1, i) =
          Scalar(0.08 * settings.size * std::cos(pi * static_cast<double>(x) / settings.size));
    x *= Scalar(squeeze);
  }
  if (start.cols() > 0) state.positions = start;
  plant.set_state(state);
  const clothctl::SettleReport<Scalar> report = clothctl::settle(
      plant, held, Scalar(settings.dt), Scalar(settings.seconds), Scalar(settings.rest_speed));
  HangResult<Scalar> result;
  result.state.positions = plant.positions();
  result.state.velocities = plant.velocities();
  result.speed = static_cast<double>(report.speed);
  result.sag = report.advanced ? static_cast<double>(result.state.positions(2, held.front()) -
                                                     result.state.positions.row(2).minCoeff())
                               : std::nan("");
  return result;
}

/// Hangs up the same cloth at each resolution, coarse to fine; each starts from the coarser one at
/// rest. Returns the sags, m.
template <class Scalar, class MakeModel>
std::vector<double> hang_all(const std::vector<int>& resolutions, const HangSettings& settings,
                             const MakeModel& make_model) {
  std::vector<double> sags;
  clothctl::Points<Scalar> start(3, 0);
  for (std::size_t i = 0; i < resolutions.size(); ++i) {
    if (i > 0) start = refined(start, resolutions[i - 1], resolutions[i]);
    const HangResult<Scalar> result = hang<Scalar>(resolutions[i], settings, make_model, start);
    sags.push_back(result.sag);
    start = result.state.positions;
  }
  return sags;
}

/// Returns the largest relative difference between two of the sags.
inline double spread(const std::vector<double>& sags) {
  double least = sags.front(), most = sags.front();
  for (double sag : sags) {
    if (!(sag >= least)) least = sag;
    if (!(sag <= most)) most = sag;
  }
  return most / least - 1;
}

}  // namespace clothctl_test
