#pragma once

// The held vertices of a set of grips, in one order that everything in the planner shares: grip by
// grip, ascending within a grip. Slot j of that order has the raw inputs 3j .. 3j+2.

#include <cmath>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The order of the held vertices.
template <RealScalar Scalar>
class HeldVertices {
 public:
  /// Adds a grip that holds `vertices` (ascending). Allocates.
  void add_grip(const std::vector<int>& vertices) {
    for (int v : vertices) {
      vertices_.push_back(v);
      grip_of_.push_back(grip_begin_.size() - 1);
    }
    grip_begin_.push_back(vertices_.size());
  }

  /// Number of grips.
  std::size_t grip_count() const { return grip_begin_.size() - 1; }
  /// The held vertices, grip by grip.
  const std::vector<int>& vertices() const { return vertices_; }
  /// First slot of grip `g`. The slots of grip g end before `grip_begin(g + 1)`.
  std::size_t grip_begin(std::size_t g) const { return grip_begin_[g]; }
  /// Number of vertices of grip `g`.
  std::size_t grip_size(std::size_t g) const { return grip_begin_[g + 1] - grip_begin_[g]; }
  /// Returns the slot of vertex `v` in grip `g`, which holds it.
  std::size_t slot(std::size_t g, int v) const {
    std::size_t slot = grip_begin_[g];
    while (vertices_[slot] != v) ++slot;
    return slot;
  }

  /// Returns the centroid of grip `g` at vertex positions `x` (3×n, m).
  Vector3<Scalar> centroid(const PointsView<Scalar>& x, std::size_t g) const {
    Vector3<Scalar> sum = Vector3<Scalar>::Zero();
    for (std::size_t j = grip_begin_[g]; j < grip_begin_[g + 1]; ++j) sum += x.col(vertices_[j]);
    return sum / Scalar(static_cast<double>(grip_size(g)));
  }

  /// Returns 1/(number of vertices) of the grip that slot `slot` belongs to.
  Scalar vertex_share(Index slot) const {
    const std::size_t g = grip_of_[static_cast<std::size_t>(slot)];
    return Scalar(1) / Scalar(static_cast<double>(grip_size(g)));
  }

  /// Returns the largest distance of a vertex of grip `g` from the grip's centroid, m.
  Scalar radius(const PointsView<Scalar>& x, std::size_t g) const {
    using std::sqrt;
    const Vector3<Scalar> c = centroid(x, g);
    Scalar largest = Scalar(0);
    for (std::size_t j = grip_begin_[g]; j < grip_begin_[g + 1]; ++j) {
      const Scalar distance = (x.col(vertices_[j]) - c).squaredNorm();
      if (largest < distance) largest = distance;
    }
    return sqrt(largest);
  }

 private:
  std::vector<int> vertices_;
  std::vector<std::size_t> grip_of_, grip_begin_{0};
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
