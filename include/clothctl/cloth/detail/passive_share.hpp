#pragma once

// The share s of displacements d that masses m may take without gaining kinetic energy. They have
// moved by u in a substep:
//
//   Σ m |u + s d|² ≤ Σ m (|u|² + gift),    u relative to the mean displacement of the held vertices
//
// The closest correction in the metric of the masses meets this with s = 1 and no gift, whatever
// the motion. Corrections on coarse levels do not: they take one vertex for all around it, and in
// substeps below 0.2 ms bodies in rough motion gained a hundred times their energy. The gift is
//
// - the square of the largest displacement of a held vertex relative to their mean: where hands
//   move apart they do work that cannot be told from d;
// - the square of five times the fall g h² of a substep: without it, stretch that earlier substeps
//   have left goes too slowly when hands move, and garments fidget at rest.

#include <cmath>
#include <cstddef>

#include "clothctl/cloth/detail/rigid_motion.hpp"
#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/concepts/executor.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What the motion of a substep is measured against: the mean displacement of the held vertices, m,
/// and the gift, m².
template <RealScalar Scalar>
struct PassiveFrame {
  Triple<Scalar> mean{Scalar(0), Scalar(0), Scalar(0)};
  Scalar gift = Scalar(0);
};

/// Returns the frame of `count` held vertices; `displacement(i)` is that of the i-th, `fall` g h²,
/// m.
template <RealScalar Scalar, class Displacement>
PassiveFrame<Scalar> passive_frame(std::size_t count, const Displacement& displacement,
                                   const Scalar& fall) {
  PassiveFrame<Scalar> frame;
  for (std::size_t i = 0; i < count; ++i) frame.mean = frame.mean + displacement(i);
  if (count > 0) frame.mean = frame.mean * (Scalar(1) / Scalar(static_cast<double>(count)));
  for (std::size_t i = 0; i < count; ++i) {
    const Scalar squared = squared_norm(displacement(i) - frame.mean);
    if (frame.gift < squared) frame.gift = squared;
  }
  frame.gift = frame.gift + Scalar(25) * fall * fall;
  return frame;
}

/// Σ m, Σ m u·d and Σ m |d|². Sums run over numbers or over packs of them.
template <class Number>
struct PassiveSums {
  Number mass, work, square;

  explicit PassiveSums(const Number& zero) : mass(zero), work(zero), square(zero) {}
  /// Adds a mass that moved by (ux, uy, uz) and is displaced by `d`, which has members x, y, z.
  template <class Point>
  void add(const Number& m, const Number& ux, const Number& uy, const Number& uz, const Point& d) {
    mass = mass + m;
    work = work + m * (ux * d.x + uy * d.y + uz * d.z);
    square = square + m * (d.x * d.x + d.y * d.y + d.z * d.z);
  }
};

/// Returns s from 0 to 1; 1 where nothing is displaced. `gift`: m².
template <RealScalar Scalar, class Number>
Scalar passive_share(const PassiveSums<Number>& sums, const Scalar& gift) {
  using std::sqrt;
  const Scalar work = total_of(sums.work), square = total_of(sums.square),
               allowed = total_of(sums.mass) * gift;
  if (!(allowed < Scalar(2) * work + square)) return Scalar(1);
  // 2 s work + s² square = allowed. The root of either sign of `work` has no difference in it.
  const Scalar root = sqrt(work * work + square * allowed);
  if (work < Scalar(0)) return (root - work) / square;
  return Scalar(0) < allowed ? allowed / (root + work) : Scalar(0);
}

/// Moves `points` by the corrections of `levels` as far as they add no kinetic energy but the gift
/// to the substep that began at `start`.
template <class Levels, RealScalar Scalar>
void correct_passively(const Levels& levels, int sweeps, const Scalar& slack,
                       const PassiveFrame<Scalar>& frame, Scalar* points, const Scalar* start,
                       typename Levels::Scratch& memory, const ExecutorRef& executor) {
  levels.correct(sweeps, slack, points, memory, executor);
  levels.add(levels.share(frame, points, start, memory), points, memory);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
