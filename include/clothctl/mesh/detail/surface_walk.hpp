#pragma once

// Leads a polyline over a triangle mesh: finds points on the surface, makes them vertices, and
// marks edges from one to the next. surface_cut.hpp states the equations.

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "clothctl/math/closest_point.hpp"
#include "clothctl/mesh/mesh_editor.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Leads a polyline over the mesh of an editor. `snap` and `reach` are in mean edge lengths.
template <RealScalar Scalar>
class SurfaceWalk {
 public:
  SurfaceWalk(MeshEditor<Scalar>& mesh, const Scalar& snap, const Scalar& reach) : mesh_(mesh) {
    using std::sqrt;
    Scalar sum = Scalar(0);
    double count = 0.0;
    for (const std::array<int, 3>& corner : mesh.triangles()) {
      for (std::size_t i = 0; i < 3; ++i) {
        sum += (mesh.position(corner[i]) - mesh.position(corner[(i + 1) % 3])).norm();
        count += 1.0;
        const Vector3<Scalar>& x = mesh.position(corner[i]);
        if (count < 2.0) low_ = high_ = x;
        low_ = low_.cwiseMin(x);
        high_ = high_.cwiseMax(x);
      }
    }
    const Scalar mean = count < 1.0 ? Scalar(0) : sum / Scalar(count);
    snap_ = snap * mean;
    reach_ = reach * mean;
  }

  /// Returns true when a point is so far away that rounding would move the cut.
  bool too_far(const Vector3<Scalar>& point) const {
    if (mesh_.triangles().empty()) return false;
    const Scalar size = (high_ - low_).norm();
    for (Index c = 0; c < 3; ++c) {
      const Scalar away = point[c] - low_[c];
      if (Scalar(1e4) * size < away || away < Scalar(-1e4) * size) return true;
    }
    return false;
  }

  /// Marks the edges along a polyline; inserts vertices where it crosses edges and has corners.
  /// Returns the number of segments that were not followed to their end.
  int follow(const PointsView<Scalar>& polyline) {
    if (mesh_.triangles().empty()) return 0;
    std::vector<int> corner;
    int broken = 0;
    for (Index i = 0; i < polyline.cols(); ++i) corner.push_back(vertex_at(polyline.col(i)));
    for (std::size_t i = 1; i < corner.size(); ++i) {
      const Index end = static_cast<Index>(i);
      if (!segment(polyline.col(end - 1), polyline.col(end), corner[i - 1], corner[i])) ++broken;
    }
    return broken;
  }

 private:
  /// How a walk ended.
  enum class End { Reached, LeftMesh, Stuck };
  /// Where a segment enters the mesh: at (1-t) x_a + t x_b of a border edge, after the share s.
  struct Entry {
    Scalar s = Scalar(2);
    int a = -1, b = -1;
    Scalar t = Scalar(0);
  };

  Vector3<Scalar> triangle_normal(int triangle) const {
    const std::array<int, 3>& corner = mesh_.triangles()[static_cast<std::size_t>(triangle)];
    const Vector3<Scalar>& x = mesh_.position(corner[0]);
    return (mesh_.position(corner[1]) - x).cross(mesh_.position(corner[2]) - x);
  }

  /// Returns the vertex that is the point of the surface closest to `point`; inserts it if there is
  /// none nearby. Returns -1 when the point is beside, above or below the mesh.
  int vertex_at(const Vector3<Scalar>& point) {
    PointOnTriangle<Scalar> best;
    for (std::size_t t = 0; t < mesh_.triangles().size(); ++t) {
      std::array<Vector3<Scalar>, 3> x;
      for (std::size_t i = 0; i < 3; ++i) x[i] = mesh_.position(mesh_.triangles()[t][i]);
      const PointOnTriangle<Scalar> at = closest_on_triangle<Scalar>(point, x);
      if (best.triangle >= 0 && !(at.squared_distance < best.squared_distance)) continue;
      best = at;
      best.triangle = static_cast<int>(t);
    }
    if (reach_ * reach_ < best.squared_distance || beside(point, best)) return -1;
    return insert(best);
  }

  /// Returns true when the closest point is on the border and `point` is beside it.
  bool beside(const Vector3<Scalar>& point, const PointOnTriangle<Scalar>& at) const {
    using std::sqrt;
    const std::array<int, 3>& corner = mesh_.triangles()[static_cast<std::size_t>(at.triangle)];
    Vector3<Scalar> place = Vector3<Scalar>::Zero();
    bool on_border = false;
    for (std::size_t i = 0; i < 3; ++i) {
      place += at.weights[i] * mesh_.position(corner[i]);
      const bool on_side = !(Scalar(0) < at.weights[i]);
      if (on_side && mesh_.is_border(corner[(i + 1) % 3], corner[(i + 2) % 3])) on_border = true;
      if (!(at.weights[i] < Scalar(1)) && border_vertex(corner[i])) on_border = true;
    }
    if (!on_border) return false;
    const Vector3<Scalar> gap = point - place, normal = triangle_normal(at.triangle);
    const Scalar size = normal.squaredNorm(), above = normal.dot(gap);
    const Scalar beside = gap.squaredNorm() - (Scalar(0) < size ? above * above / size : Scalar(0));
    return snap_ * snap_ < beside;
  }

  bool border_vertex(int vertex) const {
    for (const int t : mesh_.around(vertex)) {
      for (const int v : mesh_.triangles()[static_cast<std::size_t>(t)]) {
        if (v != vertex && mesh_.is_border(vertex, v)) return true;
      }
    }
    return false;
  }

  /// Returns a vertex at a point of a triangle: a corner or a vertex on a side if the point is
  /// within the snap distance of it, else a new vertex inside.
  int insert(const PointOnTriangle<Scalar>& at) {
    const std::array<int, 3> corner = mesh_.triangles()[static_cast<std::size_t>(at.triangle)];
    Vector3<Scalar> place = Vector3<Scalar>::Zero();
    for (std::size_t i = 0; i < 3; ++i) place += at.weights[i] * mesh_.position(corner[i]);
    std::size_t closest = 0, side = 0;
    std::array<Scalar, 3> to_corner, to_side, along;
    for (std::size_t i = 0; i < 3; ++i) {
      const Vector3<Scalar>&a = mesh_.position(corner[(i + 1) % 3]),
            &b = mesh_.position(corner[(i + 2) % 3]);
      along[i] = closest_on_segment<Scalar>(place, a, b);
      to_side[i] = (a + along[i] * (b - a) - place).squaredNorm();
      to_corner[i] = (mesh_.position(corner[i]) - place).squaredNorm();
      if (to_corner[i] < to_corner[closest]) closest = i;
      if (to_side[i] < to_side[side]) side = i;
    }
    const Scalar limit = snap_ * snap_;
    if (to_corner[closest] < limit) return corner[closest];
    if (to_side[side] < limit)
      return on_edge(corner[(side + 1) % 3], corner[(side + 2) % 3], along[side]);
    const Result<int> made = mesh_.insert_in_triangle(at.triangle, at.weights);
    return made ? made.value() : corner[closest];
  }

  /// Returns a vertex on the edge a-b at t: an end within the snap distance, else a new vertex.
  /// An edge shorter than the snap distance is not divided; of a short one the middle part is left.
  int on_edge(int a, int b, const Scalar& t) {
    const Scalar length = (mesh_.position(b) - mesh_.position(a)).norm();
    Scalar margin = Scalar(0.5);
    if (snap_ < length) margin = (std::min)(Scalar(0.3), Scalar(snap_ / length));
    if (!(margin < t)) return a;
    if (!(t < Scalar(1) - margin)) return b;
    const Result<int> made = mesh_.insert_on_edge(a, b, t);
    return made ? made.value() : a;
  }

  /// Follows the segment p-q from vertex `at` (-1: not on the mesh) to vertex `to` (-1: likewise).
  /// Returns false when it cannot be followed to its end.
  bool segment(const Vector3<Scalar>& p, const Vector3<Scalar>& q, int at, int to) {
    const Vector3<Scalar> d = q - p;
    const Scalar squared = d.squaredNorm();
    if (!(Scalar(0) < squared)) return true;
    Scalar last_entry = Scalar(-1), done = Scalar(0);
    while (true) {
      if (at < 0) {
        const Entry entry = find_entry(p, d, done, last_entry);
        if (entry.a < 0) return to < 0;
        last_entry = entry.s;
        at = on_edge(entry.a, entry.b, entry.t);
      }
      const End end = walk(at, q, to);
      if (end != End::LeftMesh) return end == End::Reached;
      // The cut may have snapped to a vertex a little farther on.
      done = d.dot(mesh_.position(at) - p) / squared - snap_ / d.norm();
      at = -1;
    }
  }

  /// Returns the first border edge at which the line p + s d, seen along the normal of the triangle
  /// at the edge, enters the mesh; s in [from, 1] and above `after`.
  Entry find_entry(const Vector3<Scalar>& p, const Vector3<Scalar>& d, const Scalar& from,
                   const Scalar& after) const {
    Entry best;
    for (std::size_t t = 0; t < mesh_.triangles().size(); ++t) {
      const std::array<int, 3>& corner = mesh_.triangles()[t];
      const Vector3<Scalar> side = d.cross(triangle_normal(static_cast<int>(t)));
      for (std::size_t i = 0; i < 3; ++i) {
        Entry entry;
        entry.a = corner[i];
        entry.b = corner[(i + 1) % 3];
        const Vector3<Scalar>&a = mesh_.position(entry.a), &b = mesh_.position(entry.b),
              &c = mesh_.position(corner[(i + 2) % 3]);
        const Scalar fa = side.dot(a - p), fb = side.dot(b - p);
        if ((fa < Scalar(0)) == (fb < Scalar(0)) || !mesh_.is_border(entry.a, entry.b)) continue;
        entry.t = fa / (fa - fb);
        const Vector3<Scalar> place = a + entry.t * (b - a);
        entry.s = d.dot(place - p) / d.squaredNorm();
        const Vector3<Scalar> edge = b - a,
                              inward = (c - a) - edge * (edge.dot(c - a) / edge.squaredNorm());
        const bool enters = Scalar(0) < d.dot(inward);
        const Scalar height = (place - p - entry.s * d).squaredNorm();
        if (!enters || entry.s < from || entry.s < Scalar(0) || Scalar(1) < entry.s ||
            !(after < entry.s) || reach_ * reach_ < height)
          continue;
        if (entry.s < best.s) best = entry;
      }
    }
    return best;
  }

  /// Walks from vertex `at` towards q, to the vertex `to` if that is not -1, and marks the edges.
  /// Leaves the last vertex in `at`.
  End walk(int& at, const Vector3<Scalar>& q, int to) {
    std::vector<int> visited{at};
    const std::size_t most = 4 * mesh_.triangles().size() + 64;
    while (at != to) {
      if (visited.size() > most) return End::Stuck;
      if (to >= 0 && mesh_.has_edge(at, to)) {
        mesh_.mark(at, to);
        at = to;
        break;
      }
      const Vector3<Scalar> d = (to >= 0 ? mesh_.position(to) : q) - mesh_.position(at);
      bool past = false;
      const int next = step(at, d, past);
      if (past) return End::Stuck;
      if (next < 0) return to < 0 || border_vertex(at) ? End::LeftMesh : End::Stuck;
      if (std::find(visited.begin(), visited.end(), next) != visited.end()) return End::Stuck;
      mesh_.mark(at, next);
      visited.push_back(next);
      at = next;
    }
    return End::Reached;
  }

  /// Returns the next vertex from `at` along d, a neighbour: one that is there or a new one. -1:
  /// there is no triangle ahead. `past`: the next one lies beyond d.
  int step(int at, const Vector3<Scalar>& d, bool& past) {
    const Vector3<Scalar> x = mesh_.position(at);
    Vector3<Scalar> normal = Vector3<Scalar>::Zero();
    for (const int t : mesh_.around(at)) normal += triangle_normal(t);
    const Vector3<Scalar> side = d.cross(normal);
    Scalar best = Scalar(0), place = Scalar(0);  // cosine of the angle to d; t on the edge
    int a = -1, b = -1;
    const auto consider = [&](int u, int v, const Scalar& t) {
      const Vector3<Scalar> to = (Scalar(1) - t) * mesh_.position(u) + t * mesh_.position(v) - x;
      const Scalar ahead = d.dot(to), length = to.norm();
      if (!(Scalar(0) < ahead) || !(best * length < ahead)) return;
      best = ahead / length;
      a = u;
      b = v;
      place = t;
    };
    for (const int t : mesh_.around(at)) {
      const std::array<int, 3>& corner = mesh_.triangles()[static_cast<std::size_t>(t)];
      const std::size_t i = corner[0] == at ? 0 : (corner[1] == at ? 1 : 2);
      const int u = corner[(i + 1) % 3], v = corner[(i + 2) % 3];
      const Scalar fu = side.dot(mesh_.position(u) - x), fv = side.dot(mesh_.position(v) - x);
      if ((fu < Scalar(0)) != (fv < Scalar(0))) consider(u, v, fu / (fu - fv));
    }
    if (a < 0) follow_border(at, side, consider);
    if (a < 0) return -1;
    const Scalar ahead =
        d.dot((Scalar(1) - place) * mesh_.position(a) + place * mesh_.position(b) - x);
    past = d.squaredNorm() + snap_ * d.norm() < ahead;
    return past ? -1 : on_edge(a, b, place);
  }

  /// Considers the neighbours within the snap distance of the plane, for a cut along the border.
  template <class Consider>
  void follow_border(int at, const Vector3<Scalar>& side, const Consider& consider) const {
    const Scalar limit = snap_ * side.norm();
    for (const int t : mesh_.around(at)) {
      for (const int v : mesh_.triangles()[static_cast<std::size_t>(t)]) {
        if (v == at) continue;
        const Scalar f = side.dot(mesh_.position(v) - mesh_.position(at));
        if (f < limit && Scalar(0) - limit < f) consider(v, v, Scalar(0));
      }
    }
  }

  MeshEditor<Scalar>& mesh_;
  Vector3<Scalar> low_ = Vector3<Scalar>::Zero(), high_ = low_;
  Scalar snap_ = Scalar(0), reach_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
