#pragma once

// A convex polytope with its faces as polygons, and the mass, the centre and the inertia of what it
// encloses. With the faces cut into triangles (a, b, c), the tetrahedra (0, a, b, c) of the signed
// volume V = a·(b × c)/6 add up to the solid, whatever the origin:
//
//   ∫ 1 = Σ V,    ∫ x = Σ V (a + b + c)/4,    ∫ x xᵀ = Σ V/20 (a aᵀ + b bᵀ + c cᵀ + s sᵀ)
//
// with s = a + b + c, and the inertia is J = tr(C) - C with C = ∫ x xᵀ.
//
// Triangles of a hull that lie in one plane become one face: contact of faces clips polygons, and a
// diagonal of a flat face is no edge.

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "clothctl/collision/detail/direction.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// An edge from corner a to corner b. Face `left` has it in this direction, face `right` in the
/// other.
struct PolytopeEdge {
  int a, b, left, right;
};

/// Most corners of a polytope, so that queries need no memory of their own.
inline constexpr int kMostCorners = 64;

/// Corners, faces and edges. A polytope of one or two corners has no faces.
template <RealScalar Scalar>
struct Polytope {
  /// The corners, 3×n, m.
  Points<Scalar> corners;
  /// Outward unit normals n and offsets o of the faces: n·x <= o.
  Points<Scalar> normals;
  VectorX<Scalar> offsets;
  /// Face f has the corners loop[loop_start[f]] to loop[loop_start[f + 1] - 1], counter-clockwise.
  std::vector<int> loop_start, loop;
  std::vector<PolytopeEdge> edges;

  int corner_count() const { return static_cast<int>(corners.cols()); }
  int face_count() const { return static_cast<int>(normals.cols()); }
  int edge_count() const { return static_cast<int>(edges.size()); }
  int face_size(int f) const {
    const std::size_t k = static_cast<std::size_t>(f);
    return loop_start[k + 1] - loop_start[k];
  }
  /// Corner k of face f, counted around.
  int face_corner(int f, int k) const {
    const int first = loop_start[static_cast<std::size_t>(f)];
    return loop[static_cast<std::size_t>(first) + static_cast<std::size_t>(k % face_size(f))];
  }
  /// Returns the face whose normal is closest to the direction.
  int face_towards(const Vector3<Scalar>& direction) const {
    int best = 0;
    Scalar most = normals.col(0).dot(direction);
    for (int f = 1; f < face_count(); ++f) {
      const Scalar now = normals.col(f).dot(direction);
      if (most < now) {
        most = now;
        best = f;
      }
    }
    return best;
  }
};

/// Mass properties of a solid of density one.
template <RealScalar Scalar>
struct SolidMoments {
  /// m³.
  Scalar volume = Scalar(0);
  /// Centre of mass, m.
  Vector3<Scalar> centre = Vector3<Scalar>::Constant(Scalar(0));
  /// Inertia about the centre, m⁵.
  Matrix3<Scalar> inertia = Matrix3<Scalar>::Constant(Scalar(0));
};

/// Returns tr(C) - C.
template <RealScalar Scalar>
Matrix3<Scalar> inertia_of_moments(const Matrix3<Scalar>& C) {
  Matrix3<Scalar> out = -C;
  const Scalar trace = C(0, 0) + C(1, 1) + C(2, 2);
  for (int i = 0; i < 3; ++i) out(i, i) += trace;
  return out;
}

/// Returns the mass properties of a closed surface of triangles.
template <RealScalar Scalar>
SolidMoments<Scalar> solid_moments(const Points<Scalar>& x,
                                   const std::vector<std::array<int, 3>>& triangles) {
  SolidMoments<Scalar> out;
  Matrix3<Scalar> C = Matrix3<Scalar>::Constant(Scalar(0));
  const Vector3<Scalar> origin = x.col(0);  // near the solid, so that little cancels
  for (const std::array<int, 3>& t : triangles) {
    const Vector3<Scalar> a = x.col(t[0]) - origin, b = x.col(t[1]) - origin,
                          c = x.col(t[2]) - origin, s = a + b + c;
    const Scalar V = a.dot(b.cross(c)) / Scalar(6);
    out.volume += V;
    out.centre += (V / Scalar(4)) * s;
    for (const Vector3<Scalar>* v : {&a, &b, &c, &s})
      C += (V / Scalar(20)) * ((*v) * v->transpose());
  }
  out.centre /= out.volume;
  C -= out.volume * (out.centre * out.centre.transpose());
  out.centre += origin;
  out.inertia = inertia_of_moments<Scalar>(C);
  return out;
}

/// Completes the edges of a polytope with corners and loops, and the planes of its faces.
template <RealScalar Scalar>
void complete_polytope(Polytope<Scalar>& P) {
  const int faces = static_cast<int>(P.loop_start.size()) - 1;
  P.normals.setConstant(3, faces, Scalar(0));
  P.offsets.setConstant(faces, Scalar(0));
  P.edges.clear();
  for (int f = 0; f < faces; ++f) {
    // Newell's normal: twice the area vector of the polygon.
    Vector3<Scalar> area = Vector3<Scalar>::Constant(Scalar(0));
    const Vector3<Scalar> first = P.corners.col(P.face_corner(f, 0));
    for (int k = 1; k + 1 < P.face_size(f); ++k) {
      const Vector3<Scalar> u = P.corners.col(P.face_corner(f, k)) - first;
      const Vector3<Scalar> v = P.corners.col(P.face_corner(f, k + 1)) - first;
      area += u.cross(v);
    }
    const Vector3<Scalar> n = unit_or_zero<Scalar>(area);
    P.normals.col(f) = n;
    Scalar most = n.dot(first);
    for (int i = 0; i < P.corner_count(); ++i) {
      const Scalar now = n.dot(P.corners.col(i));
      if (most < now) most = now;
    }
    P.offsets[f] = most;
    for (int k = 0; k < P.face_size(f); ++k) {
      const int a = P.face_corner(f, k), b = P.face_corner(f, k + 1);
      bool known = false;
      for (PolytopeEdge& e : P.edges) {
        if (e.a == b && e.b == a) {
          e.right = f;
          known = true;
        }
      }
      if (!known) P.edges.push_back({a, b, f, f});
    }
  }
}

/// Returns a box about the origin.
template <RealScalar Scalar>
Polytope<Scalar> box_polytope(const Vector3<Scalar>& half) {
  Polytope<Scalar> P;
  P.corners.resize(3, 8);
  for (int i = 0; i < 8; ++i) {
    for (int k = 0; k < 3; ++k) P.corners(k, i) = ((i >> k) & 1) != 0 ? half[k] : Scalar(-half[k]);
  }
  P.loop_start = {0, 4, 8, 12, 16, 20, 24};
  P.loop = {0, 4, 6, 2, 1, 3, 7, 5, 0, 1, 5, 4, 2, 6, 7, 3, 0, 2, 3, 1, 4, 5, 7, 6};
  complete_polytope<Scalar>(P);
  return P;
}

/// Merges the triangles of a hull that lie in one plane to faces.
template <RealScalar Scalar>
class FaceMerger {
 public:
  FaceMerger(const Points<Scalar>& x, const std::vector<std::array<int, 3>>& triangles)
      : x_(x), triangles_(triangles), face_(triangles.size(), -1) {
    Vector3<Scalar> low = x.col(0), high = low;
    for (Index i = 1; i < x.cols(); ++i) {
      for (int k = 0; k < 3; ++k) {
        if (x(k, i) < low[k]) low[k] = x(k, i);
        if (high[k] < x(k, i)) high[k] = x(k, i);
      }
    }
    const Scalar share = Scalar(64) * scalar_traits<Scalar>::epsilon();
    tolerance_ = (share < Scalar(1e-6) ? Scalar(1e-6) : share) * length_of<Scalar>(high - low);
  }

  /// Writes the loops of the faces. The largest triangle that is left starts each face, so that
  /// slivers, whose normals are rounding, join others.
  void write(Polytope<Scalar>& P) {
    P.loop_start.assign(1, 0);
    P.loop.clear();
    for (int seed = largest(); seed >= 0; seed = largest()) {
      grow(seed);
      trace(P);
      ++faces_;
    }
  }

 private:
  Vector3<Scalar> area(int t) const {
    const std::array<int, 3>& c = triangles_[static_cast<std::size_t>(t)];
    const Vector3<Scalar> u = x_.col(c[1]) - x_.col(c[0]), v = x_.col(c[2]) - x_.col(c[0]);
    return u.cross(v);
  }
  int count() const { return static_cast<int>(triangles_.size()); }
  int largest() const {
    int best = -1;
    Scalar most(-1);
    for (int t = 0; t < count(); ++t) {
      if (face_[static_cast<std::size_t>(t)] >= 0) continue;
      const Scalar size = area(t).squaredNorm();
      if (most < size) {
        most = size;
        best = t;
      }
    }
    return best;
  }
  /// Gives the face to all triangles in the plane of the seed that hang together with it.
  void grow(int seed) {
    const Vector3<Scalar> n = unit_or_zero<Scalar>(area(seed));
    const Scalar level = n.dot(x_.col(triangles_[static_cast<std::size_t>(seed)][0]));
    face_[static_cast<std::size_t>(seed)] = faces_;
    for (bool grew = true; grew;) {
      grew = false;
      for (int t = 0; t < count(); ++t) {
        if (face_[static_cast<std::size_t>(t)] >= 0 || !touches(t)) continue;
        bool flat = true;
        for (const int c : triangles_[static_cast<std::size_t>(t)])
          flat = flat && level - tolerance_ < n.dot(x_.col(c));
        if (!flat) continue;
        face_[static_cast<std::size_t>(t)] = faces_;
        grew = true;
      }
    }
  }
  /// Whether triangle t shares an edge with the face.
  bool touches(int t) const {
    const std::array<int, 3>& c = triangles_[static_cast<std::size_t>(t)];
    for (std::size_t k = 0; k < 3; ++k) {
      if (owner(c[(k + 1) % 3], c[k]) == faces_) return true;
    }
    return false;
  }
  /// The face of the triangle with the edge from a to b, -1 if none yet.
  int owner(int a, int b) const {
    for (int t = 0; t < count(); ++t) {
      const std::array<int, 3>& c = triangles_[static_cast<std::size_t>(t)];
      for (std::size_t k = 0; k < 3; ++k) {
        if (c[k] == a && c[(k + 1) % 3] == b) return face_[static_cast<std::size_t>(t)];
      }
    }
    return -1;
  }
  /// Appends the rim of the face.
  void trace(Polytope<Scalar>& P) const {
    std::vector<int> next(static_cast<std::size_t>(x_.cols()), -1);
    int start = -1;
    for (int t = 0; t < count(); ++t) {
      if (face_[static_cast<std::size_t>(t)] != faces_) continue;
      const std::array<int, 3>& c = triangles_[static_cast<std::size_t>(t)];
      for (std::size_t k = 0; k < 3; ++k) {
        if (owner(c[(k + 1) % 3], c[k]) == faces_) continue;
        next[static_cast<std::size_t>(c[k])] = c[(k + 1) % 3];
        if (start < 0) start = c[k];
      }
    }
    int at = start;
    for (Index guard = 0; at >= 0 && guard < x_.cols(); ++guard) {
      P.loop.push_back(at);
      at = next[static_cast<std::size_t>(at)];
      if (at == start) break;
    }
    P.loop_start.push_back(static_cast<int>(P.loop.size()));
  }

  const Points<Scalar>& x_;
  const std::vector<std::array<int, 3>>& triangles_;
  std::vector<int> face_;
  Scalar tolerance_;
  int faces_ = 0;
};

/// Returns the polytope of the corners and triangles of a hull.
template <RealScalar Scalar>
Polytope<Scalar> hull_polytope(const Points<Scalar>& x,
                               const std::vector<std::array<int, 3>>& triangles) {
  Polytope<Scalar> P;
  P.corners = x;
  FaceMerger<Scalar>(x, triangles).write(P);
  complete_polytope<Scalar>(P);
  return P;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
