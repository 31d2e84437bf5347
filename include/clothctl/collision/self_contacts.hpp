#pragma once

// Where sheets come near themselves and each other: all sheets are one vertex array with its
// triangles and threads (edges of no triangle). Two kinds of pairs matter, since of two surfaces
// that meet, one touches with a vertex and the other with a triangle, or both with an edge:
//
//   vertex x_0, triangle x_1 x_2 x_3        Σ w_i x_i = d n,   |n| = 1,
//   edge x_0 x_1, edge x_2 x_3              n from side B to side A
//
// with weights w of sum one on side A and minus one on side B (detail/pair_distance.hpp).
//
// 1. Broad phase: features whose boxes overlap, each pair once (detail/self_tree.hpp). While the
//    sheet is slow, a list of what is near serves for many searches (detail/near_pairs.hpp).
// 2. The distance at x, less what the sides can approach each other during the motion.
// 3. Impacts during a straight motion (detail/pair_advancement.hpp), and edges that pierce
//    triangles (detail/edge_piercing.hpp).
//
// Neighbours on a fine mesh are closer than the thickness of the sheet. Each pair has therefore a
// thickness of its own, which is at most 0.9 of its distance at rest.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/detail/edge_piercing.hpp"
#include "clothctl/collision/detail/near_pairs.hpp"
#include "clothctl/collision/detail/pair_advancement.hpp"
#include "clothctl/collision/detail/self_tree.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Two features of sheets that are near each other.
template <RealScalar Scalar>
struct SelfContact {
  /// The vertices. Of a vertex and a triangle: the vertex, then the corners. Of two edges: the ends
  /// of the first, then of the second.
  std::array<int, 4> vertex{-1, -1, -1, -1};
  /// The weights of the vertices: Σ w_i x_i is the way from the closest point of side B (the
  /// triangle, the second edge) to that of side A, m.
  std::array<Scalar, 4> weight{Scalar(0), Scalar(0), Scalar(0), Scalar(0)};
  /// Unit vector from side B to side A; zero where they touch.
  Vector3<Scalar> normal = Vector3<Scalar>::Constant(Scalar(0));
  /// The distance, m.
  Scalar distance = Scalar(0);
  /// The distance that the pair may not go below at rest: the thickness of the sheet, or less for
  /// neighbours, m.
  Scalar thickness = Scalar(0);
  /// The vertex and the triangle, or the two edges.
  std::array<int, 2> feature{-1, -1};
  /// True for two edges.
  bool edges = false;
  /// True when the distance of the two sheets, not only that of these two features, has a minimum
  /// here: the closest points are inside of the triangle, or of both edges and no triangle at the
  /// edges comes closer. Only such pairs should push: others would hold sheets back that slide.
  bool facing = false;
};

/// An impact of two features of sheets during a motion.
template <RealScalar Scalar>
struct SelfImpact {
  /// The pair. Weights and normal are those at the impact, the distance is that at the start.
  SelfContact<Scalar> pair;
  /// The time, from 0 to 1 of the motion.
  Scalar time = Scalar(0);
};

/// An edge that pierces a triangle.
struct EdgeCrossing {
  /// Index of the edge in `SelfContactFinder::edges`.
  int edge = -1;
  /// Index of the triangle.
  int triangle = -1;
};

/// How sheets meet themselves.
template <RealScalar Scalar>
struct SelfContactSettings {
  /// The distance of the middles of two layers that rest on each other, m.
  Scalar thickness = Scalar(1e-3);
  /// Pairs of vertices that count as one where features are tested for a common vertex: seams,
  /// layers that are stitched together.
  std::vector<std::array<int, 2>> joined = {};

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    if (!is_finite(thickness) || !(Scalar(0) < thickness))
      return "the thickness " + number_text(thickness) + " m, must be finite and positive";
    return {};
  }
};

namespace detail {

/// Returns "" or why a list of pairs of vertices is wrong. Allocates.
inline std::string validate_pairs(const std::string& name,
                                  const std::vector<std::array<int, 2>>& pairs, Index vertices) {
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const std::string item = name + " " + std::to_string(i) + " holds vertex ";
    for (const int v : pairs[i]) {
      if (v < 0 || v >= vertices)
        return item + std::to_string(v) + " off the sheet of " + std::to_string(vertices) +
               " vertices";
    }
    if (pairs[i][0] == pairs[i][1]) return item + std::to_string(pairs[i][0]) + " twice";
  }
  return {};
}

}  // namespace detail

/// Finds contacts, impacts and crossings of sheets with themselves. `create` and `reserve` allocate
/// all memory; `update`, `find`, `find_impacts` and `count_crossings` never do.
template <RealScalar Scalar>
class SelfContactFinder {
 public:
  /// Makes a finder for sheets with the shape at rest `x` (3×n, m), triangles, and threads (edges
  /// of no triangle). There is room for 12 contacts a vertex; `reserve` makes more. Allocates.
  /// Complexity: O(n log n). Fails when: a coordinate is not finite, `make_topology` refuses the
  /// triangles, a thread or a joined pair has a vertex off the sheet or twice, or a setting is
  /// wrong.
  static Result<SelfContactFinder> create(const PointsView<Scalar>& x,
                                          const std::vector<std::array<int, 3>>& triangles,
                                          const std::vector<std::array<int, 2>>& threads = {},
                                          const SelfContactSettings<Scalar>& settings = {});

  /// Makes room for `count` contacts, impacts and crossings each. Allocates.
  void reserve(Index count) {
    contacts_.reserve(static_cast<std::size_t>(count));
    near_.reserve(static_cast<std::size_t>(count));
    impacts_.reserve(static_cast<std::size_t>(count));
    crossings_.reserve(static_cast<std::size_t>(count));
  }
  /// The edges, ascending, each with its smaller vertex first.
  const std::vector<std::array<int, 2>>& edges() const { return edges_; }
  /// The triangles.
  const std::vector<std::array<int, 3>>& triangles() const { return triangles_; }
  /// The triangles of an edge; -1 for none. Two at most.
  const std::array<int, 2>& triangles_of(int edge) const {
    return edge_triangle_[static_cast<std::size_t>(edge)];
  }
  /// Returns the number of vertices.
  Index vertex_count() const { return x_.cols(); }
  /// The thickness, m.
  Scalar thickness() const { return settings_.thickness; }

  /// Takes the positions (3×n, m) of the sheets. InvalidArgument: wrong number of vertices.
  /// InvalidPoint: a coordinate is not finite. In both cases nothing changes.
  QueryStatus update(const PointsView<Scalar>& x) { return update(x, x); }
  /// Takes positions `x` and the positions `y` at the end of a straight motion (3×n, m). Fails as
  /// above.
  QueryStatus update(const PointsView<Scalar>& x, const PointsView<Scalar>& y) {
    if (x.cols() != x_.cols() || y.cols() != x_.cols()) return QueryStatus::InvalidArgument;
    if (!all_finite(x) || !all_finite(y)) return QueryStatus::InvalidPoint;
    x_ = x;
    way_ = y - x;
    y_ = y;
    return QueryStatus::Answered;
  }

  /// Finds the pairs that are, or come during the motion, closer than their thickness and `reach`
  /// (m) together; without a motion, exactly the pairs that are closer. Pairs whose sides move
  /// fast against each other may be among them though they do not come close. InvalidArgument:
  /// `reach` is negative or not finite; there are no contacts then.
  QueryStatus find(const Scalar& reach);
  /// The pairs of the last `find`, as they are at the start of the motion. The same sheets and
  /// positions give the same order.
  const std::vector<SelfContact<Scalar>>& contacts() const { return contacts_; }

  /// Finds the impacts of all pairs during the motion, after `find` among its pairs.
  /// InvalidArgument: `find` of these positions found too many. A pair has an impact when its
  /// distance falls below 0.2 of what it is at the start, or of its thickness if that is less:
  /// every passage is found, before it happens.
  QueryStatus find_impacts();
  /// The impacts of the last `find_impacts`.
  const std::vector<SelfImpact<Scalar>>& impacts() const { return impacts_; }
  /// Returns the first impact of a pair of the last `find` if its vertices move from the positions
  /// of the last update to the columns of `y` (3×n, m); a time of more than 1 if there is none.
  SelfImpact<Scalar> impact(const SelfContact<Scalar>& pair, const PointsView<Scalar>& y) const;

  /// Returns the number of edges that pierce a triangle at `x` (3×n, m) with which they have no
  /// vertex in common, -1 if the number of vertices is wrong or a coordinate is not finite. The
  /// boxes of the last update are lost: update before the next `find`.
  int count_crossings(const PointsView<Scalar>& x);
  /// The edges and triangles of the last count, as many as there is room for, ascending.
  const std::vector<EdgeCrossing>& crossings() const { return crossings_; }

  /// Number of searches that a list of near pairs has served, without the tree.
  long listed_searches() const { return near_.served(); }
  /// False when the last search found more than there was room for: `reserve` more.
  bool complete() const { return complete_; }

 private:
  using Pair = SelfContact<Scalar>;
  using Corners = detail::PairPoints<Scalar>;

  SelfContactFinder(const PointsView<Scalar>& x, const std::vector<std::array<int, 3>>& triangles,
                    std::vector<std::array<int, 2>> edges, std::vector<int> alias,
                    const SelfContactSettings<Scalar>& settings);

  /// The smallest vertex among those that count as one with each vertex. Allocates.
  static std::vector<int> aliases(Index vertices, const std::vector<std::array<int, 2>>& joined);

  Corners corners(const Points<Scalar>& x, const std::array<int, 4>& vertex) const {
    return {x.col(vertex[0]), x.col(vertex[1]), x.col(vertex[2]), x.col(vertex[3])};
  }
  std::array<int, 4> vertices_of(bool edges, int a, int b) const {
    const std::size_t i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
    if (edges) return {edges_[i][0], edges_[i][1], edges_[j][0], edges_[j][1]};
    return {a, triangles_[j][0], triangles_[j][1], triangles_[j][2]};
  }
  /// Returns A of the list of near pairs, so that few features of a flat sheet are near.
  static Scalar near_way(const Points<Scalar>& rest, const std::vector<std::array<int, 2>>& edges);
  /// Whether there is a list of what is near for a search with this limit; makes one if need be.
  bool has_near(const Scalar& limit);
  /// Whether the boxes of the motions of two features, grown by `grow`, overlap.
  bool boxes_meet(bool edges, const Corners& x, const Corners& y, const Scalar& grow) const;
  void consider(bool edges, int a, int b, const Scalar& reach);
  Scalar pair_thickness(bool edges, const std::array<int, 4>& vertex) const;
  bool is_facing(const Pair& pair, bool inside, const Corners& x) const;
  bool opens(int edge, const Vector3<Scalar>& p, const Vector3<Scalar>& n) const;

  SelfContactSettings<Scalar> settings_;
  std::vector<std::array<int, 3>> triangles_;
  std::vector<std::array<int, 2>> edges_;
  /// The triangles of each edge, and the vertices opposite of it.
  std::vector<std::array<int, 2>> edge_triangle_, edge_opposite_;
  detail::SelfTree<Scalar> tree_;
  Points<Scalar> rest_, x_, y_, way_;
  detail::NearPairs<Scalar> near_;
  std::vector<Pair> contacts_;
  std::vector<SelfImpact<Scalar>> impacts_;
  std::vector<EdgeCrossing> crossings_;
  bool complete_ = true;
};

template <RealScalar Scalar>
std::vector<int> SelfContactFinder<Scalar>::aliases(Index vertices,
                                                    const std::vector<std::array<int, 2>>& joined) {
  std::vector<int> alias(static_cast<std::size_t>(vertices));
  for (std::size_t v = 0; v < alias.size(); ++v) alias[v] = static_cast<int>(v);
  const auto root = [&alias](int v) {
    while (alias[static_cast<std::size_t>(v)] != v) v = alias[static_cast<std::size_t>(v)];
    return v;
  };
  for (const auto& [a, b] : joined) {
    const int p = root(a), q = root(b);
    alias[static_cast<std::size_t>((std::max)(p, q))] = (std::min)(p, q);
  }
  for (std::size_t v = 0; v < alias.size(); ++v) alias[v] = root(static_cast<int>(v));
  return alias;
}

template <RealScalar Scalar>
Result<SelfContactFinder<Scalar>> SelfContactFinder<Scalar>::create(
    const PointsView<Scalar>& x, const std::vector<std::array<int, 3>>& triangles,
    const std::vector<std::array<int, 2>>& threads, const SelfContactSettings<Scalar>& settings) {
  if (const std::string bad = settings.validate(); !bad.empty())
    return Error{"self-contact has " + bad};
  for (Index v = 0; v < x.cols(); ++v) {
    if (!all_finite(x.col(v)))
      return Error{"vertex " + std::to_string(v) + " of the sheet is not finite"};
  }
  if (const Result<Topology> topology = make_topology(x.cols(), triangles); !topology)
    return Error{topology.error()};
  std::string bad = detail::validate_pairs("thread", threads, x.cols());
  if (bad.empty()) bad = detail::validate_pairs("joined pair", settings.joined, x.cols());
  if (!bad.empty()) return Error{std::move(bad)};
  return SelfContactFinder(x, triangles, detail::sheet_edges(triangles, threads),
                           aliases(x.cols(), settings.joined), settings);
}

template <RealScalar Scalar>
SelfContactFinder<Scalar>::SelfContactFinder(const PointsView<Scalar>& x,
                                             const std::vector<std::array<int, 3>>& triangles,
                                             std::vector<std::array<int, 2>> edges,
                                             std::vector<int> alias,
                                             const SelfContactSettings<Scalar>& settings)
    : settings_(settings),
      triangles_(triangles),
      edges_(std::move(edges)),
      edge_triangle_(edges_.size(), {-1, -1}),
      edge_opposite_(edges_.size(), {-1, -1}),
      tree_(x, detail::sheet_parts(static_cast<int>(x.cols()), triangles, edges_), edges_,
            std::move(alias)),
      rest_(x),
      x_(x),
      y_(x),
      way_(Points<Scalar>::Constant(3, x.cols(), Scalar(0))),
      near_(x.cols(), near_way(rest_, edges_), settings.thickness) {
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    for (std::size_t i = 0; i < 3; ++i) {
      std::array<int, 2> key{triangles_[t][i], triangles_[t][(i + 1) % 3]};
      if (key[1] < key[0]) std::swap(key[0], key[1]);
      const auto at = std::lower_bound(edges_.begin(), edges_.end(), key);
      const std::size_t e = static_cast<std::size_t>(at - edges_.begin());
      const std::size_t side = edge_triangle_[e][0] < 0 ? 0 : 1;
      edge_triangle_[e][side] = static_cast<int>(t);
      edge_opposite_[e][side] = triangles_[t][(i + 2) % 3];
    }
  }
  reserve(Index(12) * x.cols());
}

template <RealScalar Scalar>
QueryStatus SelfContactFinder<Scalar>::find(const Scalar& reach) {
  contacts_.clear();
  complete_ = true;
  if (!is_finite(reach) || reach < Scalar(0)) return QueryStatus::InvalidArgument;
  const Scalar limit = settings_.thickness + reach, grow = limit / Scalar(2);
  if (has_near(limit)) {
    for (const auto& [a, b, edges] : near_.pairs()) {
      const std::array<int, 4> vertex = vertices_of(edges, a, b);
      if (boxes_meet(edges, corners(x_, vertex), corners(y_, vertex), grow))
        consider(edges, a, b, reach);
    }
    return QueryStatus::Answered;
  }
  tree_.fit(x_, y_, grow);
  tree_.for_each_pair([&](bool edges, int a, int b) { consider(edges, a, b, reach); });
  return QueryStatus::Answered;
}

template <RealScalar Scalar>
Scalar SelfContactFinder<Scalar>::near_way(const Points<Scalar>& rest,
                                           const std::vector<std::array<int, 2>>& edges) {
  using std::sqrt;
  if (edges.empty()) return Scalar(0);
  Scalar sum(0);
  for (const std::array<int, 2>& e : edges)
    sum += sqrt(Vector3<Scalar>(rest.col(e[0]) - rest.col(e[1])).squaredNorm());
  return Scalar(0.1) * sum / Scalar(static_cast<double>(edges.size()));
}

template <RealScalar Scalar>
bool SelfContactFinder<Scalar>::has_near(const Scalar& limit) {
  if (near_.covers(x_, y_, limit)) return true;
  if (!near_.begin(x_, y_, limit)) return false;
  tree_.fit(near_.low(), near_.high(), near_.grow());
  tree_.for_each_pair([&](bool edges, int a, int b) {
    const std::array<int, 4> vertex = vertices_of(edges, a, b);
    const Corners x = corners(x_, vertex);
    const Scalar most = near_.reach(vertex);
    if (detail::stay_apart<Scalar>(edges, x, x, most)) return;
    if (detail::pair_offset<Scalar>(edges, x).square < most * most) near_.add({a, b, edges});
  });
  return near_.filled();
}

template <RealScalar Scalar>
bool SelfContactFinder<Scalar>::boxes_meet(bool edges, const Corners& x, const Corners& y,
                                           const Scalar& grow) const {
  const auto box_of = [&](std::size_t first, std::size_t end) {
    BoundingBox<Scalar> box{x[first].cwiseMin(y[first]), x[first].cwiseMax(y[first])};
    for (std::size_t i = first + 1; i < end; ++i) {
      box.lower = box.lower.cwiseMin(x[i]).cwiseMin(y[i]);
      box.upper = box.upper.cwiseMax(x[i]).cwiseMax(y[i]);
    }
    return box.grown(grow);
  };
  const std::size_t of_a = edges ? 2 : 1;
  return detail::boxes_overlap(box_of(0, of_a), box_of(of_a, 4));
}

template <RealScalar Scalar>
void SelfContactFinder<Scalar>::consider(bool edges, int a, int b, const Scalar& reach) {
  using std::sqrt;
  const std::array<int, 4> vertex = vertices_of(edges, a, b);
  const Corners x = corners(x_, vertex), y = corners(y_, vertex);
  if (detail::stay_apart<Scalar>(edges, x, y, settings_.thickness + reach)) return;
  const Scalar approach = detail::approach_bound<Scalar>(edges, corners(way_, vertex));
  const Scalar most = settings_.thickness + reach + approach, limit = most * most;
  const detail::PairOffset<Scalar> o =
      edges ? detail::edge_edge<Scalar>(x, limit) : detail::vertex_triangle<Scalar>(x, limit);
  if (!(o.square < limit)) return;
  Pair pair;
  pair.distance = sqrt(o.square);
  pair.thickness = pair_thickness(edges, vertex);
  if (!(pair.distance - approach < pair.thickness + reach)) return;
  if (contacts_.size() == contacts_.capacity()) {
    complete_ = false;
    return;
  }
  pair.vertex = vertex;
  pair.weight = o.weight;
  if (Scalar(0) < pair.distance) pair.normal = o.offset / pair.distance;
  pair.feature = {a, b};
  pair.edges = edges;
  pair.facing = is_facing(pair, o.inside, x);
  contacts_.push_back(pair);
}

template <RealScalar Scalar>
Scalar SelfContactFinder<Scalar>::pair_thickness(bool edges,
                                                 const std::array<int, 4>& vertex) const {
  using std::sqrt;
  const Scalar room = settings_.thickness / Scalar(0.9), limit = room * room;
  const Corners x = corners(rest_, vertex);
  if (detail::stay_apart<Scalar>(edges, x, x, room)) return settings_.thickness;
  const detail::PairOffset<Scalar> o =
      edges ? detail::edge_edge<Scalar>(x, limit) : detail::vertex_triangle<Scalar>(x, limit);
  return o.square < limit ? Scalar(Scalar(0.9) * sqrt(o.square)) : settings_.thickness;
}

/// Returns true when no triangle at an edge goes on from its point p in the direction n.
template <RealScalar Scalar>
bool SelfContactFinder<Scalar>::opens(int edge, const Vector3<Scalar>& p,
                                      const Vector3<Scalar>& n) const {
  using std::sqrt;
  // In flat sheets the triangles go on at right angles to n: they count as not closer.
  const Scalar slack = Scalar(0.1);
  for (const int o : edge_opposite_[static_cast<std::size_t>(edge)]) {
    if (o < 0) continue;
    const Vector3<Scalar> way = x_.col(o) - p;
    if (slack * sqrt(way.squaredNorm()) < n.dot(way)) return false;
  }
  return true;
}

template <RealScalar Scalar>
bool SelfContactFinder<Scalar>::is_facing(const Pair& pair, bool inside, const Corners& x) const {
  if (!pair.edges) return inside;
  const auto thread = [this](int e) { return edge_triangle_[static_cast<std::size_t>(e)][0] < 0; };
  if (!inside && !thread(pair.feature[0]) && !thread(pair.feature[1])) return false;
  const Vector3<Scalar> p = pair.weight[0] * x[0] + pair.weight[1] * x[1];
  const Vector3<Scalar> q = -(pair.weight[2] * x[2] + pair.weight[3] * x[3]);
  return opens(pair.feature[0], p, Vector3<Scalar>(-pair.normal)) &&
         opens(pair.feature[1], q, pair.normal);
}

template <RealScalar Scalar>
SelfImpact<Scalar> SelfContactFinder<Scalar>::impact(const SelfContact<Scalar>& pair,
                                                     const PointsView<Scalar>& y) const {
  using std::sqrt;
  const std::array<int, 4>& v = pair.vertex;
  const Scalar gap = Scalar(Scalar(0.1) * (std::min)(pair.distance, pair.thickness));
  const Corners end{y.col(v[0]), y.col(v[1]), y.col(v[2]), y.col(v[3])};
  // The plane across the normal keeps most pairs apart, unless rounding has turned it.
  if (Scalar(2) * gap < detail::room_along<Scalar>(pair.edges, end, pair.normal) &&
      Scalar(0) < detail::room_along<Scalar>(pair.edges, corners(x_, v), pair.normal))
    return {pair, Scalar(2)};
  const detail::PairImpact<Scalar> hit =
      detail::advance_pair<Scalar>(pair.edges, corners(x_, v), end, gap);
  SelfImpact<Scalar> out{pair, hit.time};
  if (!(hit.time <= Scalar(1))) return out;
  out.pair.weight = hit.at.weight;
  const Scalar distance = sqrt(hit.at.square);
  if (Scalar(0) < distance) out.pair.normal = hit.at.offset / distance;
  return out;
}

template <RealScalar Scalar>
QueryStatus SelfContactFinder<Scalar>::find_impacts() {
  impacts_.clear();
  if (find(Scalar(0)) != QueryStatus::Answered || !complete_) return QueryStatus::InvalidArgument;
  for (const Pair& pair : contacts_) {
    const SelfImpact<Scalar> hit = impact(pair, y_);
    if (!(hit.time <= Scalar(1))) continue;
    if (impacts_.size() < impacts_.capacity())
      impacts_.push_back(hit);
    else
      complete_ = false;
  }
  return QueryStatus::Answered;
}

template <RealScalar Scalar>
int SelfContactFinder<Scalar>::count_crossings(const PointsView<Scalar>& x) {
  crossings_.clear();
  complete_ = true;
  if (x.cols() != x_.cols() || !all_finite(x)) return -1;
  tree_.fit(x, x, Scalar(0));
  int count = 0;
  tree_.for_each_edge_triangle([&](int e, int t) {
    if (!detail::edge_pierces<Scalar>(x, edges_[static_cast<std::size_t>(e)],
                                      triangles_[static_cast<std::size_t>(t)]))
      return;
    ++count;
    if (crossings_.size() < crossings_.capacity())
      crossings_.push_back({e, t});
    else
      complete_ = false;
  });
  std::sort(crossings_.begin(), crossings_.end(), [](const EdgeCrossing& p, const EdgeCrossing& q) {
    return p.edge != q.edge ? p.edge < q.edge : p.triangle < q.triangle;
  });
  return count;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class SelfContactFinder<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
