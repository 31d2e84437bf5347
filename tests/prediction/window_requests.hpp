#pragma once

// A window for the tests of predictors that simulate, and the model's own steps along it.

#include <cmath>
#include <vector>

#include "clothctl/prediction/window.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"

namespace clothctl_test {

/// Two hands that sway, or as large forces on them that carry the sheet, in some wind; the outputs
/// are a vertex, a centroid and the hands.
inline clothctl::WindowRequest<double> swaying_hands(const HangingSheet& sheet,
                                                     clothctl::GripInput kind,
                                                     clothctl::Index horizon) {
  clothctl::WindowRequest<double> request;
  request.horizon = horizon;
  request.dt = kFrame;
  request.kind = kind;
  request.held = {sheet.upper_left(), sheet.upper_right()};
  request.outputs.add_point(sheet.lower_left());
  request.outputs.add_centroid({sheet.lower_right(), sheet.grid.vertex(1, 1)});
  request.held_outputs = 2;
  for (int v : request.held) request.outputs.add_point(v);
  request.plan.setZero(request.inputs(), horizon);
  for (clothctl::Index k = 0; k < horizon; ++k) {
    for (clothctl::Index i = 0; i < request.inputs(); ++i)
      request.plan(i, k) = 0.2 * std::sin(0.3 * static_cast<double>(k) + static_cast<double>(i));
    if (kind == clothctl::GripInput::Force) {
      request.plan(2, k) += 0.5 * sheet.gravity_load()[2];
      request.plan(5, k) += 0.5 * sheet.gravity_load()[2];
    }
  }
  request.applied = request.plan.col(0);
  request.wind.setZero(3, horizon);
  request.wind.row(1).setLinSpaced(0.5, 2.0);
  return request;
}

/// The outputs that the model's own steps lead to: hands on the planned path, `forces` (3×n, N) on
/// all vertices.
template <class Model>
clothctl::MatrixX<double> stepped(const Model& model, const clothctl::ClothState<double>& start,
                                  const clothctl::WindowRequest<double>& request,
                                  const clothctl::Points<double>& forces) {
  using namespace clothctl;
  ClothState<double> state = start;
  auto workspace = model.make_workspace();
  MatrixX<double> out(request.output_rows(), request.horizon);
  ClothInput<double> input;
  input.driven_vertices = request.held;
  input.driven_positions.resize(3, 2);
  for (int v = 0; v < static_cast<int>(forces.cols()); ++v) input.force_vertices.push_back(v);
  input.forces = forces;
  Points<double> y(3, request.outputs.count());
  for (Index k = 0; k < request.horizon; ++k) {
    input.wind = request.wind.col(k);
    for (Index j = 0; j < 2; ++j)
      input.driven_positions.col(j) =
          state.positions.col(request.held[static_cast<std::size_t>(j)]) +
          request.dt * request.plan.block<3, 1>(3 * j, k);
    REQUIRE(model.step(state, input, request.dt, workspace).advanced);
    evaluate_features<double>(request.outputs, state.positions, y);
    out.col(k) = Eigen::Map<const VectorX<double>>(y.data(), y.size());
  }
  return out;
}

/// The same without other forces than the sheet's own.
template <class Model>
clothctl::MatrixX<double> stepped(const Model& model, const clothctl::ClothState<double>& start,
                                  const clothctl::WindowRequest<double>& request) {
  return stepped(model, start, request, clothctl::Points<double>::Zero(3, start.positions.cols()));
}

}  // namespace clothctl_test
