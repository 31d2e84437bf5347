#pragma once

// Bending stencils of any mesh in batches. Symbols: p positions, w inverse masses, ω weights of a
// stencil, kb its stiffness, h substep, r relaxation, λ multiplier (a vector).
//
//   compliant:  Δλ = -( h² kb Σ ω_i p_i + λ ) / ( h² kb Σ ω_i² w_i + 1 )
//   rigid:      Δλ = -r Σ ω_i p_i / Σ ω_i² w_i
//   both:       p_i += ω_i w_i Δλ,   compliant: λ += Δλ
//
// A stencil of fewer than four vertices has a spare vertex at weight 0 in the places left.

#include <array>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/detail/edge_batches.hpp"
#include "clothctl/cloth/detail/point_batch.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Constants of the stencils, batch by batch.
template <RealScalar Scalar>
struct BendBatches {
  /// Where the four vertices begin in the buffer of points, and their weights.
  std::array<std::vector<int>, 4> vertex;
  std::array<VectorX<Scalar>, 4> weight;
  /// kb, N/m.
  VectorX<Scalar> stiffness;

  Index size() const { return stiffness.size(); }
};

/// Numbers of the stencils during a step: the factors of Σ ω p and of λ in -Δλ, and λ.
template <RealScalar Scalar>
struct BendScratch {
  VectorX<Scalar> error_factor, multiplier_factor;
  std::array<VectorX<Scalar>, 3> multiplier;

  /// Allocates.
  void resize(Index size) {
    error_factor.setZero(size);
    multiplier_factor.setZero(size);
    for (VectorX<Scalar>& list : multiplier) list.setZero(size);
  }
};

/// Packs the stencils of positive stiffness. `spare`: the first of two vertices that no stencil
/// holds. Allocates.
template <RealScalar Scalar>
BendBatches<Scalar> pack_bends(const std::vector<BendStencil<Scalar>>& bends,
                               const PackOrder& order, int spare) {
  std::vector<std::size_t> items;
  for (std::size_t e = 0; e < bends.size(); ++e) {
    if (Scalar(0) < bends[e].stiffness) items.push_back(e);
  }
  const auto vertices = [&](std::size_t i) {
    const BendStencil<Scalar>& s = bends[items[i]];
    std::array<int, 4> v = s.vertex;
    for (std::size_t c = static_cast<std::size_t>(s.count); c < 4; ++c) v[c] = v[0];
    return v;
  };
  const std::vector<int> places = pack_items(items.size(), static_cast<std::size_t>(spare),
                                             batch_lanes<Scalar>(), order, vertices);
  BendBatches<Scalar> out;
  const Index size = static_cast<Index>(places.size());
  out.stiffness.setZero(size);
  for (std::size_t c = 0; c < 4; ++c) {
    out.vertex[c].assign(places.size(), 4 * spare);
    out.weight[c].setZero(size);
  }
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (places[i] < 0) continue;
    const BendStencil<Scalar>& s = bends[items[static_cast<std::size_t>(places[i])]];
    out.stiffness[static_cast<Index>(i)] = s.stiffness;
    for (std::size_t c = 0; c < static_cast<std::size_t>(s.count); ++c) {
      out.vertex[c][i] = 4 * s.vertex[c];
      out.weight[c][static_cast<Index>(i)] = s.weight[c];
    }
  }
  return out;
}

/// Computes the factors of a step of substep `h` (s) from the inverse masses in `points`.
template <RealScalar Scalar>
void prepare_bends(const BendBatches<Scalar>& bends, const Scalar& h, const Scalar* points,
                   BendScratch<Scalar>& scratch) {
  for (Index i = 0; i < bends.size(); ++i) {
    const Scalar k = h * h * bends.stiffness[i];
    const Scalar inverse = Scalar(1) / (k * squared_share(bends, i, points) + Scalar(1));
    scratch.error_factor[i] = k * inverse;
    scratch.multiplier_factor[i] = inverse;
  }
}

/// The same for rigid stencils of a relaxation.
template <RealScalar Scalar>
void prepare_rigid_bends(const BendBatches<Scalar>& bends, const Scalar& relaxation,
                         const Scalar* points, BendScratch<Scalar>& scratch) {
  for (Index i = 0; i < bends.size(); ++i) {
    const Scalar sum = squared_share(bends, i, points);
    scratch.error_factor[i] = Scalar(0) < sum ? relaxation / sum : Scalar(0);
  }
}

/// Σ ω² w of stencil i.
template <RealScalar Scalar>
Scalar squared_share(const BendBatches<Scalar>& bends, Index i, const Scalar* points) {
  Scalar sum = Scalar(0);
  for (std::size_t c = 0; c < 4; ++c) {
    const Scalar& weight = bends.weight[c][i];
    sum = sum + weight * weight * points[bends.vertex[c][static_cast<std::size_t>(i)] + 3];
  }
  return sum;
}

/// Sweeps the stencils once. `kRead`: λ is read (it is 0 in the first sweep of a substep);
/// `kWrite`: λ is written.
template <bool kRead, bool kWrite, RealScalar Scalar>
void sweep_bends(const BendBatches<Scalar>& bends, BendScratch<Scalar>& scratch, Scalar* points) {
  using Batch = PointBatch<Scalar>;
  using Pack = typename Batch::Pack;
  constexpr Index kLanes = Batch::kLanes;
  for (Index at = 0; at < bends.size(); at += kLanes) {
    std::array<Batch, 4> p;
    std::array<Pack, 4> weight;
    for (std::size_t c = 0; c < 4; ++c) {
      p[c] = Batch::load(points, bends.vertex[c].data() + at);
      weight[c] = Pack::load(bends.weight[c].data() + at);
    }
    const Pack factor = Pack::load(scratch.error_factor.data() + at);
    const auto change_of = [&](Pack Batch::*axis, std::size_t c) CLOTHCTL_KERNEL_LAMBDA {
      Pack change = (weight[0] * p[0].*axis + weight[1] * p[1].*axis) +
                    (weight[2] * p[2].*axis + weight[3] * p[3].*axis);
      change = change * factor;
      Scalar* multiplier = scratch.multiplier[c].data() + at;
      if constexpr (kRead) {
        const Pack before = Pack::load(multiplier);
        change = change + before * Pack::load(scratch.multiplier_factor.data() + at);
        if constexpr (kWrite) (before - change).store(multiplier);
      } else if constexpr (kWrite) {
        (Pack::all(Scalar(0)) - change).store(multiplier);
      }
      return change;
    };
    const Pack x = change_of(&Batch::x, 0), y = change_of(&Batch::y, 1),
               z = change_of(&Batch::z, 2);
    for (std::size_t c = 0; c < 4; ++c) {
      const Pack share = weight[c] * p[c].w;
      p[c].x = p[c].x - share * x;
      p[c].y = p[c].y - share * y;
      p[c].z = p[c].z - share * z;
      p[c].store(points, bends.vertex[c].data() + at);
    }
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
