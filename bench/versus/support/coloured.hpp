#pragma once

// The order of edges in which sweeps one edge after the other are fast.

#include <algorithm>
#include <cstddef>
#include <vector>

namespace versus {

/// Sorts edges (with ends a and b) into groups without a common vertex, by first fit.
template <class Edge>
std::vector<Edge> coloured(const std::vector<Edge>& edges) {
  std::vector<std::vector<Edge>> groups;
  std::vector<std::vector<bool>> used;
  std::size_t vertices = 0;
  for (const Edge& e : edges)
    vertices = std::max(vertices, static_cast<std::size_t>(std::max(e.a, e.b)) + 1);
  for (const Edge& e : edges) {
    const auto a = static_cast<std::size_t>(e.a), b = static_cast<std::size_t>(e.b);
    std::size_t g = 0;
    while (g < groups.size() && (used[g][a] || used[g][b])) ++g;
    if (g == groups.size()) {
      groups.emplace_back();
      used.emplace_back(vertices, false);
    }
    groups[g].push_back(e);
    used[g][a] = used[g][b] = true;
  }
  std::vector<Edge> out;
  for (const std::vector<Edge>& group : groups) out.insert(out.end(), group.begin(), group.end());
  return out;
}

}  // namespace versus
