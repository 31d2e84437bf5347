#pragma once

// A soft solid as springs on the edges of a tetrahedral mesh; and append, join and weld, which
// combine networks.
//
//   edge of length l   k = E Σ V / l², summed over the volumes V of the tetrahedra at the edge
//   mass               each tetrahedron gives a quarter of ρ V to each of its vertices
//
// Derivation of k: under a uniform strain ε a spring of direction n has the energy
// ½ k l² (nᵀ ε n)². A tetrahedron contributes E V to k l² of each of its six edges, 6 E V in total.
// For evenly distributed directions the mean <n_i n_j n_k n_l> = (δ_ij δ_kl + δ_ik δ_jl + δ_il
// δ_jk)/15. The energy density is then that of an isotropic solid with the Lamé constants λ = μ =
// 6E/15, whose Young's modulus is μ(3λ+2μ)/(λ+μ) = E. Limits: springs along edges always give
// Poisson's ratio 1/4. A mesh with more edges in some directions is stiffer along those. No force
// keeps a tetrahedron from turning inside out.

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/mesh/tetrahedra.hpp"
#include "clothctl/network/rope.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Material of a solid. The defaults are a light rubber foam.
template <RealScalar Scalar>
struct SolidSettings {
  /// Mass per volume, kg/m³.
  Scalar density = Scalar(300.0);
  /// Young's modulus E, Pa.
  Scalar youngs_modulus = Scalar(2e5);
  /// Axial damping time β, s: every spring has a damper d = β k.
  Scalar damping_time = Scalar(0.002);

  /// Returns an empty string when all values are in range, else a line that names the first
  /// quantity that is not, and its value.
  std::string validate() const {
    const Scalar zero = Scalar(0);
    const std::array<std::pair<const char*, const Scalar*>, 3> quantities{
        {{"density", &density},
         {"youngs_modulus", &youngs_modulus},
         {"damping_time", &damping_time}}};
    for (std::size_t i = 0; i < quantities.size(); ++i) {
      const Scalar& value = *quantities[i].second;
      const std::string item = std::string("solid ") + quantities[i].first;
      if (!is_finite(value)) return item + " is not a finite number";
      if (i < 2 && !(zero < value)) return item + " must be positive, got " + number_text(value);
      if (value < zero) return item + " must not be negative, got " + number_text(value);
    }
    return {};
  }
};

/// Makes the spring network of a solid. Its springs have the order of `tetrahedron_edges`; its
/// triangles are the surface of the mesh. Allocates. Complexity: O(n log n). Fails when:
/// `settings.validate()` or `mesh.validate()` finds a fault.
template <RealScalar Scalar>
Result<SpringNetwork<Scalar>> solid_network(const TetMesh<Scalar>& mesh,
                                            const SolidSettings<Scalar>& settings) {
  if (std::string problem = settings.validate(); !problem.empty()) return Error{problem};
  if (std::string problem = mesh.validate(); !problem.empty()) return Error{problem};

  SpringNetwork<Scalar> network;
  network.rest_positions = mesh.positions;
  network.triangles = surface_triangles(mesh);
  network.mass = VectorX<Scalar>::Zero(mesh.positions.cols());
  const std::vector<std::array<int, 2>> edges = tetrahedron_edges(mesh);
  std::vector<Scalar> share(edges.size(), Scalar(0));
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); ++t) {
    const Scalar volume = mesh.volume(t);
    const std::array<int, 4>& corner = mesh.tetrahedra[t];
    for (std::size_t i = 0; i < 4; ++i) {
      network.mass[corner[i]] += Scalar(0.25) * settings.density * volume;
      for (std::size_t j = i + 1; j < 4; ++j) {
        const std::array<int, 2> edge{(std::min)(corner[i], corner[j]),
                                      (std::max)(corner[i], corner[j])};
        share[static_cast<std::size_t>(std::lower_bound(edges.begin(), edges.end(), edge) -
                                       edges.begin())] += volume;
      }
    }
  }
  network.springs.reserve(edges.size());
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const Vector3<Scalar> d = mesh.positions.col(edges[e][1]) - mesh.positions.col(edges[e][0]);
    const Scalar stiffness = settings.youngs_modulus * share[e] / d.squaredNorm();
    detail::add_spring(network, edges[e][0], edges[e][1], stiffness, settings.damping_time);
  }
  if (std::string problem = network.validate(); !problem.empty()) return Error{problem};
  return network;
}

/// Adds a copy of `other`, moved by `offset` (m), to `network`. No spring connects the two. Returns
/// the new index of vertex 0 of `other`; the indices of its other vertices follow. Allocates.
/// Complexity: O(size of both).
template <RealScalar Scalar>
int append(SpringNetwork<Scalar>& network, const SpringNetwork<Scalar>& other,
           const Vector3<Scalar>& offset) {
  const Index before = network.vertex_count(), added = other.vertex_count();
  const int first = static_cast<int>(before);
  Points<Scalar> positions(3, before + added);
  VectorX<Scalar> mass(before + added);
  for (Index v = 0; v < before; ++v) {
    positions.col(v) = network.rest_positions.col(v);
    mass[v] = network.mass[v];
  }
  for (Index v = 0; v < added; ++v) {
    positions.col(before + v) = other.rest_positions.col(v) + offset;
    mass[before + v] = other.mass[v];
  }
  // The counts are read first, so that a network can be appended to itself.
  const std::size_t springs = other.springs.size(), bends = other.bends.size(),
                    triangles = other.triangles.size(), elements = other.elements.size();
  for (std::size_t e = 0; e < springs; ++e) {
    Spring<Scalar> spring = other.springs[e];
    spring.a += first;
    spring.b += first;
    network.springs.push_back(spring);
  }
  for (std::size_t e = 0; e < bends; ++e) {
    BendStencil<Scalar> stencil = other.bends[e];
    for (int i = 0; i < stencil.count; ++i) stencil.vertex[static_cast<std::size_t>(i)] += first;
    network.bends.push_back(stencil);
  }
  for (std::size_t e = 0; e < triangles; ++e) {
    std::array<int, 3> triangle = other.triangles[e];
    for (int& v : triangle) v += first;
    network.triangles.push_back(triangle);
  }
  for (std::size_t e = 0; e < elements; ++e) {
    TriangleElement<Scalar> element = other.elements[e];
    for (int& v : element.vertex) v += first;
    network.elements.push_back(element);
  }
  network.rest_positions = std::move(positions);
  network.mass = std::move(mass);
  return first;
}

/// Connects two vertices at different places with a spring of `stiffness` (N/m) and axial damping
/// time `damping_time` (s). Its rest length is their distance. Returns an empty string on success.
/// Allocates. Fails when: an index is off the mesh, both are the same vertex or at the same place
/// (use `weld`), or a constant is negative or not finite. The network is then unchanged, and the
/// returned line says why.
template <RealScalar Scalar>
[[nodiscard]] std::string join(SpringNetwork<Scalar>& network, int a, int b, Scalar stiffness,
                               Scalar damping_time) {
  const Index n = network.vertex_count();
  for (int v : {a, b}) {
    if (v < 0 || v >= n)
      return "join: vertex " + std::to_string(v) + " is off the mesh of " + std::to_string(n) +
             " vertices";
  }
  if (a == b) return "join: vertex " + std::to_string(a) + " cannot be joined to itself";
  if (!is_finite(stiffness) || stiffness < Scalar(0) || !is_finite(damping_time) ||
      damping_time < Scalar(0))
    return "join: stiffness and damping time must not be negative, got " + number_text(stiffness) +
           " and " + number_text(damping_time);
  const Vector3<Scalar> d = network.rest_positions.col(b) - network.rest_positions.col(a);
  if (!(Scalar(0) < d.norm()))
    return "join: vertices " + std::to_string(a) + " and " + std::to_string(b) +
           " are at the same place; use weld";
  detail::add_spring(network, a, b, stiffness, damping_time);
  return {};
}

/// Merges two vertices. `keep` takes over the mass, springs, stencils and triangles of `gone` and
/// stays at its place; the indices of the vertices above `gone` decrease by one. Rest lengths do
/// not change, so the two vertices should be at the same place. The result is a pin joint: the
/// parts can rotate about it. Returns an empty string on success. Allocates. Complexity: O(size).
/// Fails when: an index is off the mesh, both are the same vertex, or both belong to one spring,
/// stencil or triangle. The network is then unchanged, and the returned line says why.
template <RealScalar Scalar>
[[nodiscard]] std::string weld(SpringNetwork<Scalar>& network, int keep, int gone) {
  const Index n = network.vertex_count();
  for (int v : {keep, gone}) {
    if (v < 0 || v >= n)
      return "weld: vertex " + std::to_string(v) + " is off the mesh of " + std::to_string(n) +
             " vertices";
  }
  const std::string pair =
      "weld: vertices " + std::to_string(keep) + " and " + std::to_string(gone);
  if (keep == gone) return pair + " are the same";
  const auto holds_both = [keep, gone](const int* first, const int* last) {
    return std::find(first, last, keep) != last && std::find(first, last, gone) != last;
  };
  for (std::size_t e = 0; e < network.springs.size(); ++e) {
    const std::array<int, 2> ends{network.springs[e].a, network.springs[e].b};
    if (holds_both(ends.data(), ends.data() + 2))
      return pair + " share spring " + std::to_string(e);
  }
  for (std::size_t e = 0; e < network.bends.size(); ++e) {
    const int* vertices = network.bends[e].vertex.data();
    if (holds_both(vertices, vertices + network.bends[e].count))
      return pair + " share bending stencil " + std::to_string(e);
  }
  for (std::size_t e = 0; e < network.triangles.size(); ++e) {
    const int* vertices = network.triangles[e].data();
    if (holds_both(vertices, vertices + 3)) return pair + " share triangle " + std::to_string(e);
  }
  for (std::size_t e = 0; e < network.elements.size(); ++e) {
    const int* vertices = network.elements[e].vertex.data();
    if (holds_both(vertices, vertices + 3)) return pair + " share element " + std::to_string(e);
  }

  const auto renumber = [keep, gone](int& v) {
    if (v == gone) v = keep;
    if (v > gone) --v;
  };
  network.mass[keep] += network.mass[gone];
  for (Index v = gone; v + 1 < n; ++v) {
    network.mass[v] = network.mass[v + 1];
    network.rest_positions.col(v) = network.rest_positions.col(v + 1).eval();
  }
  network.mass.conservativeResize(n - 1);
  network.rest_positions.conservativeResize(3, n - 1);
  for (Spring<Scalar>& spring : network.springs) {
    renumber(spring.a);
    renumber(spring.b);
  }
  for (BendStencil<Scalar>& stencil : network.bends) {
    for (int i = 0; i < stencil.count; ++i) renumber(stencil.vertex[static_cast<std::size_t>(i)]);
  }
  for (std::array<int, 3>& triangle : network.triangles) {
    for (int& v : triangle) renumber(v);
  }
  for (TriangleElement<Scalar>& element : network.elements) {
    for (int& v : element.vertex) renumber(v);
  }
  return {};
}

/// A ball that hangs from a rope.
template <RealScalar Scalar>
struct RopeBall {
  /// The vertices of the rope, 0 to segments from the top down, then those of the ball.
  SpringNetwork<Scalar> network;
  /// The top of the rope, which a hand holds.
  int grip = 0;
  /// The lower end of the rope, which is also the north pole of the ball.
  int joint = 0;
  /// The vertex at the ball's centre.
  int centre = 0;
  /// All vertices of the ball including the joint, ascending.
  std::vector<int> ball;
};

/// Makes a rope with a ball of `radius` (m) at its lower end, which is welded to the north pole of
/// the ball. `resolution` is that of `make_ball`. Allocates. Complexity: O(segments + resolution³
/// log resolution). Fails when: the settings of rope, ball or solid are out of range. Reference:
/// [Bai 2016], figure 10.
template <RealScalar Scalar>
Result<RopeBall<Scalar>> rope_ball_network(const RopeSettings<Scalar>& rope, Scalar radius,
                                           int resolution, const SolidSettings<Scalar>& solid) {
  Result<SpringNetwork<Scalar>> line = rope_network(rope);
  if (!line) return Error{line.error()};
  const Vector3<Scalar> origin = Vector3<Scalar>::Zero();
  const Result<TetMesh<Scalar>> mesh = make_ball<Scalar>(radius, resolution, origin);
  if (!mesh) return Error{mesh.error()};
  const Result<SpringNetwork<Scalar>> sphere = solid_network(mesh.value(), solid);
  if (!sphere) return Error{sphere.error()};

  RopeBall<Scalar> out;
  out.network = std::move(line).value();
  out.joint = rope.segments;
  const int poles = static_cast<int>(sphere->vertex_count()) - 1;
  const int first = append(out.network, sphere.value(),
                           Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(0) - rope.length - radius));
  if (std::string problem = weld(out.network, out.joint, first + poles); !problem.empty())
    return Error{problem};
  out.centre = first + poles / 2;
  for (int v = out.joint; v < static_cast<int>(out.network.vertex_count()); ++v)
    out.ball.push_back(v);
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
