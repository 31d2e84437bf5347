#pragma once

// A constrained Delaunay triangulation of lattice points in the plane. Points are inserted one by
// one; an edge ab of two triangles abc, bad is flipped to cd while d lies inside the circle of abc
// (Lawson). An edge that must stay (a constraint) is made by flips of the edges that cross it
// (Sloan 1993) and is then never flipped. All tests are exact, so the flips end.
//
// Three far vertices 0, 1, 2 make a triangle around the lattice square |x|, |y| ≤ 2^25; the points
// that are inserted have the indices from 3 on. A far vertex is not at infinity, so the hull of the
// points need not be convex; the part inside closed constraints is not affected.

#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/mesh/detail/lattice_predicates.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// A triangle of a triangulation.
struct Face {
  /// Corners, counter-clockwise.
  std::array<int, 3> vertex{};
  /// The face across the edge opposite each corner, or -1.
  std::array<int, 3> next{-1, -1, -1};
  /// Whether the edge opposite each corner is a constraint.
  std::array<bool, 3> fixed{false, false, false};
  /// Whether the face lies inside the panel; see `classify`.
  bool inside = false;

  /// Returns the position of a corner.
  std::size_t corner(int v) const { return vertex[0] == v ? 0 : (vertex[1] == v ? 1 : 2); }
  /// Returns the position of a neighbour.
  std::size_t side(int face) const { return next[0] == face ? 0 : (next[1] == face ? 1 : 2); }
};

/// What became of a point or an edge that was inserted.
enum class InsertOutcome {
  Inserted,
  /// The point is there already, or lies on a constraint.
  Coincides,
  /// The edge crosses another constraint.
  Crosses,
  /// The edge passes through a vertex.
  Touches
};

/// The triangulation.
class ConstrainedTriangulation {
 public:
  /// The largest magnitude of a coordinate of an inserted point.
  static constexpr std::int64_t kExtent = std::int64_t(1) << 25;

  /// Starts with the far triangle. Allocates.
  ConstrainedTriangulation() {
    const std::int64_t s = kLatticeLimit;
    points_ = {{-s, -s}, {s, -s}, {0, s}};
    faces_.push_back(Face{{0, 1, 2}, {-1, -1, -1}, {false, false, false}, false});
    face_of_ = {0, 0, 0};
  }

  const std::vector<LatticePoint>& points() const { return points_; }
  const std::vector<Face>& faces() const { return faces_; }
  const LatticePoint& point(int v) const { return points_[static_cast<std::size_t>(v)]; }

  /// Moves a vertex. The caller keeps all faces positive.
  void move(int v, const LatticePoint& to) { points_[static_cast<std::size_t>(v)] = to; }

  /// Returns a face that holds a point inside or on its border. Complexity: O(√faces) as a rule.
  int locate(const LatticePoint& p) const {
    int at = last_;
    for (std::size_t steps = 0; steps < faces_.size() + 8; ++steps) {
      const Face& f = face(at);
      std::size_t out = 3;
      for (std::size_t k = 0; k < 3 && out == 3; ++k) {
        const std::size_t i = (k + steps) % 3;
        if (orientation(point(f.vertex[(i + 1) % 3]), point(f.vertex[(i + 2) % 3]), p) < 0) out = i;
      }
      if (out == 3 || f.next[out] < 0) return at;
      at = f.next[out];
    }
    // A walk may go in circles where constraints spoil the Delaunay property.
    for (std::size_t i = 0; i < faces_.size(); ++i) {
      if (contains(faces_[i], p)) return static_cast<int>(i);
    }
    return last_;
  }

  /// Inserts a point and flips edges until the triangulation is Delaunay again. The new vertex has
  /// the index points().size() - 1. Allocates.
  InsertOutcome insert(const LatticePoint& p) {
    const int at = locate(p);
    std::size_t on = 3;
    for (std::size_t i = 0; i < 3; ++i) {
      const Face& f = face(at);
      if (point(f.vertex[i]) == p) return InsertOutcome::Coincides;
      if (orientation(point(f.vertex[(i + 1) % 3]), point(f.vertex[(i + 2) % 3]), p) == 0) on = i;
    }
    if (on < 3 && (face(at).fixed[on] || face(at).next[on] < 0)) return InsertOutcome::Coincides;
    const int v = static_cast<int>(points_.size());
    points_.push_back(p);
    face_of_.push_back(at);
    on < 3 ? split_edge(at, on, v) : split_face(at, v);
    legalise();
    last_ = face_of_[static_cast<std::size_t>(v)];
    return InsertOutcome::Inserted;
  }

  /// Makes the edge from a to b and fixes it. Allocates.
  InsertOutcome constrain(int a, int b) {
    std::vector<std::array<int, 2>> crossed;
    const InsertOutcome found = find_crossed(a, b, crossed);
    if (found != InsertOutcome::Inserted) return found;
    std::size_t postponed = 0, left = 4 * crossed.size() * crossed.size() + 16;
    while (!crossed.empty() && postponed <= crossed.size() && left-- > 0) {
      const std::array<int, 2> edge = crossed.front();
      crossed.erase(crossed.begin());
      const auto [f, i] = find_edge(edge[0], edge[1]);
      if (f < 0) continue;
      if (!convex(f, i)) {
        crossed.push_back(edge);
        ++postponed;
        continue;
      }
      postponed = 0;
      flip(f, i);
      const std::array<int, 2> made{face(f).vertex[0], face(f).vertex[2]};
      if (crosses(a, b, made[0], made[1])) {
        crossed.push_back(made);
      } else {
        stack_.push_back(made);
      }
    }
    const auto [f, i] = find_edge(a, b);
    if (f < 0) return InsertOutcome::Crosses;
    set_fixed(f, i);
    legalise();
    return InsertOutcome::Inserted;
  }

  /// Marks a face as inside when every path to the far vertices crosses an odd number of
  /// constraints. Returns the number of connected pieces inside. Allocates.
  int classify() {
    std::vector<int> depth(faces_.size(), -1), waiting{0};
    for (std::size_t f = 0; f < faces_.size(); ++f) {
      const auto& v = faces_[f].vertex;
      if (v[0] < 3 || v[1] < 3 || v[2] < 3) waiting[0] = static_cast<int>(f);
    }
    depth[static_cast<std::size_t>(waiting[0])] = 0;
    int pieces = 0;
    std::vector<int> later;
    while (!waiting.empty() || !later.empty()) {
      if (waiting.empty()) {
        waiting.swap(later);
        continue;
      }
      const int at = waiting.back();
      waiting.pop_back();
      pieces += spread(at, depth, later) ? 1 : 0;
    }
    return pieces;
  }

  /// Flips all unfixed edges that are not Delaunay. Complexity: O(faces) when few are. Allocates.
  void legalise_all() {
    for (const Face& f : faces_) {
      for (std::size_t i = 0; i < 3; ++i) {
        const std::array<int, 2> edge{f.vertex[(i + 1) % 3], f.vertex[(i + 2) % 3]};
        if (edge[0] < edge[1]) stack_.push_back(edge);
      }
    }
    legalise();
  }

  /// Returns the face that has the edge from a to b counter-clockwise, and the position of its
  /// third corner; or {-1, 0}.
  std::pair<int, std::size_t> find_edge(int a, int b) const {
    const int start = face_of_[static_cast<std::size_t>(a)];
    for (int at = start;;) {
      const Face& f = face(at);
      const std::size_t i = f.corner(a);
      if (f.vertex[(i + 1) % 3] == b) return {at, (i + 2) % 3};
      at = f.next[(i + 1) % 3];
      if (at < 0 || at == start) break;
    }
    for (int at = start;;) {  // the other way round, where the first stopped at the border
      const Face& f = face(at);
      const std::size_t i = f.corner(a);
      if (f.vertex[(i + 1) % 3] == b) return {at, (i + 2) % 3};
      at = f.next[(i + 2) % 3];
      if (at < 0 || at == start) return {-1, 0};
    }
  }

  /// Returns whether the two faces at an edge make a strictly convex quadrilateral.
  bool convex(int at, std::size_t i) const {
    const Face& f = face(at);
    if (f.fixed[i] || f.next[i] < 0) return false;
    const Face& g = face(f.next[i]);
    const LatticePoint &apex = point(f.vertex[i]), &opposite = point(g.vertex[g.side(at)]);
    return orientation(apex, point(f.vertex[(i + 1) % 3]), opposite) > 0 &&
           orientation(opposite, point(f.vertex[(i + 2) % 3]), apex) > 0;
  }

  /// Replaces the edge opposite corner i of a face by the other diagonal. Face `at` then has the
  /// corners (apex, first end, far corner), and its neighbour (far corner, second end, apex).
  void flip(int at, std::size_t i) {
    Face& f = faces_[static_cast<std::size_t>(at)];
    const int other = f.next[i];
    Face& g = faces_[static_cast<std::size_t>(other)];
    const std::size_t j = g.side(at), i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3,
                      j2 = (j + 2) % 3;
    const int apex = f.vertex[i], first = f.vertex[i1], second = f.vertex[i2],
              opposite = g.vertex[j];
    // g has (far, second, first) counter-clockwise from corner j.
    const Face was_f = f, was_g = g;
    f.vertex = {apex, first, opposite};
    f.next = {was_g.next[j1], other, was_f.next[i2]};
    f.fixed = {was_g.fixed[j1], false, was_f.fixed[i2]};
    g.vertex = {opposite, second, apex};
    g.next = {was_f.next[i1], at, was_g.next[j2]};
    g.fixed = {was_f.fixed[i1], false, was_g.fixed[j2]};
    relink(was_g.next[j1], other, at);
    relink(was_f.next[i1], at, other);
    face_of_[static_cast<std::size_t>(apex)] = at;
    face_of_[static_cast<std::size_t>(first)] = at;
    face_of_[static_cast<std::size_t>(opposite)] = at;
    face_of_[static_cast<std::size_t>(second)] = other;
  }

 private:
  const Face& face(int f) const { return faces_[static_cast<std::size_t>(f)]; }

  bool contains(const Face& f, const LatticePoint& p) const {
    for (std::size_t i = 0; i < 3; ++i) {
      if (orientation(point(f.vertex[i]), point(f.vertex[(i + 1) % 3]), p) < 0) return false;
    }
    return true;
  }

  void relink(int at, int from, int to) {
    if (at < 0) return;
    Face& f = faces_[static_cast<std::size_t>(at)];
    f.next[f.side(from)] = to;
  }

  /// Replaces a face by three around a vertex inside it.
  void split_face(int at, int v) {
    const Face was = face(at);
    const int g = static_cast<int>(faces_.size()), h = g + 1;
    const auto [a, b, c] = was.vertex;
    faces_[static_cast<std::size_t>(at)] =
        Face{{v, a, b}, {was.next[2], g, h}, {was.fixed[2], false, false}, was.inside};
    faces_.push_back(
        Face{{v, b, c}, {was.next[0], h, at}, {was.fixed[0], false, false}, was.inside});
    faces_.push_back(
        Face{{v, c, a}, {was.next[1], at, g}, {was.fixed[1], false, false}, was.inside});
    relink(was.next[0], at, g);
    relink(was.next[1], at, h);
    face_of_[static_cast<std::size_t>(a)] = face_of_[static_cast<std::size_t>(b)] = at;
    face_of_[static_cast<std::size_t>(c)] = g;
    for (const auto& edge : {std::array{a, b}, std::array{b, c}, std::array{c, a}})
      stack_.push_back(edge);
  }

  /// Replaces the two faces at an edge by four around a vertex on it.
  void split_edge(int at, std::size_t i, int v) {
    const Face f = face(at);
    const int other = f.next[i];
    const Face g = face(other);
    const std::size_t j = g.side(at), i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3,
                      j2 = (j + 2) % 3;
    const int apex = f.vertex[i], first = f.vertex[i1], second = f.vertex[i2],
              opposite = g.vertex[j];
    const int p = static_cast<int>(faces_.size()), q = p + 1;
    faces_[static_cast<std::size_t>(at)] =
        Face{{v, apex, first}, {f.next[i2], q, p}, {f.fixed[i2], false, false}, f.inside};
    faces_[static_cast<std::size_t>(other)] =
        Face{{v, opposite, second}, {g.next[j2], p, q}, {g.fixed[j2], false, false}, g.inside};
    faces_.push_back(
        Face{{v, second, apex}, {f.next[i1], at, other}, {f.fixed[i1], false, false}, f.inside});
    faces_.push_back(
        Face{{v, first, opposite}, {g.next[j1], other, at}, {g.fixed[j1], false, false}, g.inside});
    relink(f.next[i1], at, p);
    relink(g.next[j1], other, q);
    face_of_[static_cast<std::size_t>(apex)] = face_of_[static_cast<std::size_t>(first)] = at;
    face_of_[static_cast<std::size_t>(opposite)] = face_of_[static_cast<std::size_t>(second)] =
        other;
    for (const auto& edge : {std::array{apex, first}, std::array{opposite, second},
                             std::array{second, apex}, std::array{first, opposite}})
      stack_.push_back(edge);
  }

  /// Flips the edges on the stack, and those that a flip affects, while they are not Delaunay.
  void legalise() {
    while (!stack_.empty()) {
      const std::array<int, 2> edge = stack_.back();
      stack_.pop_back();
      const auto [f, i] = find_edge(edge[0], edge[1]);
      if (f < 0 || face(f).fixed[i] || face(f).next[i] < 0) continue;
      const Face& here = face(f);
      const Face& there = face(here.next[i]);
      const int opposite = there.vertex[there.side(f)];
      if (in_circle(point(here.vertex[0]), point(here.vertex[1]), point(here.vertex[2]),
                    point(opposite)) <= 0)
        continue;
      const int apex = here.vertex[i];
      flip(f, i);
      for (const int end : edge) {
        stack_.push_back({apex, end});
        stack_.push_back({end, opposite});
      }
    }
  }

  bool crosses(int a, int b, int c, int d) const {
    if (a == c || a == d || b == c || b == d) return false;
    const std::int64_t c_side = orientation(point(a), point(b), point(c)),
                       d_side = orientation(point(a), point(b), point(d)),
                       a_side = orientation(point(c), point(d), point(a)),
                       b_side = orientation(point(c), point(d), point(b));
    return (c_side > 0) != (d_side > 0) && (a_side > 0) != (b_side > 0);
  }

  /// Lists the edges that the segment from a to b crosses, in order.
  InsertOutcome find_crossed(int a, int b, std::vector<std::array<int, 2>>& crossed) const {
    if (find_edge(a, b).first >= 0) return InsertOutcome::Inserted;
    const LatticePoint &p = point(a), &q = point(b);
    int at = face_of_[static_cast<std::size_t>(a)];
    std::size_t i = 0;
    for (const int start = at;;) {
      const Face& f = face(at);
      i = f.corner(a);
      const LatticePoint &u = point(f.vertex[(i + 1) % 3]), &w = point(f.vertex[(i + 2) % 3]);
      const std::int64_t right = orientation(p, u, q), left = orientation(p, q, w);
      if (right > 0 && left > 0) break;
      if (right == 0 && (q.x - p.x) * (u.x - p.x) + (q.y - p.y) * (u.y - p.y) > 0)
        return InsertOutcome::Touches;
      at = f.next[(i + 1) % 3];
      if (at < 0 || at == start) return InsertOutcome::Touches;
    }
    while (true) {
      const Face& f = face(at);
      if (f.fixed[i]) return InsertOutcome::Crosses;
      crossed.push_back({f.vertex[(i + 1) % 3], f.vertex[(i + 2) % 3]});
      const int beyond = f.next[i];
      const Face& g = face(beyond);
      const std::size_t j = g.side(at);
      if (g.vertex[j] == b) return InsertOutcome::Inserted;
      const std::int64_t side = orientation(p, q, point(g.vertex[j]));
      if (side == 0) return InsertOutcome::Touches;
      // The segment leaves g opposite the end of the entered edge that is on the far corner's side.
      const bool same = (orientation(p, q, point(g.vertex[(j + 1) % 3])) > 0) == (side > 0);
      i = (j + (same ? 1 : 2)) % 3;
      at = beyond;
    }
  }

  void set_fixed(int at, std::size_t i) {
    Face& f = faces_[static_cast<std::size_t>(at)];
    f.fixed[i] = true;
    if (f.next[i] < 0) return;
    Face& g = faces_[static_cast<std::size_t>(f.next[i])];
    g.fixed[g.side(at)] = true;
  }

  /// Gives all faces that are reached from `start` without a constraint its depth, and those behind
  /// a constraint the next one. Returns whether a new piece inside was found.
  bool spread(int start, std::vector<int>& depth, std::vector<int>& later) {
    const int level = depth[static_cast<std::size_t>(start)];
    if (level < -1) return false;
    std::vector<int> waiting{start};
    bool fresh = false;
    while (!waiting.empty()) {
      const int at = waiting.back();
      waiting.pop_back();
      Face& f = faces_[static_cast<std::size_t>(at)];
      int& own = depth[static_cast<std::size_t>(at)];
      if (own < -1) continue;
      own = -2 - level;
      f.inside = level % 2 == 1;
      fresh = true;
      for (std::size_t i = 0; i < 3; ++i) {
        if (f.next[i] < 0) continue;
        int& beyond = depth[static_cast<std::size_t>(f.next[i])];
        if (beyond < -1) continue;
        if (f.fixed[i]) {
          beyond = level + 1;
          later.push_back(f.next[i]);
        } else {
          waiting.push_back(f.next[i]);
        }
      }
    }
    return fresh && level % 2 == 1;
  }

  std::vector<LatticePoint> points_;
  std::vector<Face> faces_;
  std::vector<int> face_of_;               // a face of each vertex
  std::vector<std::array<int, 2>> stack_;  // edges that may have to be flipped
  int last_ = 0;                           // where the next walk starts
};

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
