#pragma once

// A planner's window on a small sheet, for tests of the planner's parts: two grips, two features.

#include <utility>

#include "clothctl/mpc/detail/window_problem.hpp"
#include "support/sheets.hpp"

namespace clothctl_test {

constexpr clothctl::Index kWindow = 4;  // frames

inline clothctl::PointFeatures<double> two_corners() {
  clothctl::PointFeatures<double> features;
  for (int v = 0; v < 2; ++v) features.add_point(v);
  return features;
}

inline clothctl::PlannerSettings<double> small_settings(clothctl::GripInput input) {
  clothctl::PlannerSettings<double> settings;
  settings.horizon = kWindow;
  settings.dt = 0.02;
  settings.input = input;
  settings.heavy_chain_axes = clothctl::HeavyChainAxes::Off;
  return settings;
}

// The problem with random responses, and with the vertices of the sheet as measured.
struct SmallWindow {
  HangingSheet sheet = hanging_sheet(5, 2, 5);
  clothctl::detail::WindowProblem<double> problem;

  explicit SmallWindow(const clothctl::PlannerSettings<double>& settings)
      : problem(settings,
                {{clothctl::make_pinch<double>(sheet.corner_patch(0, 2), 0.5, 1.0),
                  clothctl::make_pinch<double>(sheet.corner_patch(1, 2), 0.5, 1.0)},
                 sheet.network.triangles,
                 settings.input},
                two_corners()) {
    std::srand(5);
    const clothctl::Index rows = problem.request.output_rows(), inputs = problem.basis.inputs();
    problem.response.impulse_response = clothctl::MatrixX<double>::Random(rows, inputs * kWindow);
    problem.response.free_response = clothctl::MatrixX<double>::Random(rows, kWindow);
    problem.response.plan = clothctl::MatrixX<double>::Random(inputs, kWindow);
    for (clothctl::Index j = 0; j < held_count(); ++j)
      problem.motion.position.col(j) =
          sheet.state.positions.col(problem.request.held[static_cast<std::size_t>(j)]);
    problem.basis.update(sheet.state.positions);
    for (auto& patch : problem.patches) patch.update(problem.motion.position);
  }
  explicit SmallWindow(clothctl::GripInput input) : SmallWindow(small_settings(input)) {}
  SmallWindow(const SmallWindow&) = delete;

  clothctl::Index held_count() const {
    return static_cast<clothctl::Index>(problem.request.held.size());
  }
};

}  // namespace clothctl_test
