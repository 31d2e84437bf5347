#pragma once

// Sheets in layers, for tests of contact of sheets with themselves.

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "clothctl/core/types.hpp"
#include "support/meshes.hpp"

namespace clothctl_test {

/// Returns a flat n×n sheet of `size` m at z = 0, with alternating diagonals.
inline PlainMesh layer(int n, double size, double height = 0) {
  PlainMesh mesh{clothctl::Points<double>(3, n * n), {}};
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < n; ++c) {
      mesh.positions.col(r * n + c) << size * c / (n - 1), size * r / (n - 1), height;
      if (r + 1 == n || c + 1 == n) continue;
      const int a = r * n + c;
      if ((r + c) % 2 == 0) {
        mesh.triangles.push_back({a, a + 1, a + n + 1});
        mesh.triangles.push_back({a, a + n + 1, a + n});
      } else {
        mesh.triangles.push_back({a, a + 1, a + n});
        mesh.triangles.push_back({a + 1, a + n + 1, a + n});
      }
    }
  }
  return mesh;
}

/// Returns two meshes as one.
inline PlainMesh together(const PlainMesh& p, const PlainMesh& q) {
  PlainMesh out{clothctl::Points<double>(3, p.positions.cols() + q.positions.cols()), p.triangles};
  out.positions << p.positions, q.positions;
  const int shift = static_cast<int>(p.positions.cols());
  for (const auto& t : q.triangles)
    out.triangles.push_back({t[0] + shift, t[1] + shift, t[2] + shift});
  return out;
}

/// Returns a length u of a strip of length `size` that is folded in the middle with the distance
/// `gap` between its layers, as its place (along, up).
inline std::array<double, 2> fold_strip(double u, double size, double gap) {
  const double radius = 0.5 * gap, bend = std::acos(-1.0) * radius, start = 0.5 * (size - bend);
  const double s = u - start;
  if (s < 0) return {u, 0};
  if (s < bend) return {start + radius * std::sin(s / radius), radius * (1 - std::cos(s / radius))};
  return {start - (s - bend), gap};
}

/// Returns the positions of a flat sheet of `size` m when it is folded in two, then in four, with
/// layers `gap` apart.
inline clothctl::Points<double> fold_in_four(const clothctl::Points<double>& flat, double size,
                                             double gap, bool twice = true) {
  clothctl::Points<double> out = flat;
  for (clothctl::Index i = 0; i < flat.cols(); ++i) {
    const auto [x, up] = fold_strip(flat(0, i), size, gap);
    out.col(i) << x, flat(1, i), up;
    if (!twice) continue;
    // The stack of two layers is bent about a line above it: the outer layer has the larger radius.
    const double inner = 1.5 * gap - up, bend = std::acos(-1.0) * 1.5 * gap;
    const double start = 0.5 * (size - bend), s = flat(1, i) - start;
    const double angle = s < 0 ? 0 : std::acos(-1.0) * std::min(1.0, s / bend);
    const double rest = s < 0 ? s : std::max(0.0, s - bend);
    const double along = s < 0 ? rest : -rest * (angle > 3 ? 1 : 0);
    out(1, i) = start + along + inner * std::sin(angle);
    out(2, i) = 1.5 * gap - inner * std::cos(angle);
  }
  return out;
}

}  // namespace clothctl_test
