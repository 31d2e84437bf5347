// A cloth that has never heard of clothctl, here a game engine's of the usual kind, is planned for through a trait.

#include <array>
#include <cmath>
#include <cstdio>
#include <vector>

#include "clothctl/clothctl.hpp"

namespace my_engine {

/// Particles in single precision, y up, integrated explicitly in small substeps.
struct Cloth {
  struct Spring {
    int a, b;
    float length, stiffness, damping;
  };
  std::vector<std::array<float, 3>> x, v, push;  // push: what the controller adds, N
  std::vector<Spring> springs;
  std::vector<float> mass;
  std::vector<int> held;  // moved by hand, to `hand`
  std::vector<std::array<float, 3>> hand;
  float drag = 0;

  void substep(float h) {
    std::vector<std::array<float, 3>> f = push;
    for (std::size_t i = 0; i < x.size(); ++i) f[i][1] -= 9.81f * mass[i];
    for (const Spring& s : springs) {
      const std::size_t a = static_cast<std::size_t>(s.a), b = static_cast<std::size_t>(s.b);
      float d[3], length = 0, rate = 0;
      for (std::size_t c = 0; c < 3; ++c) d[c] = x[b][c] - x[a][c];
      for (std::size_t c = 0; c < 3; ++c) length += d[c] * d[c];
      length = std::sqrt(length);
      for (std::size_t c = 0; c < 3; ++c) rate += d[c] / length * (v[b][c] - v[a][c]);
      const float pull = (s.stiffness * (length - s.length) + s.damping * rate) / length;
      for (std::size_t c = 0; c < 3; ++c) f[a][c] += pull * d[c], f[b][c] -= pull * d[c];
    }
    for (std::size_t i = 0; i < x.size(); ++i) {
      for (std::size_t c = 0; c < 3; ++c) {
        v[i][c] = (v[i][c] + h * f[i][c] / mass[i]) / (1 + h * drag);
        x[i][c] += h * v[i][c];
      }
    }
  }

  void frame(float dt) {
    const int substeps = 400;
    for (int k = 0; k < substeps; ++k) {
      const std::vector<std::array<float, 3>> before = x;
      substep(dt / substeps);
      for (std::size_t i = 0; i < held.size(); ++i) {
        const std::size_t j = static_cast<std::size_t>(held[i]);
        for (std::size_t c = 0; c < 3; ++c) {
          v[j][c] = (hand[i][c] - before[j][c]) / (dt * static_cast<float>(substeps - k) / substeps);
          x[j][c] = before[j][c] + v[j][c] * dt / substeps;
        }
      }
    }
  }
};

}  // namespace my_engine

/// All that clothctl asks of a plant. It speaks in metres, z up, 3×n; the engine keeps its own ways.
template <>
struct clothctl::plant_traits<my_engine::Cloth> {
  using Cloth = my_engine::Cloth;
  static Index vertex_count(const Cloth& cloth) { return static_cast<Index>(cloth.x.size()); }
  static Points<double> positions(const Cloth& cloth) { return to_z_up(cloth.x); }
  static Points<double> velocities(const Cloth& cloth) { return to_z_up(cloth.v); }
  static void apply(Cloth& cloth, const ClothInput<double>& input) {
    cloth.push.assign(cloth.x.size(), {0, 0, 0});
    for (std::size_t i = 0; i < input.force_vertices.size(); ++i) {
      const std::array<float, 3> f = to_y_up(input.forces.col(static_cast<Index>(i)));
      for (std::size_t c = 0; c < 3; ++c) cloth.push[static_cast<std::size_t>(input.force_vertices[i])][c] += f[c];
    }
    cloth.held = input.driven_vertices;
    cloth.hand.clear();
    for (Index i = 0; i < input.driven_positions.cols(); ++i) cloth.hand.push_back(to_y_up(input.driven_positions.col(i)));
  }
  static StepReport<double> advance(Cloth& cloth, double dt) {
    const Cloth before = cloth;
    cloth.frame(static_cast<float>(dt));
    const bool good = all_finite(positions(cloth)) && all_finite(velocities(cloth));
    if (!good) cloth = before;
    return {good ? StepStatus::Converged : StepStatus::NumericalFailure, good, 0.0, 1};
  }

 private:
  static Points<double> to_z_up(const std::vector<std::array<float, 3>>& y_up) {
    Points<double> out(3, static_cast<Index>(y_up.size()));
    for (std::size_t i = 0; i < y_up.size(); ++i) out.col(static_cast<Index>(i)) << y_up[i][0], -y_up[i][2], y_up[i][1];
    return out;
  }
  static std::array<float, 3> to_y_up(const Vector3<double>& p) {
    return {static_cast<float>(p[0]), static_cast<float>(p[2]), static_cast<float>(-p[1])};
  }
};

int main() {
  using namespace clothctl;
  using Traits = plant_traits<my_engine::Cloth>;

  // The engine's sheet. clothctl is told the same springs, as the model that it predicts with.
  const GridMesh<double> grid = make_grid<double>(9, 9, 0.5, 0.5).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  my_engine::Cloth cloth;
  for (Index i = 0; i < network.vertex_count(); ++i) {
    const Vector3<double> p = grid.positions.col(i);
    const double bow = 0.03 * std::cos(6.28 * p[0]);  // hands a little together, so that the sheet bends to one side
    cloth.x.push_back({static_cast<float>(0.95 * p[0]), static_cast<float>(p[2]), static_cast<float>(bow)});
    cloth.mass.push_back(static_cast<float>(network.mass[i]));
  }
  cloth.v.assign(cloth.x.size(), {0, 0, 0});
  for (const Spring<double>& s : network.springs) {
    cloth.springs.push_back(
        {s.a, s.b, static_cast<float>(s.rest_length), static_cast<float>(s.stiffness), static_cast<float>(s.damping)});
  }

  // Let it hang from its upper corners and come to rest.
  const int left = grid.vertex(8, 0), right = grid.vertex(8, 8);
  cloth.drag = 4;
  if (!settle(cloth, {left, right}, 0.02, 6.0, 1e-3).advanced) return 1;
  cloth.drag = 0.2f;

  PlannerSetup<double> setup;
  setup.triangles = network.triangles;
  for (int corner : {grid.vertex(0, 0), grid.vertex(0, 8)}) setup.features.add_point(corner);
  for (int hand : {left, right}) setup.grips.push_back(make_pinch<double>({hand}, 0.5, 20.0));
  // A cloth that is not the predictor, and hardly damped: calm hands, told where to go.
  PlannerSettings<double> settings = PlannerSettings<double>::loose_plant();
  settings.input = GripInput::Pose;
  MassSpringSettings<double> same;
  same.drag = 0.2;
  MassSpring<double> model = MassSpring<double>::create(network, same).value();
  ExactPredictor<MassSpringResponse<float>> predictor{MassSpringResponse<float>(model)};
  const Points<double> start = Traits::positions(cloth);
  auto planner = Planner<decltype(predictor)>::create(setup, settings, predictor, start).value();
  PlanResult<double> plan = planner.make_result();

  // The lower corners sway and rise; the planner sees the engine's cloth through the trait alone.
  const auto target = [&](Index corner, double t) -> Vector3<double> {
    const double ramp = t > 0 ? 1 - std::exp(-t * t) : 0;
    return start.col(grid.vertex(0, corner == 0 ? 0 : 8)) +
           ramp * Vector3<double>(0.02 * std::sin(2 * t), 0.06 * std::sin(3 * t), 0.04 * (1 - std::cos(2 * t)));
  };
  double sum = 0;
  const int frames = 200;
  for (int frame = 0; frame < frames; ++frame) {
    const double t = 0.02 * frame;
    if (!can_apply(planner.plan(Traits::positions(cloth), Traits::velocities(cloth), t, target, plan))) return 1;
    Traits::apply(cloth, plan.input);
    if (!Traits::advance(cloth, 0.02).advanced) return 1;
    const Points<double> x = Traits::positions(cloth);
    for (Index corner : {0, 1}) sum += (x.col(grid.vertex(0, corner == 0 ? 0 : 8)) - target(corner, t + 0.02)).norm();
  }
  std::printf("the corners follow with a mean error of %.1f mm\n", 1000 * sum / (2 * frames));
}
