#pragma once

// Forces, energy and step matrices of a spring network.
//
//   f_a = -k (l - l0) n,  f_b = -f_a,            n = (x_a - x_b)/l
//   K   = Σ k [ n nᵀ + max(0, 1 - l0/l) (I - n nᵀ) ]   on (a,a), (b,b); minus on (a,b)   (SPD projection: no compression term)
//   D   = Σ d n nᵀ  in the same pattern
//   bending: f = -kb w_i Σ_j w_j x_j,  K += kb w_i w_j I
//   A   = (1 + h α) M + h (D + C) + h² K          C: air, see air.hpp
//
// The tension part max(0, 1 - l0/l) is the pendulum stiffness of a hanging sheet and must stay.

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/cloth/air.hpp"
#include "clothctl/cloth/spring_network.hpp"
#include "clothctl/math/block_symmetric.hpp"

namespace clothctl {

/// Factors that a predictor may put on the stiffness blocks; all one for the true model.
template <RealScalar Scalar>
struct StiffnessScale {
  /// Factor on the axial part k n nᵀ.
  Scalar axial = Scalar(1);
  /// Factor on the tension (geometric) part k max(0, 1 - l0/l) (I - n nᵀ).
  Scalar geometric = Scalar(1);
  /// Factor on the bending part.
  Scalar bending = Scalar(1);
};

/// Where each element of a network writes in a BlockSymmetric matrix.
template <RealScalar Scalar>
class SpringPattern {
 public:
  /// An empty pattern.
  SpringPattern() = default;

  /// Finds the slots of all springs, bending stencils and (when `with_air`) triangles. Allocates.
  SpringPattern(const SpringNetwork<Scalar>& network, bool with_bending, bool with_air) {
    std::vector<std::pair<int, int>> pairs;
    for (const Spring<Scalar>& s : network.springs) pairs.emplace_back(s.a, s.b);
    if (with_bending) {
      for (const BendStencil<Scalar>& b : network.bends)
        each_pair(b, [&](int i, int j) { pairs.emplace_back(vertex(b, i), vertex(b, j)); });
    }
    if (with_air) {
      for (const std::array<int, 3>& t : network.triangles) {
        for (std::size_t e = 0; e < 3; ++e) pairs.emplace_back(t[e], t[(e + 1) % 3]);
      }
    }
    matrix_ = BlockSymmetric<Scalar>(network.vertex_count(), std::move(pairs));
    for (const Spring<Scalar>& s : network.springs) springs_.push_back(matrix_.find(s.a, s.b));
    if (with_bending) {
      for (const BendStencil<Scalar>& b : network.bends) {
        each_pair(b, [&](int i, int j) { bends_.push_back(matrix_.find(vertex(b, i), vertex(b, j))); });
      }
    }
    if (with_air) {
      for (const std::array<int, 3>& t : network.triangles) {
        for (std::size_t e = 0; e < 3; ++e) triangles_.push_back(matrix_.find(t[e], t[(e + 1) % 3]));
      }
    }
  }

  /// An all-zero matrix of the pattern.
  const BlockSymmetric<Scalar>& matrix() const { return matrix_; }

  /// Adds `stiffness_factor` K(x) + `damping_factor` D(x) to `out`. Never allocates. Complexity: O(elements).
  void add_springs(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x, const StiffnessScale<Scalar>& scale,
                   Scalar stiffness_factor, Scalar damping_factor, BlockSymmetric<Scalar>& out) const {
    using std::sqrt;
    for (std::size_t e = 0; e < network.springs.size(); ++e) {
      const Spring<Scalar>& s = network.springs[e];
      const Vector3<Scalar> d = x.col(s.a) - x.col(s.b);
      const Scalar squared = d.squaredNorm();
      const Scalar rest_squared = s.rest_length * s.rest_length;
      Matrix3<Scalar> block;
      if (squared > Scalar(1e-12) * rest_squared) {
        const Scalar length = sqrt(squared);
        const Scalar strain = Scalar(1) - s.rest_length / length;
        const Scalar tension = Scalar(0) < strain ? strain : Scalar(0);
        const Scalar geometric = stiffness_factor * s.stiffness * scale.geometric * tension;
        const Scalar axial = stiffness_factor * s.stiffness * scale.axial + damping_factor * s.damping;
        block.noalias() = d * (d.transpose() * ((axial - geometric) / squared));
        block.diagonal().array() += geometric;
      } else {
        // Coincident ends have no direction; the isotropic block keeps the matrix definite.
        block = Matrix3<Scalar>::Identity() * (stiffness_factor * s.stiffness * scale.axial);
      }
      out.diagonal(s.a) += block;
      out.diagonal(s.b) += block;
      out.lower(springs_[e]) -= block;
    }
  }

  /// Adds `factor` times the bending stiffness to `out`; nothing when the pattern was made without bending.
  void add_bending(const SpringNetwork<Scalar>& network, Scalar factor, BlockSymmetric<Scalar>& out) const {
    if (bends_.empty()) return;
    std::size_t slot = 0;
    for (const BendStencil<Scalar>& b : network.bends) {
      for (int i = 0; i < b.count; ++i)
        out.diagonal(vertex(b, i)).diagonal().array() += factor * b.stiffness * weight(b, i) * weight(b, i);
      each_pair(b, [&](int i, int j) {
        out.lower(bends_[slot++]).diagonal().array() += factor * b.stiffness * weight(b, i) * weight(b, j);
      });
    }
  }

  /// Adds `dt` times the dampers along the unit vectors `direction` (3×springs) and the air matrices of the triangles
  /// (`air`, empty for none) to `out`. Never allocates.
  void add_frozen(const SpringNetwork<Scalar>& network, const Points<Scalar>& direction,
                  const std::vector<Matrix3<Scalar>>& air, Scalar dt, BlockSymmetric<Scalar>& out) const {
    for (std::size_t e = 0; e < network.springs.size(); ++e) {
      const Spring<Scalar>& s = network.springs[e];
      if (!(Scalar(0) < s.damping)) continue;
      const Vector3<Scalar> n = direction.col(static_cast<Index>(e));
      const Matrix3<Scalar> block = n * (n.transpose() * (dt * s.damping));
      out.diagonal(s.a) += block;
      out.diagonal(s.b) += block;
      out.lower(springs_[e]) -= block;
    }
    const Scalar ninth = Scalar(1) / Scalar(9);
    for (std::size_t e = 0; e < air.size(); ++e) {
      const std::array<int, 3>& t = network.triangles[e];
      const Matrix3<Scalar> block = air[e] * (dt * ninth);
      for (std::size_t i = 0; i < 3; ++i) {
        out.diagonal(t[i]) += block;
        out.lower(triangles_[3 * e + i]) += block;
      }
    }
  }

 private:
  static int vertex(const BendStencil<Scalar>& b, int i) { return b.vertex[static_cast<std::size_t>(i)]; }
  static const Scalar& weight(const BendStencil<Scalar>& b, int i) { return b.weight[static_cast<std::size_t>(i)]; }
  template <class Function>
  static void each_pair(const BendStencil<Scalar>& b, Function&& function) {
    for (int i = 1; i < b.count; ++i) {
      for (int j = 0; j < i; ++j) function(i, j);
    }
  }

  BlockSymmetric<Scalar> matrix_;
  std::vector<int> springs_;
  std::vector<int> bends_;
  std::vector<int> triangles_;
};

/// Adds spring and bending forces at positions `x` (3×n) to `forces` (N) and returns their energy (J). Never allocates.
template <RealScalar Scalar>
Scalar add_spring_forces(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x, Points<Scalar>& forces) {
  using std::sqrt;
  Scalar energy = Scalar(0);
  for (const Spring<Scalar>& s : network.springs) {
    const Vector3<Scalar> d = x.col(s.a) - x.col(s.b);
    const Scalar length = sqrt(d.squaredNorm());
    const Scalar stretch = length - s.rest_length;
    energy += Scalar(0.5) * s.stiffness * stretch * stretch;
    if (!(length > Scalar(1e-6) * s.rest_length)) continue;  // no direction to push in
    const Vector3<Scalar> f = d * (s.stiffness * stretch / length);
    forces.col(s.a) -= f;
    forces.col(s.b) += f;
  }
  for (const BendStencil<Scalar>& b : network.bends) {
    Vector3<Scalar> curvature = Vector3<Scalar>::Zero();
    const std::size_t count = static_cast<std::size_t>(b.count);
    for (std::size_t i = 0; i < count; ++i) curvature += x.col(b.vertex[i]) * b.weight[i];
    energy += Scalar(0.5) * b.stiffness * curvature.squaredNorm();
    for (std::size_t i = 0; i < count; ++i) forces.col(b.vertex[i]) -= curvature * (b.stiffness * b.weight[i]);
  }
  return energy;
}

/// The elastic energy at positions `x` (J).
template <RealScalar Scalar>
Scalar spring_energy(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x) {
  using std::sqrt;
  Scalar energy = Scalar(0);
  for (const Spring<Scalar>& s : network.springs) {
    const Vector3<Scalar> d = x.col(s.a) - x.col(s.b);
    const Scalar stretch = sqrt(d.squaredNorm()) - s.rest_length;
    energy += Scalar(0.5) * s.stiffness * stretch * stretch;
  }
  for (const BendStencil<Scalar>& b : network.bends) {
    Vector3<Scalar> curvature = Vector3<Scalar>::Zero();
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i) curvature += x.col(b.vertex[i]) * b.weight[i];
    energy += Scalar(0.5) * b.stiffness * curvature.squaredNorm();
  }
  return energy;
}

}  // namespace clothctl
