#pragma once

// Layers of sheets that stay apart: a pass over the step of any cloth model. Given the positions x
// before the step and y after it, it changes y, and the velocities with it, so that no edge passes
// an edge and no vertex a triangle:
//
// 1. Layers. Pairs that come closer than their thickness h get impulses with the masses of the
//    vertices, inelastic and with Coulomb friction (detail/pair_rows.hpp):
//    n·Σ w_i y_i >= min(h, d), where d is the distance at x.
// 2. Push. Pairs that start closer than h are moved to min(h, d + v dt), and crossings that are
//    there at x the way that shortens them (detail/contour_push.hpp). Positions only: a push adds
//    no velocity.
// 3. Impacts. Passages on the straight ways from x to y get impulses too, along the normal at the
//    impact. All impacts so far are swept together, until a search finds none.
// 4. Zones. What impulses do not keep apart moves rigidly (detail/impact_zones.hpp).
//
// After 3 or 4, a search over all pairs has found no passage. It can fail only where driven
// vertices are forced through a layer, and the report says so. Pairs that cross at x are left to
// pass. Reference: Bridson, Fedkiw, Anderson, Robust treatment of collisions, contact and friction
// for cloth animation, 2002; Harmon et al. 2008 (impacts as a growing set of constraints).

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/self_contacts.hpp"
#include "clothctl/contact/detail/contour_push.hpp"
#include "clothctl/contact/detail/impact_zones.hpp"
#include "clothctl/contact/detail/pair_rows.hpp"
#include "clothctl/contact/sheet_impacts_setup.hpp"
#include "clothctl/core/cloth_state.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Keeps layers of sheets apart. `create` and `reserve` allocate all memory, the pass never does.
template <RealScalar Scalar>
class SheetImpacts {
 public:
  /// Makes the pass for sheets with the shape at rest `x` (3×n, m), triangles, and threads (edges
  /// of no triangle). There is room for 40 pairs a vertex; `reserve` makes more. Allocates. Fails
  /// when: `SelfContactFinder::create` does, or a setting is wrong.
  static Result<SheetImpacts> create(const PointsView<Scalar>& x,
                                     const std::vector<std::array<int, 3>>& triangles,
                                     const SheetImpactSettings<Scalar>& settings = {},
                                     const std::vector<std::array<int, 2>>& threads = {}) {
    if (const std::string bad = settings.validate(); !bad.empty())
      return Error{"sheet impacts have " + bad};
    Result<SelfContactFinder<Scalar>> finder = SelfContactFinder<Scalar>::create(
        x, triangles, threads, {settings.thickness, settings.joined});
    if (!finder) return Error{finder.error()};
    return SheetImpacts(std::move(finder).value(), settings);
  }

  /// Makes room for `count` pairs. Allocates.
  void reserve(Index count) {
    finder_.reserve(count);
    rows_.reserve(static_cast<std::size_t>(count));
  }

  /// Changes positions and velocities of `state`, the result of a step of `dt` (s) from the
  /// positions `before` (3×n, m), so that no layer passes another. `inverse_mass` (n, 1/kg) is 0
  /// for vertices whose motion is prescribed. The same input gives the same bits.
  SheetImpactReport resolve(const PointsView<Scalar>& before,
                            const Eigen::Ref<const VectorX<Scalar>>& inverse_mass, Scalar dt,
                            ClothState<Scalar>& state);

  /// The same with points that obstacles hold up. Writes the impulses of these. Never allocates
  /// while there are not more of them than there is room for pairs.
  SheetImpactReport resolve(const PointsView<Scalar>& before,
                            const Eigen::Ref<const VectorX<Scalar>>& inverse_mass, Scalar dt,
                            ClothState<Scalar>& state, std::span<SheetSupport<Scalar>> supports) {
    supports_ = supports;
    const SheetImpactReport report = resolve(before, inverse_mass, dt, state);
    supports_ = {};
    return report;
  }

  /// Finds the pairs of layers for `push_apart`: those that are closer than their thickness and
  /// `reach` (m) at `x` (3×n, m). For the substeps of a position-based sheet: once a step with a
  /// reach of what the layers may approach, and then `push_apart` many times. Returns the number,
  /// -1 if an argument is wrong.
  int find_layers(const PointsView<Scalar>& x, const Scalar& reach,
                  const Eigen::Ref<const VectorX<Scalar>>& inverse_mass);
  /// Moves `y` (3×n, m) by one sweep over the pairs of `find_layers` so that layers keep their
  /// thickness, or the distance that they had if that was less. Friction acts against the way from
  /// the positions of `find_layers`.
  void push_apart(Points<Scalar>& y) {
    detail::sweep_rows<Scalar>(rows_, x_, settings_.friction, y);
  }

  /// The settings.
  const SheetImpactSettings<Scalar>& settings() const { return settings_; }
  /// The search for pairs, with the crossings of the last count.
  const SelfContactFinder<Scalar>& finder() const { return finder_; }

 private:
  using Row = detail::PairRow<Scalar>;

  SheetImpacts(SelfContactFinder<Scalar> finder, const SheetImpactSettings<Scalar>& settings)
      : settings_(settings), finder_(std::move(finder)) {
    const Index n = finder_.vertex_count();
    for (Points<Scalar>* points : {&x_, &y_, &found_, &pushes_, &wanted_, &clean_end_})
      *points = Points<Scalar>::Constant(3, n, Scalar(0));
    inverse_mass_ = VectorX<Scalar>::Constant(n, Scalar(0));
    tangled_.resize(static_cast<std::size_t>(n));
    ring_.resize(static_cast<std::size_t>(n));
    degree_.resize(static_cast<std::size_t>(n), 0);
    pierced_.resize(static_cast<std::size_t>(n), 0);
    for (const std::array<int, 2>& edge : finder_.edges()) {
      for (const int v : edge) ++degree_[static_cast<std::size_t>(v)];
    }
    zones_.resize(static_cast<std::size_t>(n));
    reserve(Index(40) * n);
  }

  static StepStatus check_input(const SelfContactFinder<Scalar>& finder,
                                const PointsView<Scalar>& before,
                                const Eigen::Ref<const VectorX<Scalar>>& inverse_mass,
                                const Scalar& dt, const ClothState<Scalar>& state);
  /// How much further than their thickness apart pairs are looked for, so that the list holds while
  /// impulses change the ways. A larger reach needs fewer searches, but finds more pairs.
  Scalar reach() const { return Scalar(0.5) * settings_.thickness; }
  /// Marks the vertices of edges and triangles that cross at x.
  int mark_tangles();
  bool is_tangled(const std::array<int, 4>& v) const {
    const auto marked = [this](int i) { return tangled_[static_cast<std::size_t>(i)]; };
    return marked(v[0]) && marked(v[1]) && marked(v[2]) && marked(v[3]);
  }
  /// Searches pairs again when a vertex has left the way for which they were found.
  void refresh_pairs(SheetImpactReport& report);
  void add_row(const SelfContact<Scalar>& pair, const Scalar& gap, const Scalar& pushed);
  void hold_layers(const Scalar& dt, SheetImpactReport& report);
  /// Adds the rows of the supports, which come first.
  void add_supports();
  void tell_supports(const Scalar& dt);
  void push(const Scalar& dt);
  /// Moves crossings by at most `way` in the direction that shortens them.
  void untangle(const Scalar& way);
  Row untangling_row(const EdgeCrossing& crossing) const;
  void sweep(int sweeps);
  /// Calls `visit` for all impacts of the ways from x to y. Returns their number.
  template <class Visit>
  int for_each_impact(const Visit& visit);
  bool stop_impacts(const Scalar& dt, SheetImpactReport& report);
  void make_zones(SheetImpactReport& report);

  SheetImpactSettings<Scalar> settings_;
  SelfContactFinder<Scalar> finder_;
  Points<Scalar> x_, y_;
  /// The ends of the ways for which pairs were found; what pushes moved; the ends that zones would
  /// have; the end of the last pass that left nothing crossed.
  Points<Scalar> found_, pushes_, wanted_, clean_end_;
  bool clean_ = false;
  VectorX<Scalar> inverse_mass_;
  std::vector<bool> tangled_, ring_;
  /// The edges at each vertex, and those of them that pierce a triangle at x.
  std::vector<int> degree_, pierced_;
  std::vector<Row> rows_;
  std::span<SheetSupport<Scalar>> supports_;
  detail::ImpactZones<Scalar> zones_;
};

template <RealScalar Scalar>
StepStatus SheetImpacts<Scalar>::check_input(const SelfContactFinder<Scalar>& finder,
                                             const PointsView<Scalar>& before,
                                             const Eigen::Ref<const VectorX<Scalar>>& inverse_mass,
                                             const Scalar& dt, const ClothState<Scalar>& state) {
  const Index n = finder.vertex_count();
  if (inverse_mass.size() != n || !is_finite(dt) || !(Scalar(0) < dt))
    return StepStatus::InvalidInput;
  for (Index i = 0; i < n; ++i) {
    if (!is_finite(Scalar(inverse_mass[i])) || inverse_mass[i] < Scalar(0))
      return StepStatus::InvalidInput;
  }
  if (before.cols() != n || state.positions.cols() != n || state.velocities.cols() != n ||
      !all_finite(before) || !all_finite(state.positions) || !all_finite(state.velocities))
    return StepStatus::InvalidState;
  return StepStatus::Converged;
}

template <RealScalar Scalar>
SheetImpactReport SheetImpacts<Scalar>::resolve(
    const PointsView<Scalar>& before, const Eigen::Ref<const VectorX<Scalar>>& inverse_mass,
    Scalar dt, ClothState<Scalar>& state) {
  SheetImpactReport report;
  report.status = check_input(finder_, before, inverse_mass, dt, state);
  if (report.status != StepStatus::Converged) return report;
  x_ = before;
  y_ = state.positions;
  inverse_mass_ = inverse_mass;
  rows_.clear();
  // What the last pass left is known.
  const bool known = clean_ && x_ == clean_end_;
  std::fill(tangled_.begin(), tangled_.end(), false);
  std::fill(pierced_.begin(), pierced_.end(), 0);
  if (!known) report.crossings_before = mark_tangles();
  found_ = y_;
  finder_.update(x_, y_);
  finder_.find(reach());
  report.complete = finder_.complete();
  add_supports();
  hold_layers(dt, report);
  push(dt);
  bool apart = stop_impacts(dt, report);
  if (!apart) make_zones(report);
  apart = report.crossings_left == 0 && report.complete;
  if (report.crossings_before > 0 || !apart) report.crossings_left = finder_.count_crossings(y_);
  clean_ = report.crossings_left == 0 && report.complete;
  clean_end_ = y_;
  if (!clean_) report.status = StepStatus::IterationLimit;
  state.velocities += (y_ - state.positions - pushes_) / dt;
  state.positions = y_;
  tell_supports(dt);
  return report;
}

template <RealScalar Scalar>
void SheetImpacts<Scalar>::add_supports() {
  std::size_t count = 0;
  for (const SheetSupport<Scalar>& support : supports_) {
    Row row;
    row.normal = support.normal;
    for (std::size_t k = 0; k < 3 && support.vertex[k] >= 0; ++k) {
      row.vertex[k] = support.vertex[k];
      row.weight[k] = support.weight[static_cast<Index>(k)];
    }
    const Scalar now = row.normal.dot(row.way(y_));
    row.gap = row.pushed = now < support.level ? now : support.level;
    // A point whose vertices are all held keeps its place in the list, and moves nothing.
    if (!detail::weigh<Scalar>(inverse_mass_, row)) {
      row.answer = {};
      row.mass = Scalar(0);
    }
    if (rows_.size() == rows_.capacity()) break;
    rows_.push_back(row);
    ++count;
  }
  supports_ = supports_.first(count);
}

template <RealScalar Scalar>
void SheetImpacts<Scalar>::tell_supports(const Scalar& dt) {
  for (std::size_t i = 0; i < supports_.size(); ++i)
    supports_[i].impulse = (rows_[i].impulse * rows_[i].normal + rows_[i].friction) / dt;
}

template <RealScalar Scalar>
int SheetImpacts<Scalar>::find_layers(const PointsView<Scalar>& x, const Scalar& reach,
                                      const Eigen::Ref<const VectorX<Scalar>>& inverse_mass) {
  if (inverse_mass.size() != finder_.vertex_count()) return -1;
  if (finder_.update(x) != QueryStatus::Answered) return -1;
  if (finder_.find(reach) != QueryStatus::Answered) return -1;
  x_ = x;
  inverse_mass_ = inverse_mass;
  clean_ = false;
  rows_.clear();
  for (const SelfContact<Scalar>& pair : finder_.contacts()) {
    const Scalar gap = (std::min)(pair.thickness, pair.distance);
    if (pair.facing) add_row(pair, gap, gap);
  }
  return static_cast<int>(rows_.size());
}

template <RealScalar Scalar>
int SheetImpacts<Scalar>::mark_tangles() {
  const int count = finder_.count_crossings(x_);
  int last = -1;
  for (const EdgeCrossing& crossing : finder_.crossings()) {
    for (const int v : finder_.edges()[static_cast<std::size_t>(crossing.edge)]) {
      tangled_[static_cast<std::size_t>(v)] = true;
      if (crossing.edge != last) ++pierced_[static_cast<std::size_t>(v)];
    }
    last = crossing.edge;
    for (const int v : finder_.triangles()[static_cast<std::size_t>(crossing.triangle)])
      tangled_[static_cast<std::size_t>(v)] = true;
  }
  // A tip may lie over the triangle beside the pierced one: the neighbours are free, too.
  if (count > 0) ring_ = tangled_;
  for (const std::array<int, 2>& edge : finder_.edges()) {
    if (count == 0) break;
    const std::size_t a = static_cast<std::size_t>(edge[0]), b = static_cast<std::size_t>(edge[1]);
    if (ring_[a] || ring_[b]) tangled_[a] = tangled_[b] = true;
  }
  return count;
}

template <RealScalar Scalar>
void SheetImpacts<Scalar>::refresh_pairs(SheetImpactReport& report) {
  // Two vertices that leave their ways by half of the reach each use it up.
  const Scalar limit = reach() * reach() / Scalar(4);
  for (Index v = 0; v < y_.cols(); ++v) {
    if (!(limit < Vector3<Scalar>(y_.col(v) - found_.col(v)).squaredNorm())) continue;
    found_ = y_;
    finder_.update(x_, y_);
    finder_.find(reach());
    report.complete = report.complete && finder_.complete();
    return;
  }
}

template <RealScalar Scalar>
void SheetImpacts<Scalar>::add_row(const SelfContact<Scalar>& pair, const Scalar& gap,
                                   const Scalar& pushed) {
  Row row;
  row.vertex = pair.vertex;
  row.weight = pair.weight;
  row.normal = pair.normal;
  row.gap = gap;
  row.pushed = pushed;
  if (rows_.size() < rows_.capacity() && detail::weigh<Scalar>(inverse_mass_, row))
    rows_.push_back(row);
}

template <RealScalar Scalar>
void SheetImpacts<Scalar>::sweep(int sweeps) {
  const Scalar tolerance = Scalar(1e-3) * settings_.thickness;
  // Friction needs normal impulses that are about right: they come first.
  const int first = sweeps / 4;
  for (int k = 0; k < sweeps; ++k) {
    const Scalar friction = k < first ? Scalar(0) : settings_.friction;
    if (!(tolerance < detail::sweep_rows<Scalar>(rows_, x_, friction, y_)) && k >= first) return;
  }
}

template <RealScalar Scalar>
void SheetImpacts<Scalar>::hold_layers(const Scalar& dt, SheetImpactReport& report) {
  const Scalar h = settings_.thickness;
  for (const SelfContact<Scalar>& pair : finder_.contacts()) {
    // Planes at far pairs say little about where they would touch: impacts take care of them.
    if (!pair.facing || Scalar(3) * h < pair.distance || is_tangled(pair.vertex)) continue;
    const Scalar gap = (std::min)(pair.thickness, pair.distance);
    const Scalar pushed = (std::min)(pair.thickness, pair.distance + dt * settings_.push_speed);
    Row row;
    row.vertex = pair.vertex;
    row.weight = pair.weight;
    if (pair.normal.dot(row.way(y_)) < gap + Scalar(0.25) * h) add_row(pair, gap, pushed);
  }
  report.contacts = static_cast<int>(rows_.size() - supports_.size());
  sweep(settings_.sweeps);
}

template <RealScalar Scalar>
detail::PairRow<Scalar> SheetImpacts<Scalar>::untangling_row(const EdgeCrossing& crossing) const {
  const std::array<int, 2>& edge = finder_.edges()[static_cast<std::size_t>(crossing.edge)];
  const std::array<int, 3>& triangle =
      finder_.triangles()[static_cast<std::size_t>(crossing.triangle)];
  // A vertex most of whose edges are pierced is a tip that goes back the way it came.
  for (std::size_t k = 0; k < 2; ++k) {
    const std::size_t v = static_cast<std::size_t>(edge[k]);
    if (2 * pierced_[v] > degree_[v])
      return detail::tip_row<Scalar>(x_, edge[k], edge[1 - k], triangle);
  }
  std::array<int, 2> opposite{-1, -1};
  for (std::size_t k = 0; k < 2; ++k) {
    const int t = finder_.triangles_of(crossing.edge)[k];
    if (t < 0) continue;
    for (const int v : finder_.triangles()[static_cast<std::size_t>(t)]) {
      if (v != edge[0] && v != edge[1]) opposite[k] = v;
    }
  }
  return detail::contour_row<Scalar>(x_, edge, triangle, opposite);
}

template <RealScalar Scalar>
void SheetImpacts<Scalar>::untangle(const Scalar& way) {
  using std::sqrt;
  for (const EdgeCrossing& crossing : finder_.crossings()) {
    Row row = untangling_row(crossing);
    if (detail::weigh<Scalar>(inverse_mass_, row))
      row.apply(Vector3<Scalar>(row.mass * way * row.normal), y_);
  }
  // Where many cross, what pulls at a vertex adds up.
  for (Index v = 0; v < y_.cols(); ++v) {
    const Vector3<Scalar> moved = y_.col(v) - pushes_.col(v);
    const Scalar length = sqrt(moved.squaredNorm());
    if (way < length) y_.col(v) = pushes_.col(v) + (way / length) * moved;
  }
}

template <RealScalar Scalar>
void SheetImpacts<Scalar>::push(const Scalar& dt) {
  constexpr int kSweeps = 4;
  pushes_ = y_;
  if (std::find(tangled_.begin(), tangled_.end(), true) != tangled_.end())
    untangle(dt * settings_.untangle_speed);
  for (int k = 0; k < kSweeps; ++k) detail::push_rows<Scalar>(rows_, y_);
  pushes_ = y_ - pushes_;
}

template <RealScalar Scalar>
template <class Visit>
int SheetImpacts<Scalar>::for_each_impact(const Visit& visit) {
  int count = 0;
  for (const SelfContact<Scalar>& pair : finder_.contacts()) {
    if (zones_.rigid(pair.vertex) || is_tangled(pair.vertex)) continue;
    const SelfImpact<Scalar> hit = finder_.impact(pair, y_);
    if (!(hit.time <= Scalar(1))) continue;
    ++count;
    visit(hit.pair);
  }
  return count;
}

template <RealScalar Scalar>
bool SheetImpacts<Scalar>::stop_impacts(const Scalar& dt, SheetImpactReport& report) {
  zones_.clear();
  for (int round = 0; round < settings_.rounds; ++round) {
    refresh_pairs(report);
    const int hits = for_each_impact([this, &dt](const SelfContact<Scalar>& pair) {
      // What is nearly closed is opened a little, or the sweeps' error would close it again.
      const Scalar opened = pair.distance + dt * settings_.push_speed;
      const Scalar gap = Scalar(Scalar(0.5) * (std::min)(pair.thickness, opened));
      add_row(pair, gap, gap);
    });
    ++report.rounds;
    report.impacts += hits;
    if (hits == 0) return true;
    sweep(settings_.sweeps);
  }
  return false;
}

template <RealScalar Scalar>
void SheetImpacts<Scalar>::make_zones(SheetImpactReport& report) {
  for (Index v = 0; v < inverse_mass_.size(); ++v) {
    if (!(Scalar(0) < inverse_mass_[v])) zones_.hold(static_cast<int>(v));
  }
  wanted_ = y_;
  // Each round unites two zones at least, or is the last.
  for (bool changed = true; changed;) {
    refresh_pairs(report);
    changed = false;
    const int hits = for_each_impact([this, &changed](const SelfContact<Scalar>& pair) {
      changed = zones_.merge(pair.vertex) || changed;
    });
    ++report.rounds;
    report.impacts += hits;
    if (changed) zones_.move(x_, wanted_, inverse_mass_, y_);
    // Only driven vertices can be left.
    if (hits > 0 && !changed) report.crossings_left = 1;
  }
  report.zones = zones_.count();
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class SheetImpacts<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
