#pragma once

// The data of a spring model: point masses, axial springs, linear bending stencils and the
// triangles that the air pushes on. sheet_network, rope_network and solid_network make networks;
// the models MassSpring and PositionBased take them.
//
//   spring a-b   U = ½ k (|x_a - x_b| - l0)²,   damper force  d n nᵀ (v_a - v_b)  with  d = β k
//   stencil      U = ½ kb |Σ_i w_i x_i|²        w = 1,-2,1 on three vertices in a row, or the
//                                               weights of a hinge on four
//   folded hinge U = ½ kb |c K - s u × D|²      K = Σ w_i x_i,  c = cos θ0/2,  s = sin θ0/2,
//                                               D = w_3 (x_3 - x_0) - w_2 (x_2 - x_0)
//   element      U = ½ A0 ( k_warp (|f_u| - 1)² + k_weft (|f_v| - 1)² + k_shear (f_u·f_v)²
//                           + k_area (A/A0 - 1)² )    f_u, f_v columns of [x_1 - x_0, x_2 - x_0] B,
//                                               B inverse of these edges at rest in (warp, weft),
//                                               A area of the triangle, A0 at rest
//
// Symbols: x positions, v velocities, l0 rest length, k stiffness, n unit vector along the spring,
// β damping time, u unit vector from x_0 to x_1 (the edge of the hinge), θ0 rest angle.
//
// A folded hinge is a hinge whose energy is taken after each triangle was turned back by θ0/2 about
// the edge. Let m_2, m_3 be the unit vectors in the two triangles that are perpendicular to the
// edge and point to x_2 and x_3, and l the length of the edge. With triangles of their rest shape,
// K = -l (m_2 + m_3) and u × D = l u × (m_2 - m_3), so a hinge of angle θ has U = kb l² (1 - cos(θ
// - θ0)): it pulls to θ0 on the shorter way, also from beyond 180°, where a hinge passes through
// itself. At θ0 = 0 this is the flat hinge.

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How the air acts on a sheet. With both coefficients at zero, the default, there is no air.
template <RealScalar Scalar>
struct AirSettings {
  /// Density ρ, kg/m³.
  Scalar density = Scalar(1.2);
  /// Drag coefficient Cn of the motion along the normal (a plate facing the flow: between 1 and 2).
  Scalar normal_coefficient = Scalar(0);
  /// Drag coefficient Ct of the motion along the surface (smooth cloth: a few hundredths).
  Scalar tangent_coefficient = Scalar(0);

  /// Returns true when the air exerts any force.
  bool enabled() const {
    return Scalar(0) < density &&
           (Scalar(0) < normal_coefficient || Scalar(0) < tangent_coefficient);
  }

  /// Returns the same settings in another scalar.
  template <RealScalar Other>
  AirSettings<Other> cast() const {
    return {static_cast<Other>(density), static_cast<Other>(normal_coefficient),
            static_cast<Other>(tangent_coefficient)};
  }

  /// Returns an empty string when all values are good, else a line that names the first bad one.
  std::string validate() const {
    const auto bad = [](const Scalar& value) { return !is_finite(value) || value < Scalar(0); };
    const std::string sign = "is negative or not finite";
    if (bad(density)) return bad_number_line("air density", sign, density);
    if (bad(normal_coefficient))
      return bad_number_line("normal air coefficient", sign, normal_coefficient);
    if (bad(tangent_coefficient))
      return bad_number_line("tangent air coefficient", sign, tangent_coefficient);
    return {};
  }
};

/// What a spring stands for. Models that limit stretch or tear tell springs apart by it.
enum class SpringKind : unsigned char {
  /// An edge of a mesh, or a thread of a grid.
  Structural,
  /// A diagonal of a cell.
  Shear,
  /// A spring that resists bending: between vertices two edges apart.
  Bend,
  /// A seam that pulls two edges together.
  Seam
};

/// An axial spring with a parallel damper between two vertices.
template <RealScalar Scalar>
struct Spring {
  /// First vertex.
  int a = 0;
  /// Second vertex.
  int b = 0;
  /// Length at which the spring exerts no force, m.
  Scalar rest_length = Scalar(0);
  /// Stiffness k, N/m.
  Scalar stiffness = Scalar(0);
  /// Axial damping d, N s/m.
  Scalar damping = Scalar(0);
  /// What the spring stands for.
  SpringKind kind = SpringKind::Structural;
};

/// A quadratic bending element: ½ kb |Σ w_i x_i|² over three or four vertices.
template <RealScalar Scalar>
struct BendStencil {
  /// The vertices. Only the first `count` are used.
  std::array<int, 4> vertex{};
  /// The weights w of the vertices. They sum to zero, so that a translation costs no energy.
  std::array<Scalar, 4> weight{Scalar(0), Scalar(0), Scalar(0), Scalar(0)};
  /// Stiffness kb, N/m.
  Scalar stiffness = Scalar(0);
  /// Number of vertices in use, 2 to 4.
  int count = 0;
  /// tan(θ0/2) of the angle θ0 to which a hinge is folded at rest; 0: flat, 1: a right angle. Only
  /// hinges of four vertices may have one. Seen with vertex 0 below, 1 above, 2 on the left and 3
  /// on the right, a positive angle folds the triangles away from the eye:
  ///
  ///          1                    eye
  ///        / | \ .
  ///       2  |  3                0, 1           a positive angle, seen along the edge
  ///        \ | /                /    \ .
  ///          0                 2      3
  ///
  /// `set_rest_folds` (rest_folds.hpp) computes it from positions.
  Scalar rest_fold = Scalar(0);

  /// Returns true when the rest shape is not flat.
  bool is_folded() const { return Scalar(0) < rest_fold || rest_fold < Scalar(0); }

  /// Returns what is wrong with `rest_fold`, or "". Allocates.
  std::string validate_fold() const {
    if (!is_finite(rest_fold) || Scalar(1e6) < rest_fold || rest_fold < Scalar(-1e6))
      return "has a rest_fold that is not finite or above 1e6";
    if (!is_folded()) return {};
    if (count != 4) return "has a rest_fold, but not the four vertices of a hinge";
    if (!(weight[2] < Scalar(0)) || !(weight[3] < Scalar(0)))
      return "has a rest_fold, but no negative weights on vertices 2 and 3 of the hinge";
    return {};
  }
};

/// det M of a 2×2 matrix.
template <RealScalar Scalar>
Scalar element_determinant(const DenseMatrix<Scalar, 2, 2>& m) {
  return m(0, 0) * m(1, 1) - m(0, 1) * m(1, 0);
}

/// An elastic triangle. PositionBased simulates it; MassSpring does not.
template <RealScalar Scalar>
struct TriangleElement {
  /// The corners.
  std::array<int, 3> vertex{};
  /// Inverse B of the edges 0-1 and 0-2 at rest as columns of coordinates (warp, weft), 1/m. Its
  /// determinant is positive.
  DenseMatrix<Scalar, 2, 2> rest_inverse = DenseMatrix<Scalar, 2, 2>::Zero();
  /// Moduli along warp, along weft, in shear, and against a change of area, N/m.
  Scalar warp = Scalar(0), weft = Scalar(0), shear = Scalar(0), area = Scalar(0);

  /// Returns A0, m².
  Scalar rest_area() const { return Scalar(0.5) / element_determinant<Scalar>(rest_inverse); }

  /// Sets B from the edges at rest, the columns of `edges`, m. Returns false and changes nothing
  /// when they are degenerate (a corner has less than 1e-6 rad), clockwise or not finite.
  bool set_rest(const DenseMatrix<Scalar, 2, 2>& edges) {
    const Scalar twice = element_determinant<Scalar>(edges);
    if (!all_finite(edges) || !is_finite(twice)) return false;
    if (!(Scalar(1e-6) * edges.squaredNorm() < twice)) return false;
    DenseMatrix<Scalar, 2, 2> inverse;
    inverse(0, 0) = edges(1, 1) / twice;
    inverse(0, 1) = -edges(0, 1) / twice;
    inverse(1, 0) = -edges(1, 0) / twice;
    inverse(1, 1) = edges(0, 0) / twice;
    if (!all_finite(inverse)) return false;
    rest_inverse = inverse;
    return true;
  }
};

/// Masses, springs, bending stencils and triangles that share one numbering of the vertices.
template <RealScalar Scalar>
struct SpringNetwork {
  /// Undeformed vertex positions, 3×n, m.
  Points<Scalar> rest_positions;
  /// Vertex masses, n, kg.
  VectorX<Scalar> mass;
  /// Axial springs.
  std::vector<Spring<Scalar>> springs;
  /// Bending elements.
  std::vector<BendStencil<Scalar>> bends;
  /// Triangles that the air pushes on and that a viewer draws, counter-clockwise seen from their
  /// front.
  std::vector<std::array<int, 3>> triangles;
  /// Elastic triangles (triangle_elements.hpp makes them).
  std::vector<TriangleElement<Scalar>> elements;

  /// Number of vertices.
  Index vertex_count() const { return rest_positions.cols(); }

  /// Returns the segments of ropes: springs, other than those of bending, with an end on no
  /// triangle that at most two of them have. Allocates.
  std::vector<std::array<int, 2>> rope_segments() const;

  /// Returns the same network in another scalar. Allocates.
  template <RealScalar Other>
  SpringNetwork<Other> cast() const {
    SpringNetwork<Other> out;
    out.rest_positions = rest_positions.template cast<Other>();
    out.mass = mass.template cast<Other>();
    out.springs.reserve(springs.size());
    for (const Spring<Scalar>& s : springs) {
      out.springs.push_back({s.a, s.b, static_cast<Other>(s.rest_length),
                             static_cast<Other>(s.stiffness), static_cast<Other>(s.damping),
                             s.kind});
    }
    out.bends.reserve(bends.size());
    for (const BendStencil<Scalar>& b : bends) {
      BendStencil<Other> c;
      c.vertex = b.vertex;
      for (std::size_t i = 0; i < 4; ++i) c.weight[i] = static_cast<Other>(b.weight[i]);
      c.stiffness = static_cast<Other>(b.stiffness);
      c.count = b.count;
      c.rest_fold = static_cast<Other>(b.rest_fold);
      out.bends.push_back(c);
    }
    out.triangles = triangles;
    for (const TriangleElement<Scalar>& e : elements) {
      out.elements.push_back({e.vertex, e.rest_inverse.template cast<Other>(),
                              static_cast<Other>(e.warp), static_cast<Other>(e.weft),
                              static_cast<Other>(e.shear), static_cast<Other>(e.area)});
    }
    return out;
  }

  /// Returns an empty string when indices, masses and constants are good and no stencil or triangle
  /// holds a vertex twice; else a line that names the first bad item. Allocates.
  std::string validate() const {
    const Index n = vertex_count();
    const auto bad = [n](int v) { return v < 0 || v >= n; };
    const Scalar zero = Scalar(0);
    if (n == 0) return "spring network has no vertices";
    if (mass.size() != n)
      return "spring network has " + std::to_string(mass.size()) + " masses for " +
             std::to_string(n) + " vertices";
    for (Index i = 0; i < n; ++i) {
      for (Index c = 0; c < 3; ++c) {
        if (!is_finite(rest_positions(c, i)))
          return "rest position of vertex " + std::to_string(i) + " is not finite: " + "xyz"[c] +
                 " is " + number_text(rest_positions(c, i));
      }
      if (!is_finite(mass[i]) || !(zero < mass[i]))
        return bad_number_line("mass of vertex " + std::to_string(i), "is not positive", mass[i]) +
               " kg";
    }
    for (std::size_t e = 0; e < springs.size(); ++e) {
      const Spring<Scalar>& s = springs[e];
      const std::string name = "spring " + std::to_string(e);
      if (bad(s.a) || bad(s.b))
        return name + " joins vertex " + std::to_string(bad(s.a) ? s.a : s.b) + " off the mesh";
      if (s.a == s.b) return name + " joins vertex " + std::to_string(s.a) + " to itself";
      if (!is_finite(s.rest_length) || !(zero < s.rest_length))
        return bad_number_line(name, "has no positive rest length", s.rest_length) + " m";
      if (!is_finite(s.stiffness) || s.stiffness < zero)
        return bad_number_line(name, "has a negative or non-finite stiffness", s.stiffness) +
               " N/m";
      if (!is_finite(s.damping) || s.damping < zero)
        return bad_number_line(name, "has a negative or non-finite damping", s.damping) + " N s/m";
    }
    if (std::string problem = validate_bends(); !problem.empty()) return problem;
    for (std::size_t e = 0; e < triangles.size(); ++e) {
      for (int v : triangles[e]) {
        if (bad(v))
          return "triangle " + std::to_string(e) + " holds vertex " + std::to_string(v) +
                 " off the mesh";
      }
      if (const int v = repeated(triangles[e], 3); v >= 0)
        return "triangle " + std::to_string(e) + " holds vertex " + std::to_string(v) + " twice";
    }
    return validate_elements();
  }

 private:
  std::string validate_bends() const {
    for (std::size_t e = 0; e < bends.size(); ++e) {
      const BendStencil<Scalar>& s = bends[e];
      const std::string name = "bending stencil " + std::to_string(e);
      if (s.count < 2 || s.count > 4) return name + " has " + std::to_string(s.count) + " vertices";
      for (int i = 0; i < s.count; ++i) {
        const int v = s.vertex[static_cast<std::size_t>(i)];
        if (v < 0 || v >= vertex_count())
          return name + " holds vertex " + std::to_string(v) + " off the mesh";
        const Scalar& weight = s.weight[static_cast<std::size_t>(i)];
        if (!is_finite(weight)) return bad_number_line(name, "has a non-finite weight", weight);
      }
      if (!is_finite(s.stiffness) || s.stiffness < Scalar(0))
        return bad_number_line(name, "has a negative or non-finite stiffness", s.stiffness);
      if (std::string problem = s.validate_fold(); !problem.empty()) return name + " " + problem;
      if (const int v = repeated(s.vertex, static_cast<std::size_t>(s.count)); v >= 0)
        return name + " holds vertex " + std::to_string(v) + " twice";
    }
    return {};
  }

  std::string validate_elements() const {
    const auto bad = [](const Scalar& k) { return !is_finite(k) || k < Scalar(0); };
    for (std::size_t e = 0; e < elements.size(); ++e) {
      const TriangleElement<Scalar>& element = elements[e];
      const std::string name = "triangle element " + std::to_string(e);
      for (int v : element.vertex) {
        if (v < 0 || v >= vertex_count())
          return name + " holds vertex " + std::to_string(v) + " off the mesh";
      }
      if (const int v = repeated(element.vertex, 3); v >= 0)
        return name + " holds vertex " + std::to_string(v) + " twice";
      const Scalar area = element.rest_area();
      if (!all_finite(element.rest_inverse) || !is_finite(area) || !(Scalar(0) < area))
        return name + " has a degenerate or inverted rest shape";
      if (bad(element.warp)) return name + bad_stiffness("warp", element.warp);
      if (bad(element.weft)) return name + bad_stiffness("weft", element.weft);
      if (bad(element.shear)) return name + bad_stiffness("shear", element.shear);
      if (bad(element.area)) return name + bad_stiffness("area", element.area);
    }
    return {};
  }

  static std::string bad_stiffness(const std::string& kind, const Scalar& value) {
    return " has a negative or non-finite " + kind + " stiffness: " + number_text(value) + " N/m";
  }

  /// Returns the first vertex that occurs twice among the first `count` of a list, or -1.
  template <class List>
  static int repeated(const List& list, std::size_t count) {
    for (std::size_t i = 1; i < count; ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        if (list[i] == list[j]) return list[i];
      }
    }
    return -1;
  }
};

template <RealScalar Scalar>
std::vector<std::array<int, 2>> SpringNetwork<Scalar>::rope_segments() const {
  std::vector<bool> on_surface(static_cast<std::size_t>(vertex_count()), false);
  for (const std::array<int, 3>& t : triangles) {
    for (const int v : t) on_surface[static_cast<std::size_t>(v)] = true;
  }
  std::vector<int> ends(on_surface.size(), 0);
  for (const Spring<Scalar>& s : springs) {
    if (s.kind == SpringKind::Bend) continue;
    for (const int v : {s.a, s.b}) ++ends[static_cast<std::size_t>(v)];
  }
  const auto of_rope = [&](int v) {
    const std::size_t i = static_cast<std::size_t>(v);
    return !on_surface[i] && ends[i] <= 2;
  };
  std::vector<std::array<int, 2>> out;
  for (const Spring<Scalar>& s : springs) {
    if (s.kind != SpringKind::Bend && (of_rope(s.a) || of_rope(s.b))) out.push_back({s.a, s.b});
  }
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
