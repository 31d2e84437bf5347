#pragma once

// How far two points of a sheet can be apart without stretch: the shortest way along its springs
// (Dijkstra). Springs that only resist bending do not hold vertices together.

#include <algorithm>
#include <cstddef>
#include <vector>

#include "clothctl/network/spring_network.hpp"
#include "clothctl/network/surface_distance.hpp"
#include "clothctl/prediction/features.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The ways along the springs of a network.
template <RealScalar Scalar>
class SpringDistance {
 public:
  /// Takes the springs of a network with good indices. Allocates.
  explicit SpringDistance(const SpringNetwork<Scalar>& network)
      : count_(static_cast<std::size_t>(network.vertex_count())),
        ways_(static_cast<int>(network.vertex_count()), edges(network), {}) {}

  /// Returns the lengths of the shortest ways from a mean of vertices (weights that are not
  /// negative and add up to 1) to all vertices, m: the mean of those of its vertices; infinite
  /// where there is none, and for other sums. Allocates. Complexity: O(springs · log springs) for
  /// each vertex of the mean.
  std::vector<Scalar> from(const PointFeatures<Scalar>& points, Index i) {
    std::vector<Scalar> mean(count_, scalar_traits<Scalar>::infinity()), reached(count_, Scalar(0));
    if (!is_mean(points, i)) return mean;
    std::fill(mean.begin(), mean.end(), Scalar(0));
    points.for_each_term(i, [&](int a, const Scalar& w) {
      if (!(Scalar(0) < w)) return;
      ways_.spread(a, scalar_traits<Scalar>::infinity(), [&](int b, const Scalar& length) {
        mean[static_cast<std::size_t>(b)] += w * length;
        reached[static_cast<std::size_t>(b)] += w;
      });
    });
    for (std::size_t b = 0; b < count_; ++b) {
      if (reached[b] < Scalar(1) - Scalar(2 * kRounding))
        mean[b] = scalar_traits<Scalar>::infinity();
    }
    return mean;
  }

  /// Returns the mean of such lengths over the vertices of a mean: an upper bound of the distance
  /// of both means without stretch, m. Infinite for other sums. Never allocates.
  static Scalar to(const std::vector<Scalar>& lengths, const PointFeatures<Scalar>& points,
                   Index j) {
    if (!is_mean(points, j)) return scalar_traits<Scalar>::infinity();
    Scalar sum = Scalar(0);
    points.for_each_term(j, [&](int b, const Scalar& w) {
      if (Scalar(0) < w) sum += w * lengths[static_cast<std::size_t>(b)];
    });
    return sum;
  }

 private:
  static constexpr double kRounding = 1e-3;  // of the sum of weights

  static std::vector<SurfaceEdge<Scalar>> edges(const SpringNetwork<Scalar>& network) {
    std::vector<SurfaceEdge<Scalar>> out;
    for (const Spring<Scalar>& spring : network.springs) {
      if (spring.kind != SpringKind::Bend) out.push_back({spring.a, spring.b, spring.rest_length});
    }
    return out;
  }

  static bool is_mean(const PointFeatures<Scalar>& points, Index i) {
    Scalar sum = Scalar(0);
    bool positive = true;
    points.for_each_term(i, [&](int, const Scalar& w) {
      sum += w;
      positive = positive && !(w < Scalar(0));
    });
    return positive && Scalar(1) - Scalar(kRounding) < sum && sum < Scalar(1) + Scalar(kRounding);
  }

  std::size_t count_;
  SurfaceDistance<Scalar> ways_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
