#pragma once

// One-sided conditions on pairs of sheet features, and Gauss-Seidel sweeps over them. A pair with
// the weights w_i and the direction n from side B to side A keeps apart at the end y of a step when
//
//   c = n·Σ w_i y_i - g >= 0
//
// An impulse λ >= 0 (kg m: the time of a step is taken as 1) moves the vertices by
//
//   Δy_i = w_i λ n/m_i,     λ <- max(0, λ - k c),     k = 1/Σ (w_i²/m_i)
//
// Since Σ w_i = 0, momentum is kept to rounding. Friction acts against the relative way of the
// sides along the plane, r = (1 - n nᵀ) Σ w_i (y_i - x_i), with an impulse τ in the disc |τ| <= μ λ
// (or the disc of its own size, where λ has become smaller: what friction has taken it does not
// give back). A step to the closest point of a convex set that holds τ has Δτ·r <= 0, so it never
// raises the kinetic energy.

#include <array>
#include <cmath>
#include <cstddef>
#include <span>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A condition on a pair, and its impulses so far.
template <RealScalar Scalar>
struct PairRow {
  std::array<int, 4> vertex{};
  std::array<Scalar, 4> weight{};
  /// w_i/m_i.
  std::array<Scalar, 4> answer{};
  Vector3<Scalar> normal;
  /// The least distance g along the normal, and that to which the pair is pushed, m.
  Scalar gap, pushed;
  /// k, kg.
  Scalar mass;
  /// λ and τ, kg m.
  Scalar impulse = Scalar(0);
  Vector3<Scalar> friction = Vector3<Scalar>::Constant(Scalar(0));

  /// Returns Σ w_i x_i.
  Vector3<Scalar> way(const Points<Scalar>& x) const {
    return weight[0] * x.col(vertex[0]) + weight[1] * x.col(vertex[1]) +
           weight[2] * x.col(vertex[2]) + weight[3] * x.col(vertex[3]);
  }
  /// Moves the vertices by the impulse p.
  void apply(const Vector3<Scalar>& p, Points<Scalar>& y) const {
    for (std::size_t i = 0; i < 4; ++i) {
      if (answer[i] < Scalar(0) || Scalar(0) < answer[i]) y.col(vertex[i]) += answer[i] * p;
    }
  }
};

/// Fills answers and mass of a row from inverse masses (1/kg). Returns false when no vertex with a
/// weight can move, or, beside held vertices, only one that would move more than four times as far
/// as the pair.
template <RealScalar Scalar>
bool weigh(const VectorX<Scalar>& inverse_mass, PairRow<Scalar>& row) {
  using std::abs;
  Scalar sum(0);
  bool held = false;
  for (std::size_t i = 0; i < 4; ++i) {
    const Scalar& w = row.weight[i];
    row.answer[i] = w * inverse_mass[row.vertex[i]];
    sum += w * row.answer[i];
    held = held || (Scalar(0) < abs(w) && !(Scalar(0) < inverse_mass[row.vertex[i]]));
  }
  if (!(Scalar(0) < sum)) return false;
  row.mass = Scalar(1) / sum;
  for (const Scalar& answer : row.answer) {
    if (held && Scalar(4) < abs(answer) * row.mass) return false;
  }
  return true;
}

/// Takes each row once, with friction against the way from `x`. Returns the largest change of a
/// distance, m.
template <RealScalar Scalar>
Scalar sweep_rows(std::span<PairRow<Scalar>> rows, const Points<Scalar>& x, const Scalar& friction,
                  Points<Scalar>& y) {
  using std::abs;
  using std::sqrt;
  Scalar most(0);
  for (PairRow<Scalar>& row : rows) {
    const Vector3<Scalar> end = row.way(y);
    Scalar change = row.mass * (row.gap - row.normal.dot(end));
    if (change < -row.impulse) change = -row.impulse;
    if (!(Scalar(0) < row.impulse) && !(Scalar(0) < change)) continue;
    row.impulse += change;
    Vector3<Scalar> total = change * row.normal;
    const Scalar moved = abs(change) / row.mass;
    if (most < moved) most = moved;
    const Vector3<Scalar> slip = end - row.way(x);
    const Vector3<Scalar> r = slip - row.normal.dot(slip) * row.normal;
    Vector3<Scalar> wanted = row.friction - row.mass * r;
    const Scalar square = wanted.squaredNorm(), bound = friction * row.impulse;
    Scalar limit = row.friction.squaredNorm();
    if (limit < bound * bound) limit = bound * bound;
    if (limit < square) wanted *= sqrt(limit / square);
    total += wanted - row.friction;
    row.friction = wanted;
    row.apply(total, y);
  }
  return most;
}

/// Moves the pairs that are closer than `pushed` to that distance, each row once.
template <RealScalar Scalar>
void push_rows(std::span<const PairRow<Scalar>> rows, Points<Scalar>& y) {
  for (const PairRow<Scalar>& row : rows) {
    const Scalar missing = row.pushed - row.normal.dot(row.way(y));
    if (Scalar(0) < missing) row.apply(Vector3<Scalar>(row.mass * missing * row.normal), y);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
