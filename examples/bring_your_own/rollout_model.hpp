#pragma once

// Another cloth model joins ClothModel and ClothRollout, so that a RolloutPredictor can roll it
// out. It has springs and takes one implicit step per frame, solved by conjugate gradients without
// a matrix [Baraff, Witkin 1998]. With the step h, the drag α and the forces f at the start:
//
//   A v⁺ = M v + h f,   A = (1 + h α) M + h D + h² K
//
// Its coordinates are plain numbers: x y z of each vertex in turn, the memory layout of a 3×n
// matrix.

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/network/spring_network.hpp"

namespace lab {
using Numbers = std::vector<double>;

/// The scratch memory of a step: for each spring its direction and its damped stiffness along and
/// across it; for each coordinate the vectors of the solve, and 1 if it is prescribed.
struct Scratch {
  Numbers axis, axial, across, rhs, residual, search, product, speed, needed, fixed;
};

/// Masses (kg), springs and the drag rate (1/s).
struct Cloth {
  std::vector<clothctl::Spring<double>> springs;
  Numbers rest, mass;
  double drag = 0;

  /// out = A in, with the springs of the last `linearise`.
  void multiply(const Scratch& s, double h, const Numbers& in, Numbers& out) const {
    for (std::size_t i = 0; i < in.size(); ++i) out[i] = (1 + h * drag) * mass[i / 3] * in[i];
    for (std::size_t e = 0; e < springs.size(); ++e) {
      const std::size_t a = 3 * std::size_t(springs[e].a), b = 3 * std::size_t(springs[e].b);
      const double* n = &s.axis[3 * e];
      double rate = 0;
      for (std::size_t c = 0; c < 3; ++c) rate += n[c] * (in[b + c] - in[a + c]);
      for (std::size_t c = 0; c < 3; ++c) {
        const double pull =
            (s.axial[e] - s.across[e]) * rate * n[c] + s.across[e] * (in[b + c] - in[a + c]);
        out[a + c] -= pull, out[b + c] += pull;
      }
    }
  }

  /// Computes the springs and the right-hand side M v + h f at positions x and velocities v; `rhs`
  /// holds the external forces on entry. A compressed spring has no stiffness across its axis, so
  /// that A is definite.
  void linearise(Scratch& s, double h, const double* x, const double* v) const {
    for (std::size_t e = 0; e < springs.size(); ++e) {
      const clothctl::Spring<double>& spring = springs[e];
      const std::size_t a = 3 * std::size_t(spring.a), b = 3 * std::size_t(spring.b);
      const double length = std::hypot(x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]);
      const double pull = spring.stiffness * (length - spring.rest_length);
      for (std::size_t c = 0; c < 3; ++c) {
        s.axis[3 * e + c] = (x[b + c] - x[a + c]) / length;
        s.rhs[a + c] += pull * s.axis[3 * e + c], s.rhs[b + c] -= pull * s.axis[3 * e + c];
      }
      s.axial[e] = h * spring.damping + h * h * spring.stiffness;
      s.across[e] = h * h * std::max(0.0, pull / length);
    }
    for (std::size_t i = 0; i < s.rhs.size(); ++i)
      s.rhs[i] = mass[i / 3] * v[i] + h * (s.rhs[i] - (i % 3 == 2 ? 9.81 * mass[i / 3] : 0.0));
  }

  /// Solves for the free entries of `speed` by conjugate gradients. Returns the number of
  /// iterations.
  int solve(Scratch& s, double h) const {
    multiply(s, h, s.speed, s.product);
    double square = 0, first = 0;
    for (std::size_t i = 0; i < s.rhs.size(); ++i) {
      s.residual[i] = s.search[i] = (1 - s.fixed[i]) * (s.rhs[i] - s.product[i]);
      square += s.residual[i] * s.residual[i], first += s.rhs[i] * s.rhs[i];
    }
    int k = 0;
    for (; k < 500 && square > 1e-24 * first; ++k) {
      multiply(s, h, s.search, s.product);
      double curvature = 0, next = 0;
      for (std::size_t i = 0; i < s.rhs.size(); ++i) curvature += s.search[i] * s.product[i];
      for (std::size_t i = 0; i < s.rhs.size(); ++i) {
        s.speed[i] += square / curvature * s.search[i];
        s.residual[i] -= (1 - s.fixed[i]) * square / curvature * s.product[i];
        next += s.residual[i] * s.residual[i];
      }
      for (std::size_t i = 0; i < s.rhs.size(); ++i)
        s.search[i] = s.residual[i] + next / square * s.search[i];
      square = next;
    }
    multiply(s, h, s.speed, s.product);
    for (std::size_t i = 0; i < s.rhs.size(); ++i) s.needed[i] = (s.product[i] - s.rhs[i]) / h;
    return k;
  }
};
}  // namespace lab

/// The model: separate state and scratch memory, and a step from one state to the next.
template <>
struct clothctl::cloth_traits<lab::Cloth> {
  static Index vertex_count(const lab::Cloth& cloth) { return Index(cloth.mass.size()); }
  static ClothState<double> rest_state(const lab::Cloth& cloth) {
    const Index n = vertex_count(cloth);
    return {Eigen::Map<const Points<double>>(cloth.rest.data(), 3, n), Points<double>::Zero(3, n)};
  }
  static lab::Scratch make_workspace(const lab::Cloth& cloth) {
    const lab::Numbers zero(cloth.rest.size()), each(cloth.springs.size());
    return {lab::Numbers(3 * each.size()), each, each, zero, zero, zero, zero, zero, zero, zero};
  }
  static StepReport<double> step(const lab::Cloth& cloth, ClothState<double>& state,
                                 const ClothInput<double>& input, double dt, lab::Scratch& s) {
    if (!(dt > 0) || !all_finite(state.positions) || !all_finite(state.velocities))
      return {StepStatus::InvalidInput, false, 0.0, 0};
    std::fill(s.rhs.begin(), s.rhs.end(), 0.0);
    std::fill(s.fixed.begin(), s.fixed.end(), 0.0);
    std::copy_n(state.velocities.data(), s.speed.size(), s.speed.begin());
    for (std::size_t i = 0; i < input.force_vertices.size(); ++i)
      for (Index c = 0; c < 3; ++c)
        s.rhs[std::size_t(3 * input.force_vertices[i] + c)] += input.forces(c, Index(i));
    cloth.linearise(s, dt, state.positions.data(), state.velocities.data());
    for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
      for (Index c = 0, v = input.driven_vertices[i]; c < 3; ++c) {
        const std::size_t at = std::size_t(3 * v + c);
        s.fixed[at] = 1;
        s.speed[at] = (input.driven_positions(c, Index(i)) - state.positions(c, v)) / dt;
      }
    }
    const int iterations = cloth.solve(s, dt);
    const Eigen::Map<const Points<double>> speed(s.speed.data(), 3, vertex_count(cloth));
    if (!all_finite(speed)) return {StepStatus::NumericalFailure, false, 0.0, iterations};
    state.velocities = speed;
    state.positions += dt * speed;
    return {StepStatus::Converged, true, 0.0, iterations};
  }
};

/// What a rollout needs in addition: a start from a guess, unused here, and the holding forces.
template <>
struct clothctl::cloth_rollout_traits<lab::Cloth> {
  static auto step_from(const lab::Cloth& cloth, const Points<double>&, int, auto& state,
                        const auto& input, double dt, lab::Scratch& scratch, double) {
    return cloth_traits<lab::Cloth>::step(cloth, state, input, dt, scratch);
  }
  static void holding_forces(const lab::Cloth&, std::span<const int> vertices,
                             const lab::Scratch& scratch, Points<double>& forces) {
    for (std::size_t j = 0; j < vertices.size(); ++j)
      for (Index c = 0; c < 3; ++c)
        forces(c, Index(j)) = scratch.needed[std::size_t(3 * vertices[j] + c)];
  }
};
