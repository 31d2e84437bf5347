#pragma once

// Bending stencils of any mesh in batches. Symbols: p positions, w inverse masses, ω weights of a
// stencil, kb its stiffness, h substep, r relaxation, λ multiplier (a vector).
//
//   compliant:  Δλ = -( h² kb Σ ω_i p_i + λ ) / ( h² kb S + 1 ),   S = Σ ω_i² w_i
//   rigid:      Δλ = -r Σ ω_i p_i / S
//   both:       p_i += ω_i w_i Δλ,   compliant: λ += Δλ
//
// A stencil of fewer than four vertices has a spare vertex at weight 0 in the places left.
//
// A hinge that is folded at rest has e in place of Σ ω_i p_i, and its vertices move along J_i
// (folded_hinge.hpp; also for a short edge with u from r, but without the turn of u by D): p_i +=
// w_i J_iᵀ Δλ. Its denominators take, in place of S, the bound
//
//   b = S + s² (|D|²/|E|² (w_0 + w_1) + (ω_2 - ω_3)² w_0)
//
// for Σ w_i J_i J_iᵀ, which is at most 2 b: no visit overshoots by more than that factor. The
// multiplier of the next sweep makes up for what a visit leaves. If one hinge of a network is
// folded, all stencils are swept in this form.

#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/edge_batches.hpp"
#include "clothctl/cloth/detail/folded_hinge.hpp"
#include "clothctl/cloth/detail/point_batch.hpp"
#include "clothctl/cloth/detail/sweep_order.hpp"
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
  /// cos θ0/2 and sin θ0/2 of the rest angles; empty when all stencils rest flat.
  VectorX<Scalar> cosine, sine;
  /// Bounds of the groups.
  GroupBounds bounds{0, 0, 0};

  Index size() const { return stiffness.size(); }
};

/// Numbers of the stencils during a step: the factors of Σ ω p and of λ in -Δλ, and λ.
template <RealScalar Scalar>
struct BendScratch {
  VectorX<Scalar> error_factor, multiplier_factor;
  /// With folded hinges: r, which `error_factor` leaves out; 1 for compliant stencils.
  Scalar relaxation = Scalar(1);
  std::array<VectorX<Scalar>, 3> multiplier;

  /// Allocates.
  void resize(Index size) {
    error_factor.setZero(size);
    multiplier_factor.setZero(size);
    for (VectorX<Scalar>& list : multiplier) list.setZero(size);
  }
};

/// Packs the stencils of positive stiffness, group by group. `spare`: the first of two vertices
/// that no stencil holds. Allocates.
template <RealScalar Scalar>
BendBatches<Scalar> pack_bends(const std::vector<BendStencil<Scalar>>& bends,
                               const PackOrder& order, int spare, const MeshParts& parts = {}) {
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
  PackedItems packed = pack_groups(items.size(), static_cast<std::size_t>(spare),
                                   batch_lanes<Scalar>(), order, parts, vertices);
  const std::vector<int>& places = packed.places;
  BendBatches<Scalar> out;
  out.bounds = std::move(packed.bounds);
  const Index size = static_cast<Index>(places.size());
  out.stiffness.setZero(size);
  for (const std::size_t e : items) {
    if (!bends[e].is_folded()) continue;
    out.cosine.setOnes(size);
    out.sine.setZero(size);
    break;
  }
  for (std::size_t c = 0; c < 4; ++c) {
    out.vertex[c].assign(places.size(), 4 * spare);
    out.weight[c].setZero(size);
  }
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (places[i] < 0) continue;
    const BendStencil<Scalar>& s = bends[items[static_cast<std::size_t>(places[i])]];
    out.stiffness[static_cast<Index>(i)] = s.stiffness;
    if (s.is_folded()) {
      const auto half = half_rest_angle(s);
      out.cosine[static_cast<Index>(i)] = half[0];
      out.sine[static_cast<Index>(i)] = half[1];
    }
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
  scratch.relaxation = Scalar(1);
}

/// The same for rigid stencils of a relaxation.
template <RealScalar Scalar>
void prepare_rigid_bends(const BendBatches<Scalar>& bends, const Scalar& relaxation,
                         const Scalar* points, BendScratch<Scalar>& scratch) {
  const bool folded = bends.sine.size() > 0;
  const Scalar factor = folded ? Scalar(1) : relaxation;
  for (Index i = 0; i < bends.size(); ++i) {
    const Scalar sum = squared_share(bends, i, points);
    scratch.error_factor[i] = Scalar(0) < sum ? factor / sum : Scalar(0);
  }
  scratch.relaxation = relaxation;
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

/// Three packs: the points or vectors of a batch.
template <class Pack>
struct PackTriple {
  Pack x, y, z;

  CLOTHCTL_KERNEL PackTriple cross(const PackTriple& b) const {
    return {y * b.z - z * b.y, z * b.x - x * b.z, x * b.y - y * b.x};
  }
  CLOTHCTL_KERNEL Pack dot(const PackTriple& b) const { return x * b.x + (y * b.y + z * b.z); }
  CLOTHCTL_KERNEL PackTriple times(const Pack& s) const { return {x * s, y * s, z * s}; }
  CLOTHCTL_KERNEL PackTriple plus(const PackTriple& b) const { return {x + b.x, y + b.y, z + b.z}; }
  CLOTHCTL_KERNEL PackTriple minus(const PackTriple& b) const {
    return {x - b.x, y - b.y, z - b.z};
  }
};

/// A batch of hinges that may be folded, in the terms of folded_hinge.hpp.
template <RealScalar Scalar>
struct FoldedBatch {
  using Batch = PointBatch<Scalar>;
  using Pack = typename Batch::Pack;
  using Triple = PackTriple<Pack>;

  std::array<Batch, 4> p;
  std::array<Pack, 4> weight;
  Pack cosine, sine;
  /// u, D/|E| and e.
  Triple along, scaled, error;

  /// Reads the stencils from `at` on.
  static CLOTHCTL_KERNEL FoldedBatch load(const BendBatches<Scalar>& bends, Index at,
                                          const Scalar* points) {
    FoldedBatch out;
    for (std::size_t c = 0; c < 4; ++c) {
      out.p[c] = Batch::load(points, bends.vertex[c].data() + at);
      out.weight[c] = Pack::load(bends.weight[c].data() + at);
    }
    out.cosine = Pack::load(bends.cosine.data() + at);
    out.sine = Pack::load(bends.sine.data() + at);
    const std::array<Pack, 4>& w = out.weight;
    const Triple a = out.point(0), b = out.point(1), left = out.point(2), right = out.point(3);
    const Triple edge = b.minus(a);
    const Triple span = right.minus(a).times(w[3]).minus(left.minus(a).times(w[2]));
    const Pack inverse =
        reciprocal_sqrt(larger(edge.dot(edge), Pack::all(Scalar(1e-6)) * span.dot(span)));
    out.along = edge.times(inverse);
    out.scaled = span.times(inverse);
    const Triple flat =
        a.times(w[0]).plus(b.times(w[1])).plus(left.times(w[2]).plus(right.times(w[3])));
    out.error = flat.times(out.cosine).minus(out.along.cross(span).times(out.sine));
    return out;
  }

  CLOTHCTL_KERNEL Triple point(std::size_t c) const { return {p[c].x, p[c].y, p[c].z}; }

  /// What the bound b has beyond Σ ω² w.
  CLOTHCTL_KERNEL Pack excess() const {
    const Pack skew = weight[2] - weight[3];
    return sine * sine * (scaled.dot(scaled) * (p[0].w + p[1].w) + skew * skew * p[0].w);
  }

  /// Moves the points by -w_i J_iᵀ `change` and writes them back.
  CLOTHCTL_KERNEL void move(const Triple& change, const BendBatches<Scalar>& bends, Index at,
                            Scalar* points) {
    const Triple straight = change.times(cosine), turn_span = change.cross(along).times(sine);
    const Triple push = scaled.cross(change);
    const Triple turn_edge = push.minus(along.times(along.dot(push))).times(sine);
    const std::array<Triple, 4> turned{turn_span.times(weight[2] - weight[3]).minus(turn_edge),
                                       turn_edge, turn_span.times(Pack::all(Scalar(0)) - weight[2]),
                                       turn_span.times(weight[3])};
    for (std::size_t c = 0; c < 4; ++c) {
      const Triple step = straight.times(weight[c]).minus(turned[c]).times(p[c].w);
      p[c].x = p[c].x - step.x;
      p[c].y = p[c].y - step.y;
      p[c].z = p[c].z - step.z;
      p[c].store(points, bends.vertex[c].data() + at);
    }
  }
};

/// The sweep of some places of a network with folded hinges; `kRead` and `kWrite` as in
/// sweep_bends.
template <bool kRead, bool kWrite, RealScalar Scalar>
void sweep_folded_range(const BendBatches<Scalar>& bends, BendScratch<Scalar>& scratch,
                        Scalar* points, const SweepPlaces& places) {
  using Hinges = FoldedBatch<Scalar>;
  using Pack = typename Hinges::Pack;
  using Triple = typename Hinges::Triple;
  const Pack zero = Pack::all(Scalar(0)), one = Pack::all(Scalar(1));
  const Pack relaxation = Pack::all(scratch.relaxation);
  for (std::size_t i = 0; i < places.count(); ++i) {
    const Index at = static_cast<Index>(places[i]);
    Hinges hinges = Hinges::load(bends, at, points);
    const Pack factor = Pack::load(scratch.error_factor.data() + at);
    const Pack less = one / (one + factor * hinges.excess());
    Triple change = hinges.error.times(factor * less * relaxation);
    Triple before{zero, zero, zero};
    if constexpr (kRead) {
      before.x = Pack::load(scratch.multiplier[0].data() + at);
      before.y = Pack::load(scratch.multiplier[1].data() + at);
      before.z = Pack::load(scratch.multiplier[2].data() + at);
      const Pack kept = Pack::load(scratch.multiplier_factor.data() + at) * less;
      change = change.plus(before.times(kept));
    }
    if constexpr (kWrite) {
      const Triple after = before.minus(change);
      after.x.store(scratch.multiplier[0].data() + at);
      after.y.store(scratch.multiplier[1].data() + at);
      after.z.store(scratch.multiplier[2].data() + at);
    }
    hinges.move(change, bends, at, points);
  }
}

/// The sweep of some places of a network whose hinges all rest flat.
template <bool kRead, bool kWrite, RealScalar Scalar>
void sweep_flat_range(const BendBatches<Scalar>& bends, BendScratch<Scalar>& scratch,
                      Scalar* points, const SweepPlaces& places) {
  using Batch = PointBatch<Scalar>;
  using Pack = typename Batch::Pack;
  for (std::size_t i = 0; i < places.count(); ++i) {
    const Index at = static_cast<Index>(places[i]);
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

/// Sweeps the stencils once. `kRead`: λ is read (it is 0 in the first sweep of a substep);
/// `kWrite`: λ is written.
template <bool kRead, bool kWrite, RealScalar Scalar>
void sweep_bends(const BendBatches<Scalar>& bends, BendScratch<Scalar>& scratch, Scalar* points,
                 const ExecutorRef& executor = {}, SweepOrder order = SweepOrder::Forward) {
  const auto sweep_group = [&](std::size_t, std::size_t begin, std::size_t end) {
    const SweepPlaces places(order, begin, end, static_cast<std::size_t>(batch_lanes<Scalar>()));
    if (bends.sine.size() > 0) {
      sweep_folded_range<kRead, kWrite>(bends, scratch, points, places);
    } else {
      sweep_flat_range<kRead, kWrite>(bends, scratch, points, places);
    }
  };
  for_each_group(bends.bounds, executor, sweep_group, order);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
