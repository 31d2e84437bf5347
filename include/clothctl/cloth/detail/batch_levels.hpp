#pragma once

// Coarse levels of any mesh, which carry a limit of stretch across the sheet. lane_levels.hpp says
// what the levels do. Here they are found on a mesh without structure.
//
// Level l keeps vertices that are at least 0.84 · 2^l mean edges apart along the surface (dart
// throwing): pinned vertices first, then corners of the boundary, the boundary, the rest. Its edges
// join each vertex to its nearest six; they are as long as the distance along the surface. A vertex
// of the finer level takes the displacement of its nearest vertices of this level, with weights
// that sum to one and, where the mesh is flat, reproduce its rest position among theirs:
//
//   minimise Σ W_p² d_p²  subject to  Σ W_p = 1,  Σ W_p (X_p - X_a) = 0      (d_p distance from a)

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/LU>

#include "clothctl/cloth/detail/edge_batches.hpp"
#include "clothctl/cloth/detail/level_input.hpp"
#include "clothctl/cloth/detail/passive_share.hpp"
#include "clothctl/cloth/detail/rigid_motion.hpp"
#include "clothctl/network/surface_distance.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// One coarse level: constants.
template <RealScalar Scalar>
struct BatchLevel {
  static constexpr std::size_t kParents = 4;
  /// The vertex of the sheet of each vertex of the level.
  std::vector<int> fine;
  /// For each vertex of the sheet, the nearest vertex of the level.
  std::vector<int> nearest;
  /// The points buffer as it is before a step: inverse masses are in it.
  VectorX<Scalar> initial;
  EdgeBatches<Scalar> edges;
  /// For each vertex of the next finer level, where its parents are in the buffer, and their
  /// weights.
  std::vector<std::array<int, kParents>> parents;
  std::vector<std::array<Scalar, kParents>> weights;
  /// For each tethered vertex, its distance from each vertex of the level, m; absent_length where
  /// it cannot be reached.
  std::vector<VectorX<Scalar>> tether;
};

/// The levels of a mesh.
template <RealScalar Scalar>
class BatchLevels {
 public:
  /// Memory of a step.
  struct Scratch {
    std::vector<VectorX<Scalar>> points;
    std::vector<EdgeBatchScratch<Scalar>> edges;
    bool anything_held = false;
    /// W D_1.
    VectorX<Scalar> displacement;
  };

  BatchLevels() = default;

  /// Makes levels until one has less than 600 vertices; none for less than 50. `parts`: those of
  /// the sheet. Allocates. Complexity: O(n log n) for a mesh whose vertices have few neighbours.
  explicit BatchLevels(const LevelInput& input, const MeshParts& parts = {});

  int count() const { return static_cast<int>(levels_.size()); }
  Scratch make_scratch() const;
  bool fits(const Scratch& scratch) const;

  /// Takes the held vertices of a step.
  void prepare(const std::vector<int>& held, Scratch& scratch) const;

  /// Computes the displacements of the vertices in `points`. `sweeps` a level; `slack`: part of its
  /// length by which an edge may stay too long.
  void correct(int sweeps, const Scalar& slack, const Scalar* points, Scratch& scratch,
               const ExecutorRef& executor = {}) const;
  /// Returns the share of the displacements that adds no kinetic energy but the gift to the
  /// substep that began at `start`.
  Scalar share(const PassiveFrame<Scalar>& frame, const Scalar* points, const Scalar* start,
               const Scratch& scratch) const;
  /// Moves the vertices in `points` by a share of the displacements.
  void add(const Scalar& share, Scalar* points, const Scratch& scratch) const;

 private:
  /// For each vertex of the sheet, the vertices of a level near it with their distances, nearest
  /// first.
  using NearVertices = std::vector<std::vector<std::pair<double, int>>>;
  using Parents = std::array<int, BatchLevel<Scalar>::kParents>;
  using Weights = std::array<Scalar, BatchLevel<Scalar>::kParents>;

  void add_level(const LevelInput& input, const MeshParts& parts, double radius,
                 SurfaceDistance<>& surface, std::vector<int>& finer,
                 std::vector<double>& finer_mass);
  /// Fills parents and weights of the finer level's vertices; returns the masses that these give.
  static std::vector<double> set_parents(const NearVertices& nearby, double radius,
                                         const Points<double>& rest, const std::vector<int>& finer,
                                         const std::vector<double>& finer_mass,
                                         BatchLevel<Scalar>& level);
  /// Joins each vertex to its nearest six.
  static void set_edges(const NearVertices& nearby, const MeshParts& parts,
                        BatchLevel<Scalar>& level);
  /// Adds the displacement `coarse` of level l to the next finer vertices of positive inverse mass.
  void interpolate(const Scalar* coarse, std::size_t l, Scalar* fine,
                   const ExecutorRef& executor) const;
  void remove_rigid_motion(const Scalar* points, Scratch& scratch) const;

  std::vector<BatchLevel<Scalar>> levels_;
  std::vector<int> tethered_;
  std::size_t vertex_count_ = 0;
};

/// Weights of parents (offsets from the vertex, 3×k) that sum to one and reproduce a vertex among
/// them: least Σ W² d². Directions in which the parents hardly spread are not reproduced. Where the
/// mesh is curved, a weight that would be negative is 0: extrapolated displacements keep garments
/// in motion for ever. A mesh counts as flat where vertex and parents deviate from a plane by at
/// most 10⁻⁴ of their distance (coordinates are rounded) and as curved from 10⁻³ on; between,
/// negative weights fade.
template <class = void>
VectorX<double> parent_weights(const Points<double>& offsets) {
  const Index k = offsets.cols();
  const double scale = offsets.colwise().norm().maxCoeff();
  VectorX<double> spread(k);
  for (Index p = 0; p < k; ++p) {
    const double d = offsets.col(p).norm() / scale;
    spread[p] = 1.0 / (d * d + 1e-6);
  }
  MatrixX<double> rows(4, k);
  rows.row(0).setOnes();
  rows.bottomRows(3) = offsets / scale;
  const MatrixX<double> weighted = spread.asDiagonal() * rows.transpose();
  DenseMatrix<double, 4, 4> normal = rows * weighted;
  const double least = 1e-6 * normal.trace();
  for (Index c = 1; c < 4; ++c) normal(c, c) += least;
  DenseMatrix<double, 4, 1> one = DenseMatrix<double, 4, 1>::Zero();
  one[0] = 1.0;
  VectorX<double> w = weighted * normal.inverse() * one;
  if (!(w.cwiseAbs().maxCoeff() < 2.0)) w = spread;
  const DenseMatrix<double, 3, 3> extent = rows.bottomRows(3) * rows.bottomRows(3).transpose();
  // The square of the deviation: the harmonic sum of the three variances, 0 on lines and planes.
  const double pairs = 0.5 * (extent.trace() * extent.trace() - extent.squaredNorm());
  const double squared = 0.0 < pairs ? (std::max)(0.0, extent.determinant() / pairs) : 0.0;
  const double kept = std::clamp((1e-3 - std::sqrt(squared)) / 9e-4, 0.0, 1.0);
  w = w.cwiseMax(kept * w);
  return w / w.sum();
}

template <RealScalar Scalar>
BatchLevels<Scalar>::BatchLevels(const LevelInput& input, const MeshParts& parts)
    : tethered_(input.tethered), vertex_count_(input.mass.size()) {
  SurfaceDistance surface(static_cast<int>(vertex_count_), input.edges, input.triangles);
  double mean = 0.0;
  for (const SurfaceEdge<>& edge : input.edges) mean += edge.length;
  mean /= static_cast<double>(std::max<std::size_t>(1, input.edges.size()));
  std::vector<int> finer(vertex_count_);
  for (std::size_t v = 0; v < vertex_count_; ++v) finer[v] = static_cast<int>(v);
  std::vector<double> mass = input.mass;
  for (int l = 1; l < 12 && finer.size() >= (l == 1 ? 50 : 600); ++l) {
    const std::size_t before = finer.size();
    add_level(input, parts, 0.84 * mean * static_cast<double>(1 << l), surface, finer, mass);
    if (finer.size() * 10 > before * 7) {  // nothing gained, as with many pieces
      levels_.pop_back();
      break;
    }
  }
}

template <RealScalar Scalar>
void BatchLevels<Scalar>::add_level(const LevelInput& input, const MeshParts& parts, double radius,
                                    SurfaceDistance<>& surface, std::vector<int>& finer,
                                    std::vector<double>& finer_mass) {
  const std::size_t n = vertex_count_;
  BatchLevel<Scalar>& level = levels_.emplace_back();
  std::vector<int> number(n, -1);
  std::vector<unsigned char> covered(n, 0);
  for (int v : input.order) {
    if (covered[static_cast<std::size_t>(v)] != 0) continue;
    number[static_cast<std::size_t>(v)] = static_cast<int>(level.fine.size());
    level.fine.push_back(v);
    surface.spread(v, radius, [&](int u, double) { covered[static_cast<std::size_t>(u)] = 1; });
  }
  const std::size_t count = level.fine.size();
  NearVertices nearby(n);
  for (std::size_t i = 0; i < count; ++i) {
    surface.spread(level.fine[i], 2.6 * radius, [&](int u, double distance) {
      nearby[static_cast<std::size_t>(u)].push_back({distance, static_cast<int>(i)});
    });
  }
  level.nearest.assign(n, 0);
  for (std::size_t v = 0; v < n; ++v) {
    std::sort(nearby[v].begin(), nearby[v].end());
    if (!nearby[v].empty()) level.nearest[v] = nearby[v].front().second;
  }
  const std::vector<double> mass =
      set_parents(nearby, radius, input.rest, finer, finer_mass, level);
  set_edges(nearby, parts.of_some(level.fine), level);
  level.initial.setZero(static_cast<Index>(4 * (count + 2)));
  for (std::size_t i = 0; i < count; ++i)
    level.initial[static_cast<Index>(4 * i) + 3] = Scalar(1.0 / (std::max)(mass[i], 1e-30));
  level.initial[static_cast<Index>(4 * count) + 4] = Scalar(1);
  for (int v : tethered_) {
    VectorX<Scalar>& lengths = level.tether.emplace_back();
    lengths.setConstant(static_cast<Index>(count), Scalar(1e15));
    surface.spread(v, 1e30, [&](int u, double distance) {
      const int i = number[static_cast<std::size_t>(u)];
      if (i >= 0) lengths[i] = Scalar(distance);
    });
  }
  finer = level.fine;
  finer_mass = mass;
}

template <RealScalar Scalar>
std::vector<double> BatchLevels<Scalar>::set_parents(const NearVertices& nearby, double radius,
                                                     const Points<double>& rest,
                                                     const std::vector<int>& finer,
                                                     const std::vector<double>& finer_mass,
                                                     BatchLevel<Scalar>& level) {
  std::vector<double> mass(level.fine.size(), 0.0);
  for (std::size_t i = 0; i < finer.size(); ++i) {
    const auto& around = nearby[static_cast<std::size_t>(finer[i])];
    const bool same = !around.empty() && around.front().first < 1e-9 * radius;
    const std::size_t k =
        same ? 1 : (std::min)(around.size(), std::size_t{BatchLevel<Scalar>::kParents});
    Parents parents{};
    Weights weights{};
    Points<double> offsets(3, static_cast<Index>(k));
    for (std::size_t p = 0; p < k; ++p) {
      parents[p] = 4 * around[p].second;
      offsets.col(static_cast<Index>(p)) =
          rest.col(level.fine[static_cast<std::size_t>(around[p].second)]) - rest.col(finer[i]);
    }
    VectorX<double> w = VectorX<double>::Ones(static_cast<Index>(k));
    if (k > 1) w = parent_weights(offsets);
    for (std::size_t p = 0; p < k; ++p) {
      const double share = w[static_cast<Index>(p)];
      weights[p] = Scalar(share);
      mass[static_cast<std::size_t>(around[p].second)] += (std::max)(0.0, share) * finer_mass[i];
    }
    level.parents.push_back(parents);
    level.weights.push_back(weights);
  }
  return mass;
}

template <RealScalar Scalar>
void BatchLevels<Scalar>::set_edges(const NearVertices& nearby, const MeshParts& parts,
                                    BatchLevel<Scalar>& level) {
  constexpr std::size_t kNeighbours = 6;
  const std::size_t count = level.fine.size();
  std::vector<std::pair<std::array<int, 2>, double>> pairs;
  for (std::size_t i = 0; i < count; ++i) {
    const int self = static_cast<int>(i);
    std::size_t taken = 0;
    for (const auto& [distance, other] : nearby[static_cast<std::size_t>(level.fine[i])]) {
      if (other == self) continue;
      pairs.push_back({{(std::min)(self, other), (std::max)(self, other)}, distance});
      if (++taken == kNeighbours) break;
    }
  }
  std::sort(pairs.begin(), pairs.end());
  std::vector<ListedEdge<Scalar>> edges;
  for (std::size_t e = 0; e < pairs.size(); ++e) {
    // Both ends may have found an edge: the shorter distance comes first.
    if (e > 0 && pairs[e].first == pairs[e - 1].first) continue;
    edges.push_back({pairs[e].first[0], pairs[e].first[1], Scalar(pairs[e].second), Scalar(1),
                     Scalar(0), Scalar(0)});
  }
  level.edges = pack_edges(edges, PackOrder{3, 256}, static_cast<int>(count), parts);
}

template <RealScalar Scalar>
auto BatchLevels<Scalar>::make_scratch() const -> Scratch {
  Scratch scratch;
  for (const BatchLevel<Scalar>& level : levels_) {
    scratch.points.push_back(level.initial);
    scratch.edges.emplace_back().resize(static_cast<Index>(level.edges.size()));
  }
  scratch.displacement.setZero(static_cast<Index>(4 * vertex_count_));
  return scratch;
}

template <RealScalar Scalar>
bool BatchLevels<Scalar>::fits(const Scratch& scratch) const {
  bool good = scratch.points.size() == levels_.size() &&
              scratch.displacement.size() == static_cast<Index>(4 * vertex_count_);
  for (std::size_t l = 0; good && l < levels_.size(); ++l)
    good = scratch.points[l].size() == levels_[l].initial.size();
  return good;
}

template <RealScalar Scalar>
void BatchLevels<Scalar>::prepare(const std::vector<int>& held, Scratch& scratch) const {
  scratch.anything_held = !held.empty();
  for (std::size_t l = 0; l < levels_.size(); ++l) {
    const BatchLevel<Scalar>& level = levels_[l];
    scratch.points[l] = level.initial;
    for (int v : held) {
      const int i = level.nearest[static_cast<std::size_t>(v)];
      scratch.points[l][4 * i + 3] = Scalar(0);
    }
    prepare_edges(level.edges, Scalar(1), true, scratch.points[l].data(), scratch.edges[l]);
  }
}

template <RealScalar Scalar>
void BatchLevels<Scalar>::interpolate(const Scalar* coarse, std::size_t l, Scalar* fine,
                                      const ExecutorRef& executor) const {
  using Vertex = Simd<Scalar, 4>;
  const BatchLevel<Scalar>& level = levels_[l];
  for_each_range(level.parents.size(), executor, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Scalar* x = fine + 4 * i;
      const Scalar w = x[3];
      if (!(Scalar(0) < w)) continue;
      const Parents& parents = level.parents[i];
      const Weights& weights = level.weights[i];
      Vertex sum = Vertex::load(x);
      for (std::size_t p = 0; p < parents.size(); ++p)
        sum = sum + Vertex::all(weights[p]) * Vertex::load(coarse + parents[p]);
      sum.store(x);
      x[3] = w;
    }
  });
}

template <RealScalar Scalar>
void BatchLevels<Scalar>::correct(int sweeps, const Scalar& slack, const Scalar* points,
                                  Scratch& scratch, const ExecutorRef& executor) const {
  using std::sqrt;
  if (levels_.empty()) return;
  for (std::size_t l = levels_.size(); l-- > 0;) {
    const BatchLevel<Scalar>& level = levels_[l];
    Scalar* y = scratch.points[l].data();
    const std::size_t count = level.fine.size();
    for (std::size_t i = 0; i < count; ++i) {
      const Scalar* x = points + 4 * static_cast<std::size_t>(level.fine[i]);
      for (std::size_t c = 0; c < 3; ++c) y[4 * i + c] = x[c];
    }
    if (l + 1 < levels_.size()) interpolate(scratch.points[l + 1].data(), l + 1, y, executor);
    for (std::size_t t = 0; t < tethered_.size(); ++t) {
      const Scalar* q = points + 4 * static_cast<std::size_t>(tethered_[t]);
      if (Scalar(0) < q[3]) continue;  // not held any more
      for (std::size_t i = 0; i < count; ++i) {
        Scalar* p = y + 4 * i;
        const Scalar dx = q[0] - p[0], dy = q[1] - p[1], dz = q[2] - p[2];
        const Scalar squared = dx * dx + dy * dy + dz * dz;
        const Scalar length = level.tether[t][static_cast<Index>(i)] * (Scalar(1) + slack);
        if (!(length * length < squared) || !(Scalar(0) < p[3])) continue;
        const Scalar s = Scalar(1) - length / sqrt(squared);
        p[0] = p[0] + s * dx;
        p[1] = p[1] + s * dy;
        p[2] = p[2] + s * dz;
      }
    }
    auto rule = TensionRule<Scalar, batch_lanes<Scalar>()>::over_relaxed(slack);
    for (int sweep = 0; sweep < sweeps; ++sweep)
      rule = sweep_edges(level.edges, scratch.edges[l], y, y, rule, executor);
    for (std::size_t i = 0; i < count; ++i) {
      const Scalar* x = points + 4 * static_cast<std::size_t>(level.fine[i]);
      for (std::size_t c = 0; c < 3; ++c) y[4 * i + c] = y[4 * i + c] - x[c];
    }
  }
  Scalar* moved = scratch.displacement.data();
  const std::size_t size = 4 * vertex_count_;
  for (std::size_t at = 0; at < size; at += 4) {
    for (std::size_t c = 0; c < 3; ++c) moved[at + c] = Scalar(0);
    moved[at + 3] = points[at + 3];
  }
  interpolate(scratch.points[0].data(), 0, moved, executor);
  if (!scratch.anything_held) remove_rigid_motion(points, scratch);
}

template <RealScalar Scalar>
void BatchLevels<Scalar>::remove_rigid_motion(const Scalar* points, Scratch& scratch) const {
  struct Point {
    Scalar x, y, z;
  };
  const auto read = [](const Scalar* from) { return Point{from[0], from[1], from[2]}; };
  Scalar* moved = scratch.displacement.data();
  const std::size_t size = 4 * vertex_count_;
  const auto rigid = closest_rigid_displacement<Scalar, Scalar>([&](auto&& visit) {
    for (std::size_t at = 0; at < size; at += 4)
      visit(Scalar(Scalar(1) / points[at + 3]), read(points + at), read(moved + at));
  });
  for (std::size_t at = 0; at < size; at += 4) {
    const Point d = rigid.removed_from(read(moved + at), read(points + at));
    moved[at] = d.x;
    moved[at + 1] = d.y;
    moved[at + 2] = d.z;
  }
}

template <RealScalar Scalar>
Scalar BatchLevels<Scalar>::share(const PassiveFrame<Scalar>& frame, const Scalar* points,
                                  const Scalar* start, const Scratch& scratch) const {
  const Scalar* moved = scratch.displacement.data();
  PassiveSums<Scalar> sums(Scalar(0));
  for (std::size_t at = 0; at < 4 * vertex_count_ && !levels_.empty(); at += 4) {
    const Scalar *x = points + at, *before = start + at, *d = moved + at;
    if (!(Scalar(0) < d[3])) continue;
    sums.add(Scalar(Scalar(1) / d[3]), Scalar(x[0] - before[0] - frame.mean.x),
             Scalar(x[1] - before[1] - frame.mean.y), Scalar(x[2] - before[2] - frame.mean.z),
             Triple<Scalar>{d[0], d[1], d[2]});
  }
  return passive_share(sums, frame.gift);
}

template <RealScalar Scalar>
void BatchLevels<Scalar>::add(const Scalar& share, Scalar* points, const Scratch& scratch) const {
  const Scalar* moved = scratch.displacement.data();
  for (std::size_t at = 0; at < 4 * vertex_count_ && !levels_.empty(); at += 4) {
    if (!(Scalar(0) < moved[at + 3])) continue;
    for (std::size_t c = 0; c < 3; ++c) points[at + c] = points[at + c] + share * moved[at + c];
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
