#pragma once

// The triangles of a box, for a page.

#include "clothctl/core/types.hpp"

namespace program {

/// Returns the corners of its twelve triangles (3×36, m). `half`: half its sides, m.
inline clothctl::Points<double> box_triangles(const clothctl::Vector3<double>& centre,
                                              const clothctl::Vector3<double>& half) {
  const int faces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                           {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  clothctl::Points<double> out(3, 36);
  clothctl::Index column = 0;
  for (const auto& f : faces) {
    for (const int k : {0, 1, 2, 0, 2, 3}) {
      const clothctl::Vector3<double> side((f[k] & 1) != 0 ? 1 : -1, (f[k] & 2) != 0 ? 1 : -1,
                                           (f[k] & 4) != 0 ? 1 : -1);
      out.col(column++) = centre + half.cwiseProduct(side);
    }
  }
  return out;
}

}  // namespace program
