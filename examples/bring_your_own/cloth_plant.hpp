#pragma once

// A cloth of another engine, here a typical game engine, joins ClothPlant by one specialisation of
// plant_traits. The engine keeps its own conventions: single precision, y up, explicit substeps.
// clothctl uses 3×n positions in metres, z up.

#include <array>
#include <cmath>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/network/spring_network.hpp"

namespace game {

using Float3 = std::array<float, 3>;

/// Particles and springs, integrated explicitly in small substeps.
struct Cloth {
  struct Spring {
    std::size_t a, b;
    float length, stiffness, damping;
  };
  std::vector<Float3> x, v, push;  // push: force from the controller, N
  std::vector<Spring> springs;
  std::vector<float> mass;
  std::vector<std::size_t> held;  // vertices moved by hand, to `hand`
  std::vector<Float3> hand;
  float drag = 0;
  int substeps = 400;  // of a frame; stiff or fine cloth needs more

  void substep(float h) {
    std::vector<Float3> f = push;
    for (std::size_t i = 0; i < x.size(); ++i) f[i][1] -= 9.81f * mass[i];
    for (const Spring& s : springs) {
      float d[3], length = 0, rate = 0;
      for (std::size_t c = 0; c < 3; ++c) d[c] = x[s.b][c] - x[s.a][c];
      for (std::size_t c = 0; c < 3; ++c) length += d[c] * d[c];
      length = std::sqrt(length);
      for (std::size_t c = 0; c < 3; ++c) rate += d[c] / length * (v[s.b][c] - v[s.a][c]);
      const float pull = (s.stiffness * (length - s.length) + s.damping * rate) / length;
      for (std::size_t c = 0; c < 3; ++c) f[s.a][c] += pull * d[c], f[s.b][c] -= pull * d[c];
    }
    for (std::size_t i = 0; i < x.size(); ++i) {
      for (std::size_t c = 0; c < 3; ++c) {
        v[i][c] = (v[i][c] + h * f[i][c] / mass[i]) / (1 + h * drag);
        x[i][c] += h * v[i][c];
      }
    }
  }

  void frame(float dt) {
    const float h = dt / static_cast<float>(substeps);
    for (int k = 0; k < substeps; ++k) {
      const std::vector<Float3> before = x;
      substep(h);
      const float left = h * static_cast<float>(substeps - k);  // rest of the frame, s
      for (std::size_t i = 0; i < held.size(); ++i) {
        for (std::size_t c = 0; c < 3; ++c) {
          v[held[i]][c] = (hand[i][c] - before[held[i]][c]) / left;
          x[held[i]][c] = before[held[i]][c] + v[held[i]][c] * h;
        }
      }
    }
  }
};

/// Conversions to metres, z up, double precision, and back.
inline clothctl::Vector3<double> z_up(const Float3& p) { return {p[0], -p[2], p[1]}; }
inline Float3 y_up(const clothctl::Vector3<double>& p) {
  return {static_cast<float>(p[0]), static_cast<float>(p[2]), static_cast<float>(-p[1])};
}

/// Makes the engine's cloth with the springs of a network, at positions x (3×n, z up) and at rest.
inline Cloth make_cloth(const clothctl::SpringNetwork<double>& network,
                        const clothctl::Points<double>& x) {
  Cloth cloth;
  for (clothctl::Index i = 0; i < x.cols(); ++i) {
    cloth.x.push_back(y_up(x.col(i)));
    cloth.mass.push_back(static_cast<float>(network.mass[i]));
  }
  cloth.v.assign(cloth.x.size(), {0, 0, 0});
  cloth.push = cloth.v;
  for (const clothctl::Spring<double>& s : network.springs) {
    cloth.springs.push_back({static_cast<std::size_t>(s.a), static_cast<std::size_t>(s.b),
                             static_cast<float>(s.rest_length), static_cast<float>(s.stiffness),
                             static_cast<float>(s.damping)});
  }
  return cloth;
}

}  // namespace game

/// Everything that clothctl needs from a plant.
template <>
struct clothctl::plant_traits<game::Cloth> {
  static Index vertex_count(const game::Cloth& cloth) { return static_cast<Index>(cloth.x.size()); }
  static Points<double> positions(const game::Cloth& cloth) { return all_z_up(cloth.x); }
  static Points<double> velocities(const game::Cloth& cloth) { return all_z_up(cloth.v); }
  /// Sets the input: forces on some vertices, and prescribed motion of others.
  static void apply(game::Cloth& cloth, const ClothInput<double>& input) {
    cloth.push.assign(cloth.x.size(), {0, 0, 0});
    for (std::size_t i = 0; i < input.force_vertices.size(); ++i) {
      const game::Float3 f = game::y_up(input.forces.col(static_cast<Index>(i)));
      for (std::size_t c = 0; c < 3; ++c)
        cloth.push[static_cast<std::size_t>(input.force_vertices[i])][c] += f[c];
    }
    cloth.held.assign(input.driven_vertices.begin(), input.driven_vertices.end());
    cloth.hand.clear();
    for (Index i = 0; i < input.driven_positions.cols(); ++i)
      cloth.hand.push_back(game::y_up(input.driven_positions.col(i)));
  }
  /// Takes a step. A failed step leaves the cloth unchanged and is reported.
  static StepReport<double> advance(game::Cloth& cloth, double dt) {
    if (!(dt > 0)) return {StepStatus::InvalidInput, false, 0.0, 0};
    const game::Cloth before = cloth;
    cloth.frame(static_cast<float>(dt));
    const bool good = all_finite(positions(cloth)) && all_finite(velocities(cloth));
    if (!good) cloth = before;
    return {good ? StepStatus::Converged : StepStatus::NumericalFailure, good, 0.0, 1};
  }
  /// Optional: the upward force that holds the cloth at rest. run_frame compares it with the
  /// planner's settings.
  static Vector3<double> gravity_load(const game::Cloth& cloth) {
    double mass = 0;
    for (const float m : cloth.mass) mass += static_cast<double>(m);
    return {0, 0, 9.81 * mass};
  }

 private:
  static Points<double> all_z_up(const std::vector<game::Float3>& points) {
    Points<double> out(3, static_cast<Index>(points.size()));
    for (std::size_t i = 0; i < points.size(); ++i)
      out.col(static_cast<Index>(i)) = game::z_up(points[i]);
    return out;
  }
};
