#include "scene.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"

namespace planner_bench {

namespace {

[[noreturn]] void give_up(const char* what) {
  std::fprintf(stderr, "bench_planner: %s\n", what);
  std::exit(1);
}

}  // namespace

Scene Scene::make(int n) {
  GridMesh<double> grid = make_grid<double>(n, n, 0.5, 0.5).value();
  const Material<double> material;
  MassSpringSettings<double> settings;
  settings.drag = material.drag;
  MassSpring<double> model =
      MassSpring<double>::create(sheet_network(grid, material).value(), settings).value();
  Scene scene(n, std::move(grid), std::move(model));
  scene.start_ = scene.model.rest_state();
  ClothInput<double> input;
  input.driven_vertices = {scene.grid.vertex(n - 1, 0), scene.grid.vertex(n - 1, n - 1)};
  input.driven_positions.resize(3, 2);
  for (Index j = 0; j < 2; ++j) {
    const int hand = input.driven_vertices[static_cast<std::size_t>(j)];
    input.driven_positions.col(j) = 0.9 * scene.start_.positions.col(hand);
    scene.setup.grips.push_back(make_pinch<double>({hand}, 0.5, 20.0));
  }
  auto workspace = scene.model.make_workspace();
  for (int k = 0; k < 60; ++k) {
    if (!scene.model.step(scene.start_, input, kDt, workspace).advanced)
      give_up("the sheet did not hang");
  }
  for (Index i : {0, 1}) scene.setup.features.add_point(scene.feature(i));
  scene.setup.triangles = scene.grid.triangles;
  return scene;
}

PlannerSettings<double> Scene::settings(GripInput input, Index horizon, bool roll) const {
  PlannerSettings<double> s = roll ? PlannerSettings<double>::rollout() : PlannerSettings<double>();
  s.input = input;
  s.horizon = horizon;
  s.dt = kDt;
  if (input == GripInput::Force) s.gravity_load = V(0.0, 0.0, 9.81 * model.network().mass.sum());
  return s;
}

V Scene::target(Index i, double t) const {
  const V start = start_.positions.col(feature(i));
  const double ramp = t > 0 ? 1.0 - std::exp(-t * t / 0.3) : 0.0;
  return start + ramp * V(0.02 * std::sin(3.0 * t), 0.06 * std::sin(2.5 * t),
                          0.04 * (1.0 - std::cos(2.0 * t)));
}

void Scene::record(int count, Index horizon) {
  using Predictor = LinearisedPredictor<MassSpringResponse<float>, double>;
  auto made =
      Planner<Predictor>::create(setup, settings(GripInput::Force, horizon, false),
                                 Predictor(MassSpringResponse<float>(model)), start_.positions);
  if (!made) give_up(made.error().c_str());
  auto& planner = made.value();
  auto result = planner.make_result();
  auto workspace = model.make_workspace();
  const auto wanted = [&](Index i, double t) { return target(i, t); };
  ClothState<double> state = start_;
  for (int k = 0; k < count; ++k) {
    frames.push_back({state.positions, state.velocities, kDt * k});
    if (planner.plan(state.positions, state.velocities, kDt * k, wanted, result) !=
            PlanStatus::Planned ||
        !model.step(state, result.input, kDt, workspace).advanced)
      give_up("the run that is recorded failed");
  }
}

}  // namespace planner_bench
