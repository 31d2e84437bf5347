#pragma once

// Forces, energy and step matrices of a spring network.
//
//   f_a = -k (l - l0) n,  f_b = -f_a,          n = (x_a - x_b)/l
//   K   = Σ k [ n nᵀ + g (I - n nᵀ) ]          on (a,a) and (b,b), minus that on (a,b)
//         g = 1 - l0/l       in tension (l >= l0): exact, the block is positive semidefinite
//         g = γ (1 - l0/l)   in compression: γ = 1 is exact but indefinite, γ = 0 is the
//                            projection onto the positive semidefinite matrices
//   D   = Σ d n nᵀ           in the same pattern
//   C   = Σ C_t / 9          on the nine blocks that couple the corners of a triangle, with C_t
//                            from air_forces.hpp
//   bending: f_i = -kb w_i Σ_j w_j x_j,   K_ij += kb w_i w_j I;  folded_hinge.hpp has the hinges
//            that are folded at rest
//
// Symbols: f forces; K, D and C stiffness, damper and air matrix; x positions; l length, l0 rest
// length, k stiffness and d damper of a spring; kb stiffness and w weights of a stencil. The
// tension part of K is the pendulum stiffness of a hanging sheet; without it a linearised sheet
// would not swing. A spring whose ends coincide (l < 1e-6 l0) has no direction: it exerts no force,
// and k I takes the place of its block in K, so that the matrix stays definite.

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/air_forces.hpp"
#include "clothctl/cloth/detail/folded_hinge.hpp"
#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/cloth/mass_spring_settings.hpp"
#include "clothctl/linalg/block_symmetric.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns the squared length below which a spring has no direction, m².
template <RealScalar Scalar>
Scalar shortest_squared(const Spring<Scalar>& s) {
  return Scalar(1e-12) * s.rest_length * s.rest_length;
}

/// out += block, entry by entry.
template <RealScalar Scalar>
void add_block(Matrix3<Scalar>& out, const Matrix3<Scalar>& block) {
  // Eight and one: compilers vectorise the loop over eight.
  Scalar* to = out.data();
  const Scalar* from = block.data();
  for (int k = 0; k < 8; ++k) to[k] = to[k] + from[k];
  to[8] = to[8] + from[8];
}

/// Returns u wᵀ.
template <RealScalar Scalar>
Matrix3<Scalar> outer_product(const Triple<Scalar>& u, const Triple<Scalar>& w) {
  Matrix3<Scalar> block;
  const std::array<Scalar, 3> factor{w.x, w.y, w.z};
  for (Index j = 0; j < 3; ++j) {
    const Triple<Scalar> entries = u * factor[static_cast<std::size_t>(j)];
    block(0, j) = entries.x;
    block(1, j) = entries.y;
    block(2, j) = entries.z;
  }
  return block;
}

/// Adds `value` to the diagonal of a block.
template <RealScalar Scalar>
void add_to_diagonal(Matrix3<Scalar>& block, const Scalar& value) {
  for (Index c = 0; c < 3; ++c) block(c, c) = block(c, c) + value;
}

/// The blocks that bending has in a step matrix.
enum class BendingBlocks {
  /// None.
  Absent,
  /// Those of pairs of vertices with weights of opposite signs, which are neighbours. A pair i, j
  /// gets ½ kb |w_i w_j| I as a spring without rest length would; twice that bounds the stiffness
  /// of bending from above.
  Neighbours,
  /// All of them.
  All
};

/// For each element of a network, the blocks of a BlockSymmetric matrix that it adds to.
template <RealScalar Scalar>
class SpringPattern {
 public:
  /// An empty pattern.
  SpringPattern() = default;

  /// Finds the blocks of all springs, those of the bending stencils that `bending` names, and those
  /// of the triangles if `with_air` is set. No element may contain a vertex twice. Allocates.
  SpringPattern(const SpringNetwork<Scalar>& network, BendingBlocks bending, bool with_air)
      : bending_(bending) {
    std::vector<std::pair<int, int>> springs, bends, triangles;
    for (const Spring<Scalar>& s : network.springs) springs.emplace_back(s.a, s.b);
    for (const BendStencil<Scalar>& b : network.bends) {
      each_pair(b, [&](int i, int j) {
        if (has_block(b, i, j)) bends.emplace_back(vertex(b, i), vertex(b, j));
      });
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
    springs_ = block_slots(springs);
    bends_ = block_slots(bends);
    triangles_ = block_slots(triangles);
  }

  /// Returns a matrix of this pattern whose entries are zero.
  const BlockSymmetric<Scalar>& matrix() const { return matrix_; }

  /// Adds `factor` times the springs' stiffness K at positions `x` (3×n, m) to `out`, with the
  /// factors `scale` on the parts of K. Never allocates. Complexity: O(springs).
  void add_springs(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x,
                   const StiffnessScale<Scalar>& scale, Scalar factor,
                   BlockSymmetric<Scalar>& out) const {
    using std::sqrt;
    for (std::size_t e = 0; e < network.springs.size(); ++e) {
      const Spring<Scalar>& s = network.springs[e];
      const Triple<Scalar> d = column(x, s.a) - column(x, s.b);
      const Scalar squared = squared_norm(d);
      const Scalar axial = factor * s.stiffness * scale.axial;
      Matrix3<Scalar> block;
      if (shortest_squared(s) < squared) {
        const Scalar strain = Scalar(1) - s.rest_length / sqrt(squared);
        const Scalar across = factor * s.stiffness * strain *
                              (Scalar(0) < strain ? scale.geometric : scale.compression);
        block = outer_product(d, d * ((axial - across) / squared));
        add_to_diagonal(block, across);
      } else {
        block.setZero();
        add_to_diagonal(block, axial);
      }
      add_spring_block(s, springs_[e], block, out);
    }
  }

  /// Adds `factor` times the bending stiffness at positions `x` (3×n, m) to `out`, as far as the
  /// pattern has it. With all blocks, hinges that are folded at rest depend on `x`. Never
  /// allocates.
  void add_bending(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x, Scalar factor,
                   BlockSymmetric<Scalar>& out) const {
    if (bends_.empty()) return;
    std::size_t slot = 0;
    for (const BendStencil<Scalar>& b : network.bends) {
      if (bending_ == BendingBlocks::Neighbours) {
        each_pair(b, [&](int i, int j) {
          if (has_block(b, i, j)) add_tie(b, i, j, factor, bends_[slot++], out);
        });
        continue;
      }
      if (b.is_folded()) {
        add_folded(b, FoldedHinge<Scalar>(b, x), factor, bends_.data() + slot, out);
        slot += 6;
        continue;
      }
      for (int i = 0; i < b.count; ++i) {
        add_to_diagonal(out.diagonal(vertex(b, i)),
                        Scalar(factor * b.stiffness * weight(b, i) * weight(b, i)));
      }
      each_pair(b, [&](int i, int j) {
        add_to_diagonal(out.lower(bends_[slot++]),
                        Scalar(factor * b.stiffness * weight(b, i) * weight(b, j)));
      });
    }
  }

  /// Adds two matrices to `out`: `dt` times D for springs along the unit vectors `direction`
  /// (3×springs), and `dt` times C for the matrices C_t of the triangles (`air`; empty: no air).
  /// Never allocates.
  void add_frozen(const SpringNetwork<Scalar>& network, const Points<Scalar>& direction,
                  const std::vector<Matrix3<Scalar>>& air, Scalar dt,
                  BlockSymmetric<Scalar>& out) const {
    for (std::size_t e = 0; e < network.springs.size(); ++e) {
      const Spring<Scalar>& s = network.springs[e];
      if (!(Scalar(0) < s.damping)) continue;
      const Triple<Scalar> n = column(direction, static_cast<Index>(e));
      add_spring_block(s, springs_[e], outer_product(n, n * (dt * s.damping)), out);
    }
    add_air(network, air, dt, out);
  }

  /// Adds `dt` times C for the matrices C_t of the triangles (`air`; empty: no air) to `out`. Never
  /// allocates.
  void add_air(const SpringNetwork<Scalar>& network, const std::vector<Matrix3<Scalar>>& air,
               Scalar dt, BlockSymmetric<Scalar>& out) const {
    const Scalar ninth = Scalar(1) / Scalar(9);
    for (std::size_t e = 0; e < air.size(); ++e) {
      const std::array<int, 3>& t = network.triangles[e];
      const Matrix3<Scalar> block = air[e] * (dt * ninth);
      for (std::size_t i = 0; i < 3; ++i) {
        add_block(out.diagonal(t[i]), block);
        add_block(out.lower(triangles_[3 * e + i]), block);
      }
    }
  }

 private:
  /// Adds the stiffness of a folded hinge; `pairs` holds the slots of its six pairs of vertices.
  static void add_folded(const BendStencil<Scalar>& b, const FoldedHinge<Scalar>& hinge,
                         const Scalar& factor, const int* pairs, BlockSymmetric<Scalar>& out) {
    const Scalar stiffness = factor * b.stiffness;
    for (int i = 0; i < 4; ++i)
      add_block(out.diagonal(vertex(b, i)), hinge.stiffness_block(i, i, stiffness));
    each_pair(b, [&](int i, int j) {
      const bool below = vertex(b, j) < vertex(b, i);
      add_block(out.lower(*pairs++),
                hinge.stiffness_block(below ? i : j, below ? j : i, stiffness));
    });
  }
  static void add_spring_block(const Spring<Scalar>& s, int slot, const Matrix3<Scalar>& block,
                               BlockSymmetric<Scalar>& out) {
    add_block(out.diagonal(s.a), block);
    add_block(out.diagonal(s.b), block);
    Scalar* lower = out.lower(slot).data();
    const Scalar* from = block.data();
    for (int k = 0; k < 8; ++k) lower[k] = lower[k] - from[k];
    lower[8] = lower[8] - from[8];
  }
  /// Adds the spring without rest length that stands for the bending of a pair of neighbours.
  static void add_tie(const BendStencil<Scalar>& b, int i, int j, const Scalar& factor, int slot,
                      BlockSymmetric<Scalar>& out) {
    const Scalar coupling = Scalar(0.5) * factor * b.stiffness * weight(b, i) * weight(b, j);
    const Scalar own = Scalar(0) - coupling;
    add_to_diagonal(out.lower(slot), coupling);
    add_to_diagonal(out.diagonal(vertex(b, i)), own);
    add_to_diagonal(out.diagonal(vertex(b, j)), own);
  }
  bool has_block(const BendStencil<Scalar>& b, int i, int j) const {
    if (bending_ != BendingBlocks::Neighbours) return bending_ == BendingBlocks::All;
    return weight(b, i) * weight(b, j) < Scalar(0);
  }
  static int vertex(const BendStencil<Scalar>& b, int i) {
    return b.vertex[static_cast<std::size_t>(i)];
  }
  static const Scalar& weight(const BendStencil<Scalar>& b, int i) {
    return b.weight[static_cast<std::size_t>(i)];
  }
  template <class Function>
  static void each_pair(const BendStencil<Scalar>& b, Function&& function) {
    for (int i = 1; i < b.count; ++i) {
      for (int j = 0; j < i; ++j) function(i, j);
    }
  }
  std::vector<int> block_slots(const std::vector<std::pair<int, int>>& pairs) const {
    std::vector<int> out;
    out.reserve(pairs.size());
    for (const std::pair<int, int>& p : pairs) out.push_back(matrix_.find(p.first, p.second));
    return out;
  }

  BlockSymmetric<Scalar> matrix_;
  BendingBlocks bending_ = BendingBlocks::Absent;
  std::vector<int> springs_;
  std::vector<int> bends_;
  std::vector<int> triangles_;
};

/// Writes the unit vectors n = (x_a - x_b)/l of the springs at positions `x` (3×n, m) into
/// `direction` (3×springs); zero when the ends coincide. Never allocates.
template <RealScalar Scalar>
void spring_directions(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x,
                       Points<Scalar>& direction) {
  using std::sqrt;
  for (std::size_t e = 0; e < network.springs.size(); ++e) {
    const Spring<Scalar>& s = network.springs[e];
    const Triple<Scalar> d = column(x, s.a) - column(x, s.b);
    const Scalar squared = squared_norm(d);
    const Scalar factor = shortest_squared(s) < squared ? Scalar(1) / sqrt(squared) : Scalar(0);
    set_column(direction, static_cast<Index>(e), d * factor);
  }
}

/// Writes the air matrices C_t of the triangles at positions `x` (3×n, m) and velocities `v` (3×n,
/// m/s) into `air` (one entry for each triangle; empty: no air). Adds the forces C w of air that
/// moves at `wind` (m/s) to `forces` (3×n, N). Never allocates.
template <RealScalar Scalar>
void freeze_air(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x,
                const PointsView<Scalar>& v, const Vector3<Scalar>& wind,
                const AirSettings<Scalar>& settings, std::vector<Matrix3<Scalar>>& air,
                Points<Scalar>& forces) {
  const Scalar third = Scalar(1) / Scalar(3);
  for (std::size_t e = 0; e < air.size(); ++e) {
    const std::array<int, 3>& t = network.triangles[e];
    const Triple<Scalar> mean = (column(v, t[0]) + column(v, t[1]) + column(v, t[2])) * third;
    const AirFacet<Scalar> facet(column(x, t[0]), column(x, t[1]), column(x, t[2]));
    air[e] = air_drag_matrix(facet, AirDrag<Scalar>(facet, triple(wind) - mean, settings));
    const Triple<Scalar> push = product(air[e], triple(wind)) * third;
    for (int vertex : t) add_to_column(forces, vertex, push);
  }
}

/// Adds dt C v to `gradient` (3×n, N s) for the matrices C_t of the triangles (`air`; empty: no
/// air) at velocities `v` (3×n, m/s) and returns `energy` plus ½ dt vᵀC v (J). Never allocates.
template <RealScalar Scalar>
Scalar add_air_gradient(const SpringNetwork<Scalar>& network,
                        const std::vector<Matrix3<Scalar>>& air, const Points<Scalar>& v,
                        const Scalar& dt, Scalar energy, Points<Scalar>& gradient) {
  const Scalar third = Scalar(1) / Scalar(3), half = Scalar(0.5);
  for (std::size_t e = 0; e < air.size(); ++e) {
    const std::array<int, 3>& t = network.triangles[e];
    const Triple<Scalar> mean = (column(v, t[0]) + column(v, t[1]) + column(v, t[2])) * third;
    const Triple<Scalar> push = product(air[e], mean);
    energy += half * dt * dot(mean, push);
    for (int vertex : t) add_to_column(gradient, vertex, push * (dt * third));
  }
  return energy;
}

/// Adds bending forces at positions `x` (3×n, m) to `forces` (3×n, N) and returns `energy` plus
/// theirs (J). Never allocates.
template <RealScalar Scalar>
Scalar add_bending_forces(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x,
                          Scalar energy, Points<Scalar>& forces) {
  for (const BendStencil<Scalar>& b : network.bends) {
    if (b.is_folded()) {
      const FoldedHinge<Scalar> hinge(b, x);
      energy += Scalar(0.5) * b.stiffness * squared_norm(hinge.error());
      const Triple<Scalar> push = hinge.error() * b.stiffness;
      for (int i = 0; i < 4; ++i)
        subtract_from_column(forces, b.vertex[static_cast<std::size_t>(i)], hinge.share(i, push));
      continue;
    }
    const Triple<Scalar> curvature = stencil_curvature<Scalar>(b, x);
    energy += Scalar(0.5) * b.stiffness * squared_norm(curvature);
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i)
      subtract_from_column(forces, b.vertex[i], curvature * (b.stiffness * b.weight[i]));
  }
  return energy;
}

/// Adds spring and bending forces at positions `x` (3×n, m) to `forces` (3×n, N) and returns their
/// energy (J). Never allocates.
template <RealScalar Scalar>
Scalar add_spring_forces(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x,
                         Points<Scalar>& forces) {
  using std::sqrt;
  Scalar energy = Scalar(0);
  for (const Spring<Scalar>& s : network.springs) {
    const Triple<Scalar> d = column(x, s.a) - column(x, s.b);
    const Scalar squared = squared_norm(d);
    const Scalar length = sqrt(squared);
    const Scalar stretch = length - s.rest_length;
    energy += Scalar(0.5) * s.stiffness * stretch * stretch;
    if (!(shortest_squared(s) < squared)) continue;
    const Triple<Scalar> f = d * (s.stiffness * stretch / length);
    subtract_from_column(forces, s.a, f);
    add_to_column(forces, s.b, f);
  }
  return add_bending_forces<Scalar>(network, x, energy, forces);
}

/// Returns the elastic energy at positions `x` (3×n, m), J. Never allocates.
template <RealScalar Scalar>
Scalar spring_energy(const SpringNetwork<Scalar>& network, const PointsView<Scalar>& x) {
  using std::sqrt;
  Scalar energy = Scalar(0);
  for (const Spring<Scalar>& s : network.springs) {
    const Scalar stretch = sqrt(squared_norm(column(x, s.a) - column(x, s.b))) - s.rest_length;
    energy += Scalar(0.5) * s.stiffness * stretch * stretch;
  }
  for (const BendStencil<Scalar>& b : network.bends) {
    energy += Scalar(0.5) * b.stiffness * squared_norm(bending_error<Scalar>(b, x));
  }
  return energy;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
