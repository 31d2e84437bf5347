#pragma once

// What a plant does while its hands move: the data from which a predictor is identified
// (prediction/identify.hpp). Nothing but the plant's positions and velocities is used, so it may be
// another engine's cloth or a real one. Recorded motion of any other kind serves as well.

#include <cmath>
#include <string>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Positions and velocities of a sheet, frame by frame, while the motion of some vertices was
/// prescribed.
template <RealScalar Scalar>
struct MotionRecord {
  /// Length of a frame, s.
  Scalar dt = Scalar(0);
  /// The vertices whose motion was prescribed.
  std::vector<int> held;
  /// Positions at the start and after each frame, 3×n each, m.
  std::vector<Points<Scalar>> positions;
  /// Velocities at the same times, 3×n each, m/s.
  std::vector<Points<Scalar>> velocities;

  /// Returns an empty string, or a line that names what is wrong. Allocates.
  std::string validate() const {
    if (!is_finite(dt) || !(Scalar(0) < dt))
      return "the frame of the record is " + number_text(dt) + ", must be positive";
    if (positions.empty()) return "the record is empty";
    if (velocities.size() != positions.size()) {
      return "the record has " + std::to_string(positions.size()) + " positions and " +
             std::to_string(velocities.size()) + " velocities";
    }
    const Index n = positions.front().cols();
    if (held.empty()) return "the record holds no vertex";
    for (const int vertex : held) {
      if (vertex < 0 || vertex >= n) {
        return "the record holds vertex " + std::to_string(vertex) + ", off a mesh of " +
               std::to_string(n) + " vertices";
      }
    }
    for (std::size_t k = 0; k < positions.size(); ++k) {
      if (positions[k].cols() != n || velocities[k].cols() != n)
        return "frame " + std::to_string(k) + " of the record has another number of vertices";
      if (!all_finite(positions[k]) || !all_finite(velocities[k]))
        return "frame " + std::to_string(k) + " of the record is not finite";
    }
    return {};
  }
};

/// How the hands move while `record_motion` records.
template <RealScalar Scalar>
struct ExcitationSettings {
  /// Length of a frame, s.
  Scalar dt = Scalar(0.02);
  /// Number of frames.
  Index frames = 200;
  /// Size of the motion, m. All grips sway together by up to 1.5 times as much along each axis, and
  /// each by a quarter of it for itself. Choose what the task will ask for.
  Scalar amplitude = Scalar(0.02);

  /// Returns an empty string, or a line that names the bad setting and its value.
  std::string validate() const {
    if (!is_finite(dt) || !(Scalar(0) < dt))
      return "dt is " + number_text(dt) + ", must be positive";
    if (frames < 1) return "frames is " + std::to_string(frames) + ", must be at least 1";
    if (!is_finite(amplitude) || !(Scalar(0) < amplitude))
      return "amplitude is " + number_text(amplitude) + ", must be positive";
    return {};
  }
};

namespace detail {

/// Displacement of grip `grip` at time `t`: sines of 1.3 to 6 rad/s along each axis, which start
/// smoothly.
template <RealScalar Scalar>
Vector3<Scalar> excitation(std::size_t grip, const Scalar& t, const Scalar& amplitude) {
  using std::exp;
  using std::sin;
  const double own = static_cast<double>(grip % 8);
  Vector3<Scalar> sway;
  for (Index c = 0; c < 3; ++c) {
    const double axis = static_cast<double>(c);
    sway[c] = sin(Scalar(1.7 + 0.7 * axis) * t) + Scalar(0.5) * sin(Scalar(4.1 + 0.9 * axis) * t) +
              Scalar(0.25) * sin(Scalar(1.3 + 0.37 * (axis + 3 * own)) * t);
  }
  return amplitude * (Scalar(1) - Scalar(exp(-t * t))) * sway;
}

}  // namespace detail

/// Moves the `grips` of a plant at rest, each as a rigid body without turning, and records what the
/// sheet does. The plant ends in motion: give a copy, or reset it afterwards. Allocates.
///
/// Fails when: a setting is bad, there is no grip, a vertex is off the mesh, or a step of the plant
/// fails.
template <class Plant, RealScalar Scalar>
requires ClothPlant<Plant, Scalar> Result<MotionRecord<Scalar>> record_motion(
    Plant& plant, const std::vector<std::vector<int>>& grips,
    const ExcitationSettings<Scalar>& settings = {}) {
  using Traits = plant_traits<Plant>;
  const std::string bad = settings.validate();
  if (!bad.empty()) return Error{bad};
  MotionRecord<Scalar> record;
  record.dt = settings.dt;
  for (const std::vector<int>& grip : grips)
    record.held.insert(record.held.end(), grip.begin(), grip.end());
  const auto measure = [&] {
    record.positions.emplace_back(Traits::positions(plant));
    record.velocities.emplace_back(Traits::velocities(plant));
  };
  measure();
  const std::string problem = record.validate();
  if (!problem.empty()) return Error{problem};
  ClothInput<Scalar> input;
  input.clear();
  input.driven_vertices = record.held;
  input.driven_positions.resize(3, static_cast<Index>(record.held.size()));
  for (Index frame = 0; frame < settings.frames; ++frame) {
    const Scalar t = settings.dt * Scalar(static_cast<double>(frame + 1));
    Index column = 0;
    for (std::size_t g = 0; g < grips.size(); ++g) {
      const Vector3<Scalar> sway = detail::excitation(g, t, settings.amplitude);
      for (const int vertex : grips[g])
        input.driven_positions.col(column++) = record.positions.front().col(vertex) + sway;
    }
    Traits::apply(plant, input);
    if (!Traits::advance(plant, settings.dt).advanced)
      return Error{"the plant failed in frame " + std::to_string(frame) + " of the record"};
    measure();
  }
  const std::string broken = record.validate();
  if (!broken.empty()) return Error{broken};
  return record;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
