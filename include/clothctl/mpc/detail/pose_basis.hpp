#pragma once

// The unknowns of a planner that plans grip poses: the velocity v of each grip's centroid c and,
// where it holds several vertices, its angular velocity ω,
//
//   r_j = v + ω × (x_j - c),     r: velocities of the held vertices (3 for each slot)

#include <cmath>
#include <utility>
#include <vector>

#include "clothctl/math/rotation.hpp"
#include "clothctl/mpc/detail/held_vertices.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Lays out and fills the columns of B for grip poses.
template <RealScalar Scalar>
class PoseBasis {
 public:
  /// Returns the first column of grip `g` and its number of columns: three for a grip of one
  /// vertex, six for a larger one.
  static std::pair<Index, Index> columns(const HeldVertices<Scalar>& held, std::size_t g) {
    Index first = 0;
    for (std::size_t i = 0; i < g; ++i) first += turns(held, i) ? 6 : 3;
    return {first, turns(held, g) ? 6 : 3};
  }

  /// Appends the row ranges of the columns of all grips. Allocates.
  static void reserve(const HeldVertices<Scalar>& held,
                      std::vector<std::pair<Index, Index>>& columns) {
    for (std::size_t g = 0; g < held.grip_count(); ++g) {
      const Index first = 3 * static_cast<Index>(held.grip_begin(g));
      const Index rows = 3 * static_cast<Index>(held.grip_size(g));
      for (int i = 0; i < (turns(held, g) ? 6 : 3); ++i) columns.push_back({first, rows});
    }
  }

  /// Fills B at positions `x` (3×n). Never allocates.
  static void update(const HeldVertices<Scalar>& held, const PointsView<Scalar>& x,
                     MatrixX<Scalar>& B) {
    Index column = 0;
    for (std::size_t g = 0; g < held.grip_count(); ++g) {
      const Vector3<Scalar> c = held.centroid(x, g);
      for (std::size_t j = held.grip_begin(g); j < held.grip_begin(g + 1); ++j) {
        const Index row = 3 * static_cast<Index>(j);
        B.template block<3, 3>(row, column).setIdentity();
        if (!turns(held, g)) continue;
        const Vector3<Scalar> arm = c - x.col(held.vertices()[j]);
        B.template block<3, 3>(row, column + 3) = cross_matrix<Scalar>(arm);  // ω × (x - c)
      }
      column += turns(held, g) ? 6 : 3;
    }
  }

  /// Writes the upper bounds of one frame's unknowns; the lower ones are their negatives. Each
  /// centroid moves at most `max_step` (m) along each axis in `dt` (s), and turning moves no held
  /// vertex further along any axis: |ω×r|_i <= √2 |ω|_∞ |r|. Never allocates.
  static void upper_bounds(const HeldVertices<Scalar>& held, const PointsView<Scalar>& x,
                           Scalar max_step, Scalar dt, Eigen::Ref<VectorX<Scalar>> upper) {
    using std::sqrt;
    Index column = 0;
    for (std::size_t g = 0; g < held.grip_count(); ++g) {
      upper.segment(column, 3).setConstant(max_step / dt);
      column += 3;
      if (!turns(held, g)) continue;
      const Scalar size = held.radius(x, g);
      upper.segment(column, 3).setConstant(
          Scalar(0) < size ? max_step / (dt * size * sqrt(Scalar(2))) : Scalar(0));
      column += 3;
    }
  }

 private:
  static bool turns(const HeldVertices<Scalar>& held, std::size_t g) {
    return held.grip_size(g) > 1;
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
