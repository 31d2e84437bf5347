#pragma once

// Where a sheet touches a collider, or soon will: at its vertices, and at points inside its edges
// and triangles, x = w_0 x_a + w_1 x_b + w_2 x_c with weights w >= 0 of sum one. A finger that is
// smaller than the cells of the sheet touches it between the vertices.
//
// 1. Broad phase: parts of the sheet whose boxes overlap the collider's (detail/sheet_tree.hpp).
// 2. The distance d of each vertex of these parts.
// 3. The point inside each edge, and then each triangle, where d is least, unless bounds show that
//    it is not below the margin, or not deeper than corners and sides by the `gain`
//    (detail/deepest_point.hpp). On a plane, for instance, vertices suffice.
//
// A union is searched part by part, so a convex part of it has the certainty of a convex collider.

#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/detail/deepest_point.hpp"
#include "clothctl/collision/detail/sheet_tree.hpp"
#include "clothctl/collision/detail/single_query.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A point of a sheet at or near the surface of a collider.
template <RealScalar Scalar>
struct SheetContact {
  /// The vertices that carry the point: one, two (inside an edge) or three (inside a triangle).
  /// Unused entries are -1.
  std::array<int, 3> vertex{-1, -1, -1};
  /// The weights of the vertices; 0 for unused entries.
  Vector3<Scalar> weight = Vector3<Scalar>::Constant(Scalar(0));
  /// The point, m.
  Vector3<Scalar> position = Vector3<Scalar>::Constant(Scalar(0));
  /// The collider's surface there.
  SurfacePoint<Scalar> surface;
  /// How far the point may be deeper than the corners before it counts, m: the gain of the settings
  /// there, 0 for a vertex. Whoever pushes the point out leaves it that deep, so that it presses no
  /// harder the moment it is listed.
  Scalar slack = Scalar(0);

  /// Returns the number of vertices that carry the point.
  int vertex_count() const { return vertex[1] < 0 ? 1 : (vertex[2] < 0 ? 2 : 3); }
};

/// What parts of a sheet a box may touch.
struct SheetOverlap {
  /// Vertices, edges (`SheetContactFinder::edges`) and triangles, each once.
  std::vector<int> vertices, edges, triangles;
};

/// Which points inside edges and triangles are looked for. Lengths in m.
template <RealScalar Scalar>
struct SheetContactSettings {
  /// A point inside an edge or triangle counts as far as it is deeper than the corners and sides by
  /// this (SheetContact::slack). It is listed from half of it on.
  Scalar gain = Scalar(2e-4);
  /// The depth of such a point is found to this, on convex colliders.
  Scalar tolerance = Scalar(1e-6);
  /// False: vertices only.
  bool inside = true;
  /// Features of colliders that are not convex are found inside edges and triangles down to this
  /// size, but not below 1/32 of a triangle or 1/64 of an edge. Smaller takes longer.
  Scalar feature = Scalar(0.015);
  /// The gain, if larger, where the collider's normals at the corners differ by less than 22
  /// degrees; up to 28 degrees it goes over to the other gain. The thickness of the sheet is a good
  /// value: the chords of a coarse sheet may then dip that far towards a round collider, whose
  /// contacts move from triangle to triangle and hold the sheet less quietly than those of
  /// vertices.
  Scalar smooth_gain = Scalar(0);

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    if (!is_finite(gain) || gain < Scalar(0))
      return "the gain " + number_text(gain) + " m, must be finite and not negative";
    if (!is_finite(smooth_gain) || smooth_gain < Scalar(0))
      return "the smooth gain " + number_text(smooth_gain) + " m, must be finite and not negative";
    if (!is_finite(tolerance) || !(Scalar(0) < tolerance))
      return "the tolerance " + number_text(tolerance) + " m, must be finite and positive";
    if (!is_finite(feature) || !(Scalar(0) < feature))
      return "the feature size " + number_text(feature) + " m, must be finite and positive";
    return {};
  }
};

/// Finds contacts of one sheet with colliders. `create` allocates all memory; `update`, `find` and
/// `overlaps` never do.
template <RealScalar Scalar>
class SheetContactFinder {
 public:
  /// Makes a finder for a sheet with the shape at rest `x` (3×n, m), triangles, and threads (edges
  /// of no triangle). There is room for one contact at each vertex, edge and triangle; `reserve`
  /// makes more. Allocates. Complexity: O(n log n). Fails when: a coordinate is not finite,
  /// `make_topology` refuses the triangles, a thread has a vertex off the sheet or twice, or a
  /// setting is wrong.
  static Result<SheetContactFinder> create(const PointsView<Scalar>& x,
                                           const std::vector<std::array<int, 3>>& triangles,
                                           const std::vector<std::array<int, 2>>& threads = {},
                                           const SheetContactSettings<Scalar>& settings = {});

  /// Makes room for `count` contacts in all. Allocates.
  void reserve(Index count) { contacts_.reserve(static_cast<std::size_t>(count)); }
  /// The edges, ascending, each with its smaller vertex first.
  const std::vector<std::array<int, 2>>& edges() const { return edges_; }

  /// The positions of the last update, at which contacts are looked for (3×n, m).
  const Points<Scalar>& positions() const { return x_; }
  /// Returns the number of triangles of the sheet.
  Index triangle_count() const { return triangle_count_; }

  /// Takes the positions (3×n, m) of the sheet. InvalidArgument: wrong number of vertices.
  /// InvalidPoint: a coordinate is not finite. In both cases nothing changes.
  QueryStatus update(const PointsView<Scalar>& x) { return update(x, x); }
  /// Takes positions `x` and the positions `y` at the end of a motion (3×n, m): boxes hold both,
  /// contacts are looked for at `x`. Fails as above.
  QueryStatus update(const PointsView<Scalar>& x, const PointsView<Scalar>& y) {
    if (x.cols() != x_.cols() || y.cols() != x_.cols()) return QueryStatus::InvalidArgument;
    if (!all_finite(x) || !all_finite(y)) return QueryStatus::InvalidPoint;
    x_ = x;
    tree_.fit(x, y);
    return QueryStatus::Answered;
  }

  /// Fills `out` with the parts of the sheet whose boxes may overlap `box`: at least those that do.
  /// Never allocates if `out` comes from `make_overlap`.
  void overlaps(const BoundingBox<Scalar>& box, SheetOverlap& out);
  /// Returns an overlap that has room for the whole sheet. Allocates.
  SheetOverlap make_overlap() const {
    SheetOverlap out;
    out.vertices.reserve(static_cast<std::size_t>(x_.cols()));
    out.edges.reserve(edges_.size());
    out.triangles.reserve(tree_.parts().size());
    return out;
  }

  /// Finds the contacts with a collider: points at most `margin` (m) from its surface, or inside of
  /// it. `dt` (s) is the step for which the collider's box is taken. InvalidArgument: a number is
  /// negative or not finite, or the collider did not answer, or with a distance that is not a
  /// number or a normal that is not of length one; there are no contacts then.
  template <Collider<Scalar> C>
  QueryStatus find(const C& collider, const Scalar& margin, const Scalar& dt) {
    if constexpr (std::same_as<C, ColliderRef<Scalar>>)
      return find_all(collider, margin, dt);
    else
      return find_all(ColliderRef<Scalar>(collider), margin, dt);
  }

  /// The contacts of the last `find`: vertices first, then edges and triangles, part by part of a
  /// union. The same input gives the same order.
  const std::vector<SheetContact<Scalar>>& contacts() const { return contacts_; }
  /// False when the last `find` found more contacts than there was room for: `reserve` more.
  bool complete() const { return complete_; }

 private:
  using Deep = detail::DeepPoint<Scalar>;

  SheetContactFinder(const PointsView<Scalar>& x, std::vector<std::array<int, 2>> edges,
                     std::vector<detail::SheetPart> parts,
                     const SheetContactSettings<Scalar>& settings);

  QueryStatus find_all(const ColliderRef<Scalar>& collider, const Scalar& margin, const Scalar& dt);
  QueryStatus find_in(const ColliderRef<Scalar>& collider, const Scalar& margin, const Scalar& dt);
  /// Lists the parts in a box and their vertices.
  void gather(const BoundingBox<Scalar>& box);
  void search_edge(const ColliderRef<Scalar>& collider, int edge, const Scalar& margin);
  void search_inside(const ColliderRef<Scalar>& collider, const detail::SheetPart& part,
                     const Scalar& margin);
  /// Returns whether an answer is sound: the distance is a number, and the normal of what is at
  /// most `margin` away is of length one.
  static bool is_sound(const SurfacePoint<Scalar>& q, const Scalar& margin) {
    if (margin < q.distance) return true;
    const Scalar square = q.normal.squaredNorm();
    return q.distance <= margin && Scalar(0.98) < square && square < Scalar(1.02);
  }
  Deep evaluate(const ColliderRef<Scalar>& collider, const Vector3<Scalar>& x, const Scalar& s,
                const Scalar& t) const {
    const SurfacePoint<Scalar> q = detail::closest_of<Scalar>(collider, x);
    return {s, t, q.distance, q.normal};
  }
  void add(const std::array<int, 3>& vertex, const Vector3<Scalar>& weight,
           const Vector3<Scalar>& position, const SurfacePoint<Scalar>& surface,
           const Scalar& slack = Scalar(0)) {
    if (contacts_.size() < contacts_.capacity())
      contacts_.push_back({vertex, weight, position, surface, slack});
    else
      complete_ = false;
  }
  /// Returns the gain where the least cosine between normals at corners is `cosine`.
  Scalar gain(const Scalar& cosine) const {
    if (!(settings_.gain < settings_.smooth_gain)) return settings_.gain;
    Scalar share = (cosine - Scalar(0.88)) * Scalar(20);
    if (share < Scalar(0)) share = Scalar(0);
    if (Scalar(1) < share) share = Scalar(1);
    return settings_.gain + share * (settings_.smooth_gain - settings_.gain);
  }
  const SurfacePoint<Scalar>& answer(int vertex) const {
    return answers_[static_cast<std::size_t>(slot_[static_cast<std::size_t>(vertex)])];
  }

  SheetContactSettings<Scalar> settings_;
  std::vector<std::array<int, 2>> edges_;
  detail::SheetTree<Scalar> tree_;
  Points<Scalar> x_;
  Index triangle_count_ = 0;
  std::vector<SheetContact<Scalar>> contacts_;
  bool complete_ = true;

  /// The parts and vertices of the current search, and the places and answers of the vertices.
  std::vector<int> near_parts_, near_vertices_;
  Points<Scalar> near_x_;
  std::vector<SurfacePoint<Scalar>> answers_;
  /// Where a vertex is in the lists above, -1 if nowhere; whether an edge was searched.
  std::vector<int> slot_;
  std::vector<bool> edge_done_;
  /// The deepest point inside each edge, where there is one.
  std::vector<Deep> edge_point_;
  std::vector<bool> edge_found_;
};

template <RealScalar Scalar>
Result<SheetContactFinder<Scalar>> SheetContactFinder<Scalar>::create(
    const PointsView<Scalar>& x, const std::vector<std::array<int, 3>>& triangles,
    const std::vector<std::array<int, 2>>& threads, const SheetContactSettings<Scalar>& settings) {
  if (const std::string bad = settings.validate(); !bad.empty())
    return Error{"the contact finder has " + bad};
  for (Index v = 0; v < x.cols(); ++v) {
    if (!all_finite(x.col(v)))
      return Error{"vertex " + std::to_string(v) + " of the sheet is not finite"};
  }
  if (const Result<Topology> topology = make_topology(x.cols(), triangles); !topology)
    return Error{topology.error()};
  for (std::size_t i = 0; i < threads.size(); ++i) {
    for (const int v : threads[i]) {
      if (v < 0 || v >= x.cols())
        return Error{"thread " + std::to_string(i) + " holds vertex " + std::to_string(v) +
                     " off the sheet of " + std::to_string(x.cols()) + " vertices"};
    }
    if (threads[i][0] == threads[i][1])
      return Error{"thread " + std::to_string(i) + " holds vertex " +
                   std::to_string(threads[i][0]) + " twice"};
  }
  std::vector<std::array<int, 2>> edges = detail::sheet_edges(triangles, threads);
  std::vector<detail::SheetPart> parts =
      detail::sheet_parts(static_cast<int>(x.cols()), triangles, edges);
  return SheetContactFinder(x, std::move(edges), std::move(parts), settings);
}

template <RealScalar Scalar>
SheetContactFinder<Scalar>::SheetContactFinder(const PointsView<Scalar>& x,
                                               std::vector<std::array<int, 2>> edges,
                                               std::vector<detail::SheetPart> parts,
                                               const SheetContactSettings<Scalar>& settings)
    : settings_(settings),
      edges_(std::move(edges)),
      tree_(x, std::move(parts)),
      x_(x),
      near_x_(3, x.cols()),
      answers_(static_cast<std::size_t>(x.cols())),
      slot_(static_cast<std::size_t>(x.cols()), -1),
      edge_done_(edges_.size(), false),
      edge_point_(edges_.size()),
      edge_found_(edges_.size(), false) {
  for (const detail::SheetPart& part : tree_.parts()) {
    if (part.triangle >= 0) ++triangle_count_;
  }
  tree_.fit(x, x);
  contacts_.reserve(static_cast<std::size_t>(x.cols()) + edges_.size() + tree_.parts().size());
  near_parts_.reserve(tree_.parts().size());
  near_vertices_.reserve(static_cast<std::size_t>(x.cols()));
}

template <RealScalar Scalar>
void SheetContactFinder<Scalar>::gather(const BoundingBox<Scalar>& box) {
  for (const int v : near_vertices_) slot_[static_cast<std::size_t>(v)] = -1;
  for (const int i : near_parts_) {
    for (const int e : tree_.parts()[static_cast<std::size_t>(i)].edge) {
      if (e >= 0) edge_done_[static_cast<std::size_t>(e)] = false;
    }
  }
  near_vertices_.clear();
  near_parts_.clear();
  tree_.for_each_overlap(box, [this](int first, int count) {
    for (int i = first; i < first + count; ++i) {
      near_parts_.push_back(i);
      for (const int v : tree_.parts()[static_cast<std::size_t>(i)].vertex) {
        if (v < 0 || slot_[static_cast<std::size_t>(v)] >= 0) continue;
        slot_[static_cast<std::size_t>(v)] = static_cast<int>(near_vertices_.size());
        near_x_.col(static_cast<Index>(near_vertices_.size())) = x_.col(v);
        near_vertices_.push_back(v);
      }
    }
  });
}

template <RealScalar Scalar>
void SheetContactFinder<Scalar>::overlaps(const BoundingBox<Scalar>& box, SheetOverlap& out) {
  gather(box);
  out.vertices.assign(near_vertices_.begin(), near_vertices_.end());
  out.edges.clear();
  out.triangles.clear();
  for (const int i : near_parts_) {
    const detail::SheetPart& part = tree_.parts()[static_cast<std::size_t>(i)];
    if (part.triangle >= 0) out.triangles.push_back(part.triangle);
    for (const int e : part.edge) {
      if (e < 0 || edge_done_[static_cast<std::size_t>(e)]) continue;
      edge_done_[static_cast<std::size_t>(e)] = true;
      out.edges.push_back(e);
    }
  }
}

template <RealScalar Scalar>
QueryStatus SheetContactFinder<Scalar>::find_all(const ColliderRef<Scalar>& collider,
                                                 const Scalar& margin, const Scalar& dt) {
  contacts_.clear();
  complete_ = true;
  if (!is_finite(margin) || margin < Scalar(0) || !is_finite(dt) || dt < Scalar(0))
    return QueryStatus::InvalidArgument;
  const QueryStatus status = find_in(collider, margin, dt);
  if (status != QueryStatus::Answered) contacts_.clear();
  return status;
}

template <RealScalar Scalar>
QueryStatus SheetContactFinder<Scalar>::find_in(const ColliderRef<Scalar>& collider,
                                                const Scalar& margin, const Scalar& dt) {
  const Index parts = collider.part_count();
  for (Index i = 0; i < parts; ++i) {
    const QueryStatus status = find_in(collider.part(i), margin, dt);
    if (status != QueryStatus::Answered) return status;
  }
  if (parts > 0) return QueryStatus::Answered;
  gather(collider.bounds(dt).grown(margin));
  const Index count = static_cast<Index>(near_vertices_.size());
  const std::span<SurfacePoint<Scalar>> answers(answers_.data(), near_vertices_.size());
  if (collider.closest(near_x_.leftCols(count), answers) != QueryStatus::Answered)
    return QueryStatus::InvalidArgument;
  const Vector3<Scalar> whole(Scalar(1), Scalar(0), Scalar(0));
  for (const int v : near_vertices_) {
    if (!is_sound(answer(v), margin)) return QueryStatus::InvalidArgument;
    if (answer(v).distance <= margin) add({v, -1, -1}, whole, x_.col(v), answer(v));
  }
  if (!settings_.inside) return QueryStatus::Answered;
  for (const int i : near_parts_) {
    for (const int e : tree_.parts()[static_cast<std::size_t>(i)].edge) {
      if (e < 0 || edge_done_[static_cast<std::size_t>(e)]) continue;
      edge_done_[static_cast<std::size_t>(e)] = true;
      search_edge(collider, e, margin);
    }
  }
  for (const int i : near_parts_) {
    const detail::SheetPart& part = tree_.parts()[static_cast<std::size_t>(i)];
    if (part.triangle >= 0) search_inside(collider, part, margin);
  }
  return QueryStatus::Answered;
}

template <RealScalar Scalar>
void SheetContactFinder<Scalar>::search_edge(const ColliderRef<Scalar>& collider, int edge,
                                             const Scalar& margin) {
  using std::sqrt;
  const std::array<int, 2>& ends = edges_[static_cast<std::size_t>(edge)];
  const Vector3<Scalar> a = x_.col(ends[0]), u = x_.col(ends[1]) - x_.col(ends[0]);
  const SurfacePoint<Scalar>&at_a = answer(ends[0]), &at_b = answer(ends[1]);
  const Scalar least = at_b.distance < at_a.distance ? at_b.distance : at_a.distance;
  edge_found_[static_cast<std::size_t>(edge)] = false;
  // No point of the edge is farther than half its length from an end.
  if (margin < least - Scalar(0.5) * sqrt(u.squaredNorm())) return;
  const auto at = [&](const Scalar& s) {
    return evaluate(collider, Vector3<Scalar>(a + s * u), s, Scalar(0));
  };
  const Scalar slack = gain(at_a.normal.dot(at_b.normal));
  Scalar highest = least - Scalar(0.5) * slack;
  if (margin < highest) highest = margin;
  Deep low{Scalar(0), Scalar(0), at_a.distance, at_a.normal};
  const Deep end{Scalar(1), Scalar(0), at_b.distance, at_b.normal};
  Deep best = low;
  bool found = false;
  const Scalar length = sqrt(u.squaredNorm());
  int pieces = 1;
  if (!collider.is_convex()) {
    while (pieces < 64 && settings_.feature * Scalar(static_cast<double>(pieces)) < length)
      ++pieces;
  }
  const Scalar step = Scalar(1) / Scalar(static_cast<double>(pieces));
  for (int k = 1; k <= pieces; ++k) {
    const Deep high = k == pieces ? end : at(Scalar(static_cast<double>(k)) * step);
    if (k < pieces && high.distance < highest) {
      best = high;
      found = true;
      highest = high.distance - settings_.tolerance;
    }
    if (detail::search_segment<Scalar>(at, u, low, high, highest, settings_.tolerance, best)) {
      found = true;
      highest = best.distance - settings_.tolerance;
    }
    low = high;
  }
  if (!found) return;
  edge_found_[static_cast<std::size_t>(edge)] = true;
  edge_point_[static_cast<std::size_t>(edge)] = best;
  const Vector3<Scalar> x = a + best.s * u;
  add({ends[0], ends[1], -1}, Vector3<Scalar>(Scalar(1) - best.s, best.s, Scalar(0)), x,
      detail::closest_of<Scalar>(collider, x), slack);
}

template <RealScalar Scalar>
void SheetContactFinder<Scalar>::search_inside(const ColliderRef<Scalar>& collider,
                                               const detail::SheetPart& part,
                                               const Scalar& margin) {
  using std::sqrt;
  const Vector3<Scalar> a = x_.col(part.vertex[0]);
  const Vector3<Scalar> u = x_.col(part.vertex[1]) - a, v = x_.col(part.vertex[2]) - a;
  const auto bound = [&](const Vector3<Scalar>& x, const Scalar& d, const Vector3<Scalar>& n) {
    return detail::DistanceBound<Scalar>{d + n.dot(Vector3<Scalar>(a - x)), n.dot(u), n.dot(v)};
  };
  std::array<detail::DistanceBound<Scalar>, 6> known{};
  Scalar least = answer(part.vertex[0]).distance, longest(0);
  for (std::size_t i = 0; i < 3; ++i) {
    const SurfacePoint<Scalar>& q = answer(part.vertex[i]);
    known[i] = known[i + 3] = bound(x_.col(part.vertex[i]), q.distance, q.normal);
    if (q.distance < least) least = q.distance;
    const std::array<int, 2>& ends = edges_[static_cast<std::size_t>(part.edge[i])];
    const Vector3<Scalar> side = x_.col(ends[1]) - x_.col(ends[0]);
    if (longest < side.squaredNorm()) longest = side.squaredNorm();
    if (!edge_found_[static_cast<std::size_t>(part.edge[i])]) continue;
    const Deep& y = edge_point_[static_cast<std::size_t>(part.edge[i])];
    known[i + 3] = bound(x_.col(ends[0]) + y.s * side, y.distance, y.normal);
    if (y.distance < least) least = y.distance;
  }
  // No point of a triangle is farther than longest/√3 from a corner.
  longest = sqrt(longest);
  if (margin < least - Scalar(0.58) * longest) return;
  Scalar cosine = Scalar(1);
  for (std::size_t i = 0; i < 3; ++i) {
    const Scalar turn = answer(part.vertex[i]).normal.dot(answer(part.vertex[(i + 1) % 3]).normal);
    if (turn < cosine) cosine = turn;
  }
  const Scalar slack = gain(cosine);
  Scalar highest = least - Scalar(0.5) * slack;
  if (margin < highest) highest = margin;
  const auto at = [&](const Scalar& s, const Scalar& t) {
    return evaluate(collider, Vector3<Scalar>(a + s * u + t * v), s, t);
  };
  const Scalar zero(0), one(1);
  Deep best{zero, zero, least, answer(part.vertex[0]).normal};
  const std::array<std::array<Scalar, 2>, 3> all{std::array<Scalar, 2>{zero, zero},
                                                 std::array<Scalar, 2>{one, zero},
                                                 std::array<Scalar, 2>{zero, one}};
  const bool found = collider.is_convex()
                         ? detail::search_triangle<Scalar>(at, u, v, all, known, highest,
                                                           settings_.tolerance, best)
                         : detail::search_pieces<Scalar>(at, u, v, settings_.feature, highest,
                                                         settings_.tolerance, best);
  if (!found) return;
  const Vector3<Scalar> x = a + best.s * u + best.t * v;
  add(part.vertex, Vector3<Scalar>(one - best.s - best.t, best.s, best.t), x,
      detail::closest_of<Scalar>(collider, x), slack);
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class SheetContactFinder<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
