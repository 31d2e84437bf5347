#pragma once

// What every network must satisfy after a change of its mesh, and comparisons of networks.

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/network/sheet.hpp"
#include "support/meshes.hpp"

namespace clothctl_test {

using clothctl::BendStencil;
using clothctl::Spring;
using clothctl::SpringKind;
using clothctl::SpringNetwork;

/// Energy of the springs at `x` by definition, in double.
template <class S>
double spring_energy(const SpringNetwork<S>& network, const clothctl::Points<double>& x) {
  double energy = 0;
  for (const Spring<S>& s : network.springs) {
    const double stretched = (x.col(s.b) - x.col(s.a)).norm() - static_cast<double>(s.rest_length);
    energy += 0.5 * static_cast<double>(s.stiffness) * stretched * stretched;
  }
  return energy;
}

/// Returns "" if every spring and stencil lies on the mesh: springs on an edge or over the edge
/// between two triangles, stencils on a hinge or along two edges; and every vertex has a spring.
inline std::string orphan(const SpringNetwork<double>& network) {
  const auto topology = clothctl::make_topology(network.vertex_count(), network.triangles).value();
  std::set<std::array<int, 2>> edges, diagonals;
  for (const auto& e : topology.edges) edges.insert({e.a, e.b});
  for (const auto& h : topology.hinges)
    diagonals.insert({std::min(h.vertex[2], h.vertex[3]), std::max(h.vertex[2], h.vertex[3])});
  std::vector<bool> used(static_cast<std::size_t>(network.vertex_count()), false);
  for (std::size_t i = 0; i < network.springs.size(); ++i) {
    const Spring<double>& s = network.springs[i];
    const std::array<int, 2> key{std::min(s.a, s.b), std::max(s.a, s.b)};
    used[static_cast<std::size_t>(s.a)] = used[static_cast<std::size_t>(s.b)] = true;
    if (edges.count(key) == 0 && diagonals.count(key) == 0)
      return "spring " + std::to_string(i) + " joins " + std::to_string(s.a) + " and " +
             std::to_string(s.b);
  }
  for (std::size_t v = 0; v < used.size(); ++v) {
    if (!used[v]) return "vertex " + std::to_string(v) + " has no spring";
  }
  const auto is_edge = [&edges](int a, int b) {
    return edges.count({std::min(a, b), std::max(a, b)}) > 0;
  };
  for (std::size_t i = 0; i < network.bends.size(); ++i) {
    const auto& v = network.bends[i].vertex;
    const bool row = network.bends[i].count == 3 && is_edge(v[0], v[1]) && is_edge(v[1], v[2]);
    const bool hinge = network.bends[i].count == 4 && is_edge(v[0], v[1]) && is_edge(v[0], v[2]) &&
                       is_edge(v[1], v[2]) && is_edge(v[0], v[3]) && is_edge(v[1], v[3]);
    if (!row && !hinge) return "stencil " + std::to_string(i);
  }
  return network.validate();
}

/// Returns "" if two networks have the same masses, springs and stencils up to rounding and order;
/// `number[v]` is the vertex of `b` that is vertex v of `a`.
inline std::string difference(const SpringNetwork<double>& a, const SpringNetwork<double>& b,
                              std::vector<int> number = {}, double tolerance = 1e-9) {
  if (number.empty()) {
    for (int v = 0; v < static_cast<int>(a.vertex_count()); ++v) number.push_back(v);
  }
  const auto same = [tolerance](double p, double q, double size) {
    return std::abs(p - q) <= tolerance * std::max(size, std::abs(q));
  };
  if (a.vertex_count() != b.vertex_count()) return "vertex counts";
  for (int v = 0; v < static_cast<int>(a.vertex_count()); ++v) {
    if (!same(a.mass[v], b.mass[number[static_cast<std::size_t>(v)]], 0))
      return "mass of vertex " + std::to_string(v);
  }
  std::map<std::array<int, 2>, const Spring<double>*> springs;
  for (const auto& s : b.springs) springs[{std::min(s.a, s.b), std::max(s.a, s.b)}] = &s;
  if (a.springs.size() != b.springs.size()) return "spring counts";
  for (const auto& s : a.springs) {
    const int p = number[static_cast<std::size_t>(s.a)], q = number[static_cast<std::size_t>(s.b)];
    const auto at = springs.find({std::min(p, q), std::max(p, q)});
    const std::string name = "spring " + std::to_string(s.a) + "-" + std::to_string(s.b);
    if (at == springs.end()) return name;
    const Spring<double>& t = *at->second;
    if (!same(s.stiffness, t.stiffness, 0)) return name + " stiffness";
    if (!same(s.damping, t.damping, 0)) return name + " damping";
    if (!same(s.rest_length, t.rest_length, 0)) return name + " length";
    if (s.kind != t.kind) return name + " kind";
  }
  // A stencil by its vertices: those of the edge of a hinge first.
  const auto key = [](const BendStencil<double>& s, const std::vector<int>& map) {
    std::vector<std::pair<int, double>> terms;
    for (int i = 0; i < s.count; ++i)
      terms.push_back({map[static_cast<std::size_t>(s.vertex[static_cast<std::size_t>(i)])],
                       s.weight[static_cast<std::size_t>(i)]});
    const auto edge = terms.begin() + std::min(s.count, 2);
    std::sort(terms.begin(), s.count == 4 ? edge : terms.end());
    if (s.count == 4) std::sort(edge, terms.end());
    return terms;
  };
  std::vector<int> plain(number.size());
  for (std::size_t v = 0; v < plain.size(); ++v) plain[v] = static_cast<int>(v);
  std::map<std::vector<int>, const BendStencil<double>*> bends;
  const auto vertices = [](const std::vector<std::pair<int, double>>& terms) {
    std::vector<int> out;
    for (const auto& t : terms) out.push_back(t.first);
    return out;
  };
  for (const auto& s : b.bends) bends[vertices(key(s, plain))] = &s;
  if (a.bends.size() != b.bends.size()) return "stencil counts";
  for (const auto& s : a.bends) {
    const auto terms = key(s, number);
    const auto at = bends.find(vertices(terms));
    const std::string name = "stencil at " + std::to_string(s.vertex[0]);
    if (at == bends.end()) return name;
    const auto others = key(*at->second, plain);
    for (std::size_t i = 0; i < terms.size(); ++i) {
      if (!same(terms[i].second, others[i].second, 1)) return name + " weights";
    }
    if (!same(s.stiffness, at->second->stiffness, 0)) return name + " stiffness";
  }
  return {};
}

}  // namespace clothctl_test
