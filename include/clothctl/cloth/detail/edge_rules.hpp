#pragma once

// How a sweep corrects an edge. Symbols: p_a, p_b the ends, d = p_b - p_a, w inverse masses, l0
// rest length, h substep, k spring, c damper, λ multiplier. All rules move the ends along the edge:
//
//   p_a += s w_a d,   p_b -= s w_b d
//
// With e = 1 - l0/|d|, the stretch of the edge as part of its current length:
//
//   RigidRule      s = r e / (w_a + w_b), relaxation r; from both sides
//   CompliantRule  s = -Δλ/|d|,  Δλ = -( h² k (|d| - l0) + λ + h c d·(d - d_start)/|d| )
//                                      / ( (h² k + h c)(w_a + w_b) + 1 ),   λ += Δλ      (XPBD)
//   LimitRule      s = (max(σ e, e - slack, 0) + κ σ min(e + free, 0)) / (w_a + w_b),
//                  σ = h² k (w_a + w_b) / (h² k (w_a + w_b) + 1): what one XPBD visit corrects.
//                  So an edge resists stretch with its stiffness, stretch beyond the slack rigidly,
//                  and compression beyond what is free with the share κ
//   TensionRule    s = ω max(e - slack, 0) / (w_a + w_b): the limit alone, over-relaxed by ω
//
// A rule has `scale(at, q, along)`, which returns s of the lanes from `at` on, where q = |d|² and
// `along()` = d·d_start. Entries without an edge have weight 0. `join(other)` takes over what a
// copy of the rule has found on other edges.

#include "clothctl/core/simd.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Arrays of one kind of edges for the rules, as pointers; those that a rule does not use may be
/// null.
template <RealScalar Scalar>
struct EdgeData {
  /// Rest length l0, m.
  const Scalar* rest = nullptr;
  /// 1/(w_a + w_b) times the relaxation, for rigid corrections; 0 where there is no edge.
  const Scalar* weight = nullptr;
  /// σ, or h² k.
  const Scalar* stiffness = nullptr;
  /// h c.
  const Scalar* damping = nullptr;
  /// 1/((h² k + h c)(w_a + w_b) + 1).
  const Scalar* inverse = nullptr;
  /// λ.
  Scalar* multiplier = nullptr;
};

/// Rigid from both sides.
template <RealScalar Scalar, int kLanes>
struct RigidRule {
  static constexpr bool kNeedsStart = false;
  using Pack = Simd<Scalar, kLanes>;
  template <class Along>
  CLOTHCTL_KERNEL Pack scale(const EdgeData<Scalar>& data, std::size_t at, const Pack& q,
                             const Along&) {
    const Pack e = Pack::all(Scalar(1)) - Pack::load(data.rest + at) * reciprocal_sqrt(q);
    return e * Pack::load(data.weight + at);
  }
  void join(const RigidRule&) {}
};

/// XPBD. `kRead`: λ is read (it is 0 in the first sweep of a substep). `kWrite`: λ is written (the
/// last sweep need not).
template <RealScalar Scalar, int kLanes, bool kDamped, bool kRead, bool kWrite>
struct CompliantRule {
  static constexpr bool kNeedsStart = kDamped;
  using Pack = Simd<Scalar, kLanes>;
  template <class Along>
  CLOTHCTL_KERNEL Pack scale(const EdgeData<Scalar>& data, std::size_t at, const Pack& q,
                             const Along& along) {
    const Pack r = reciprocal_sqrt(q);
    Pack force = Pack::load(data.stiffness + at) * (q * r - Pack::load(data.rest + at));
    if constexpr (kRead) force = force + Pack::load(data.multiplier + at);
    if constexpr (kDamped) force = force + Pack::load(data.damping + at) * (r * (q - along()));
    const Pack change = force * Pack::load(data.inverse + at);
    if constexpr (kWrite && kRead)
      (Pack::load(data.multiplier + at) - change).store(data.multiplier + at);
    if constexpr (kWrite && !kRead) (Pack::all(Scalar(0)) - change).store(data.multiplier + at);
    return change * r;
  }
  void join(const CompliantRule&) {}
};

/// Stiffness, a limit of stretch and a share of large compressions. Keeps the largest e that it
/// met.
template <RealScalar Scalar, int kLanes>
struct LimitRule {
  static constexpr bool kNeedsStart = false;
  using Pack = Simd<Scalar, kLanes>;
  Pack slack, compression, free = Pack::all(Scalar(0)), worst = Pack::all(Scalar(0));
  template <class Along>
  CLOTHCTL_KERNEL Pack scale(const EdgeData<Scalar>& data, std::size_t at, const Pack& q,
                             const Along&) {
    const Pack e = Pack::all(Scalar(1)) - Pack::load(data.rest + at) * reciprocal_sqrt(q);
    worst = larger(e, worst);
    const Pack sigma = Pack::load(data.stiffness + at), zero = Pack::all(Scalar(0));
    const Pack stretch = larger(larger(e * sigma, e - slack), zero);
    const Pack squeeze = larger(zero - e - free, zero);
    return (stretch - compression * sigma * squeeze) * Pack::load(data.weight + at);
  }
  void join(const LimitRule& other) { worst = larger(other.worst, worst); }
};

/// The limit alone, over-relaxed by ω. Keeps the largest e that it met.
template <RealScalar Scalar, int kLanes>
struct TensionRule {
  static constexpr bool kNeedsStart = false;
  using Pack = Simd<Scalar, kLanes>;
  Pack slack, omega = Pack::all(Scalar(1)), worst = Pack::all(Scalar(0));
  /// Returns an over-relaxed rule. ω = 1.7 was best on sheets of 32² to 128² vertices.
  static TensionRule over_relaxed(const Scalar& slack) {
    return {Pack::all(slack), Pack::all(Scalar(1.7))};
  }
  template <class Along>
  CLOTHCTL_KERNEL Pack scale(const EdgeData<Scalar>& data, std::size_t at, const Pack& q,
                             const Along&) {
    const Pack e = Pack::all(Scalar(1)) - Pack::load(data.rest + at) * reciprocal_sqrt(q);
    worst = larger(e, worst);
    return larger(e - slack, Pack::all(Scalar(0))) * (omega * Pack::load(data.weight + at));
  }
  void join(const TensionRule& other) { worst = larger(other.worst, worst); }
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
