#pragma once

// Planners and plants of the closed-loop tests, and a foreign engine that some of them control.

#include <memory>
#include <utility>
#include <vector>

#include "clothctl/cloth/model_plant.hpp"
#include "mpc/instances.hpp"
#include "support/sheets.hpp"

namespace clothctl_test {

using SheetPlant = clothctl::ModelPlant<clothctl::MassSpring<double>>;

/// Features are the lower corners. A pinch of patch×patch vertices holds each upper corner.
inline clothctl::PlannerSetup<double> corner_setup(const HangingSheet& sheet, int patch = 1,
                                                   double friction = 0.5, double limit = 20.0) {
  clothctl::PlannerSetup<double> out;
  out.features.add_point(sheet.lower_left());
  out.features.add_point(sheet.lower_right());
  out.triangles = sheet.network.triangles;
  for (int side : {0, 1})
    out.grips.push_back(
        clothctl::make_pinch<double>(sheet.corner_patch(side, patch), friction, limit));
  return out;
}

inline clothctl::PlannerSettings<double> corner_settings(
    const HangingSheet& sheet, clothctl::GripInput input, clothctl::Index horizon = 20,
    clothctl::PlannerSettings<double> base = {}) {
  base.input = input;
  base.horizon = horizon;
  if (input == clothctl::GripInput::Force) base.gravity_load = sheet.gravity_load();
  return base;
}

inline FrozenPlanner frozen_planner(const HangingSheet& sheet,
                                    const clothctl::PlannerSetup<double>& setup,
                                    const clothctl::PlannerSettings<double>& settings,
                                    bool air = false) {
  return FrozenPlanner::create(setup, settings,
                               FrozenPredictor(clothctl::MassSpringResponse<float>(
                                   sheet.model(clothctl::Integration::LinearlyImplicit, air))),
                               sheet.state.positions)
      .value();
}

inline SheetPlant sheet_plant(const HangingSheet& sheet, clothctl::Integration integration,
                              bool air = false) {
  SheetPlant plant(sheet.model(integration, air));
  plant.set_state(sheet.state);
  return plant;
}

inline std::vector<int> corners(const HangingSheet& sheet) {
  return {sheet.lower_left(), sheet.lower_right()};
}

struct NoWind {
  clothctl::Vector3<double> operator()(double) const { return clothctl::Vector3<double>::Zero(); }
};
struct NoWatch {
  template <class Result>
  void operator()(int, const Result&) const {}
};

}  // namespace clothctl_test
