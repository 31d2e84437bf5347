#pragma once

// Forces, energy and step matrices of a spring network.
//
//   f_a = -k (l - l0) n,  f_b = -f_a,            n = (x_a - x_b)/l
//   K   = Σ k [ n nᵀ + g (I - n nᵀ) ]            on (a,a), (b,b); minus on (a,b)
//         g = 1 - l0/l                           in tension (l >= l0): exact, and the block is positive semidefinite
//         g = γ (1 - l0/l)                       in compression: γ = 1 exact but indefinite, γ = 0 its SPD projection
//   D   = Σ d n nᵀ  in the same pattern
//   C   = Σ C_t / 9 on the nine corner blocks of a triangle, see air.hpp
//   bending: f_i = -kb w_i Σ_j w_j x_j,  K_ij += kb w_i w_j I
//
// The tension part is the pendulum stiffness of a hanging sheet and must stay. Springs whose ends coincide (l < 1e-6 l0)
// have no direction: they exert no force, and k I in K keeps matrices definite.

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/cloth/air.hpp"
#include "clothctl/cloth/spring_network.hpp"
#include "clothctl/math/block_symmetric.hpp"

namespace clothctl {

/// Factors that a predictor may put on the stiffness blocks. The defaults give the true model's SPD-projected stiffness.
template <RealScalar Scalar>
struct StiffnessScale {
  /// Factor on the axial part k n nᵀ.
  Scalar axial = Scalar(1);
  /// Factor on the tension (geometric) part k max(0, 1 - l0/l) (I - n nᵀ).
  Scalar geometric = Scalar(1);
  /// Factor on the bending part.
  Scalar bending = Scalar(1);
  /// Factor γ on the compression part k min(0, 1 - l0/l) (I - n nᵀ); 1 is exact, but any other value than 0 may make a
  /// matrix indefinite.
  Scalar compression = Scalar(0);
};

namespace detail {

/// Squared length below which a spring counts as having no direction, m².
template <RealScalar Scalar>
Scalar shortest_squared(const Spring<Scalar>& s) {
  return Scalar(1e-12) * s.rest_length * s.rest_length;
}

/// Σ w_i x_i of a stencil, m.
template <RealScalar Scalar>
Vector3<Scalar> stencil_curvature(const BendStencil<Scalar>& b, const PointsView<Scalar>& x) {
  Vector3<Scalar> sum = Vector3<Scalar>::Zero();
  for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i) sum += x.col(b.vertex[i]) * b.weight[i];
  return sum;
}

}  // namespace detail

/// Where each element of a network writes in a BlockSymmetric matrix.
template <RealScalar Scalar>
class SpringPattern {
 public:
  /// An empty pattern.
  SpringPattern() = default;

  /// Finds the slots of all springs, bending stencils (when `with_bending`) and triangles (when `with_air`). No element may
  /// hold a vertex twice. Allocates.
  SpringPattern(const SpringNetwork<Scalar>& network, bool with_bending, bool with_air) {
    std::vector<std::pair<int, int>> springs, bends, triangles;
    for (const Spring<Scalar>& s : network.springs) springs.emplace_back(s.a, s.b);
    if (with_bending) {
      for (const BendStencil<Scalar>& b : network.bends) {
        each_pair(b, [&](int i, int j) { bends.emplace_back(vertex(b, i), vertex(b, j)); });
      }
    }
    if (with_air) {
      for (const std::array<int, 3>& t : network.triangles) {
        for (std::size_t e = 0; e < 3; ++e) triangles.emplace_back(t[e], t[(e + 1) % 3]);
      }
    }
    std::vector<std::pair<int, int>> all = springs;
    all.insert(all.end(), bends.begin(), bends.end());
    all.insert(all.end(), triangles.begin(), triangles.end());
    matrix_ = BlockSymmetric<Scalar>(network.vertex_count(), std::move(all));
    springs_ = slots(springs);
    bends_ = slots(bends);
    triangles_ = slots(triangles);
  }

  /// An all-zero matrix of the pattern.
  const BlockSymmetric<Scalar>& matrix() const { return matrix_; }

  /// Adds `factor` times the springs' stiffness K at positions `x` (3×n, m) to `out`. Never allocates. Complexity: O(springs).
  void add_springs(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x, const StiffnessScale<Scalar>& scale,
                   Scalar factor, BlockSymmetric<Scalar>& out) const {
    using std::sqrt;
    for (std::size_t e = 0; e < network.springs.size(); ++e) {
      const Spring<Scalar>& s = network.springs[e];
      const Vector3<Scalar> d = x.col(s.a) - x.col(s.b);
      const Scalar squared = d.squaredNorm();
      const Scalar axial = factor * s.stiffness * scale.axial;
      Matrix3<Scalar> block;
      if (detail::shortest_squared(s) < squared) {
        const Scalar strain = Scalar(1) - s.rest_length / sqrt(squared);
        const Scalar across = factor * s.stiffness * strain * (Scalar(0) < strain ? scale.geometric : scale.compression);
        block.noalias() = d * (d.transpose() * ((axial - across) / squared));
        block.diagonal().array() += across;
      } else {
        block = Matrix3<Scalar>::Identity() * axial;
      }
      out.diagonal(s.a) += block;
      out.diagonal(s.b) += block;
      out.lower(springs_[e]) -= block;
    }
  }

  /// Adds `factor` times the bending stiffness to `out`; nothing when the pattern was made without bending. Never allocates.
  void add_bending(const SpringNetwork<Scalar>& network, Scalar factor, BlockSymmetric<Scalar>& out) const {
    if (bends_.empty()) return;
    std::size_t slot = 0;
    for (const BendStencil<Scalar>& b : network.bends) {
      for (int i = 0; i < b.count; ++i) {
        out.diagonal(vertex(b, i)).diagonal().array() += factor * b.stiffness * weight(b, i) * weight(b, i);
      }
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
  std::vector<int> slots(const std::vector<std::pair<int, int>>& pairs) const {
    std::vector<int> out;
    out.reserve(pairs.size());
    for (const std::pair<int, int>& p : pairs) out.push_back(matrix_.find(p.first, p.second));
    return out;
  }

  BlockSymmetric<Scalar> matrix_;
  std::vector<int> springs_;
  std::vector<int> bends_;
  std::vector<int> triangles_;
};

/// Writes the unit vectors n = (x_a - x_b)/l of the springs at positions `x` (3×n, m) into `direction` (3×springs); zero where
/// the ends coincide. Never allocates.
template <RealScalar Scalar>
void spring_directions(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x, Points<Scalar>& direction) {
  using std::sqrt;
  for (std::size_t e = 0; e < network.springs.size(); ++e) {
    const Spring<Scalar>& s = network.springs[e];
    const Vector3<Scalar> d = x.col(s.a) - x.col(s.b);
    const Scalar squared = d.squaredNorm();
    if (detail::shortest_squared(s) < squared) {
      direction.col(static_cast<Index>(e)) = d * (Scalar(1) / sqrt(squared));
    } else {
      direction.col(static_cast<Index>(e)).setZero();
    }
  }
}

/// Writes the air matrices C_t of the triangles at positions `x` (3×n, m) and velocities `v` (3×n, m/s) into `air` (an entry a
/// triangle, or empty: no air) and adds the forces C w of air that moves at `wind` (m/s) to `forces` (3×n, N).
/// Never allocates.
template <RealScalar Scalar>
void freeze_air(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                const Vector3<Scalar>& wind, const AirSettings<Scalar>& settings, std::vector<Matrix3<Scalar>>& air,
                Points<Scalar>& forces) {
  const Scalar third = Scalar(1) / Scalar(3);
  for (std::size_t e = 0; e < air.size(); ++e) {
    const std::array<int, 3>& t = network.triangles[e];
    const Vector3<Scalar> mean = (v.col(t[0]) + v.col(t[1]) + v.col(t[2])) * third;
    air[e] = air_drag_matrix<Scalar>(x.col(t[0]), x.col(t[1]), x.col(t[2]), mean, wind, settings);
    const Vector3<Scalar> push = air[e] * wind * third;
    for (int vertex : t) forces.col(vertex) += push;
  }
}

/// Adds spring and bending forces at positions `x` (3×n, m) to `forces` (3×n, N) and returns their energy (J). Never allocates.
template <RealScalar Scalar>
Scalar add_spring_forces(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x, Points<Scalar>& forces) {
  using std::sqrt;
  Scalar energy = Scalar(0);
  for (const Spring<Scalar>& s : network.springs) {
    const Vector3<Scalar> d = x.col(s.a) - x.col(s.b);
    const Scalar squared = d.squaredNorm();
    const Scalar length = sqrt(squared);
    const Scalar stretch = length - s.rest_length;
    energy += Scalar(0.5) * s.stiffness * stretch * stretch;
    if (!(detail::shortest_squared(s) < squared)) continue;
    const Vector3<Scalar> f = d * (s.stiffness * stretch / length);
    forces.col(s.a) -= f;
    forces.col(s.b) += f;
  }
  for (const BendStencil<Scalar>& b : network.bends) {
    const Vector3<Scalar> curvature = detail::stencil_curvature<Scalar>(b, x);
    energy += Scalar(0.5) * b.stiffness * curvature.squaredNorm();
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i) {
      forces.col(b.vertex[i]) -= curvature * (b.stiffness * b.weight[i]);
    }
  }
  return energy;
}

/// Returns the elastic energy at positions `x` (3×n, m), J. Never allocates.
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
    energy += Scalar(0.5) * b.stiffness * detail::stencil_curvature<Scalar>(b, x).squaredNorm();
  }
  return energy;
}

}  // namespace clothctl
