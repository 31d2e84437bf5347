#pragma once

// A small sheet that hangs by its upper corners, and a motion of its lower ones.

#include <cmath>

#include "clothctl/mpc/plan_types.hpp"
#include "support/sheets.hpp"
#include "support/square_sheets.hpp"

namespace clothctl_test {

struct ShortCurve {
  HangingSheet sheet = hanging_sheet(5, 1, 100, "handkerchief", 0.3);
  clothctl::PlannerSetup<double> setup;
  clothctl::MassSpring<double> model;

  ShortCurve() : model(exact_model(sheet)) {
    setup.features.add_point(sheet.lower_left());
    setup.features.add_point(sheet.lower_right());
    for (const int v : {sheet.upper_left(), sheet.upper_right()})
      setup.grips.push_back(clothctl::make_pinch<double>({v}, 0.5, 20.0));
  }

  // Steps so exact that differences of rollouts do not see where Newton's method ended.
  static clothctl::MassSpring<double> exact_model(const HangingSheet& sheet) {
    clothctl::MassSpringSettings<double> settings;
    settings.integration = clothctl::Integration::Newton;
    settings.drag = sheet.material.drag;
    settings.limit_energy = false;
    settings.velocity_tolerance = 1e-12;
    return clothctl::MassSpring<double>::create(sheet.network, settings).value();
  }

  // Both lower corners go by up to 5 cm, one later.
  auto target(double scale) const {
    return [this, scale](clothctl::Index i, double t) {
      const double late = t - 0.05 * static_cast<double>(i);
      const double way = late < 0 ? 0.0 : 1 - std::cos(4 * late);
      const clothctl::Vector3<double> direction(0.01, 0.04, 0.02);
      return clothctl::Vector3<double>(
          sheet.state.positions.col(i == 0 ? sheet.lower_left() : sheet.lower_right()) +
          scale * way * direction);
    };
  }

  // The path of hands that stay where they are.
  clothctl::MatrixX<double> still(clothctl::Index frames) const {
    clothctl::MatrixX<double> path(6, frames);
    for (clothctl::Index k = 0; k < frames; ++k) {
      path.col(k).head(3) = sheet.state.positions.col(sheet.upper_left());
      path.col(k).tail(3) = sheet.state.positions.col(sheet.upper_right());
    }
    return path;
  }
};

}  // namespace clothctl_test
