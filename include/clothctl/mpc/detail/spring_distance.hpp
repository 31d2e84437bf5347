#pragma once

// How far two points of a sheet can be apart without stretch: the shortest way along its springs
// (Dijkstra). Springs that only resist bending do not hold vertices together.

#include <functional>
#include <queue>
#include <utility>
#include <vector>

#include "clothctl/network/spring_network.hpp"
#include "clothctl/prediction/features.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The ways along the springs of a network.
template <RealScalar Scalar>
class SpringDistance {
 public:
  /// Takes the springs of a network with good indices. Allocates.
  explicit SpringDistance(const SpringNetwork<Scalar>& network)
      : ways_(static_cast<std::size_t>(network.vertex_count())) {
    for (const Spring<Scalar>& spring : network.springs) {
      if (spring.kind == SpringKind::Bend) continue;
      ways_[static_cast<std::size_t>(spring.a)].push_back({spring.b, spring.rest_length});
      ways_[static_cast<std::size_t>(spring.b)].push_back({spring.a, spring.rest_length});
    }
  }

  /// Returns the lengths of the shortest ways from `source` to all vertices, m; infinite where
  /// there is none. Allocates. Complexity: O(springs · log springs).
  std::vector<Scalar> from(int source) const {
    std::vector<Scalar> length(ways_.size(), scalar_traits<Scalar>::infinity());
    const auto later = [](const Way& a, const Way& b) { return b.length < a.length; };
    std::priority_queue<Way, std::vector<Way>, decltype(later)> open(later);
    length[static_cast<std::size_t>(source)] = Scalar(0);
    open.push({source, Scalar(0)});
    while (!open.empty()) {
      const Way way = open.top();
      open.pop();
      if (length[static_cast<std::size_t>(way.vertex)] < way.length) continue;
      for (const Way& next : ways_[static_cast<std::size_t>(way.vertex)]) {
        const Scalar there = way.length + next.length;
        if (!(there < length[static_cast<std::size_t>(next.vertex)])) continue;
        length[static_cast<std::size_t>(next.vertex)] = there;
        open.push({next.vertex, there});
      }
    }
    return length;
  }

  /// Returns the longest distance without stretch of two means of vertices (weights that are not
  /// negative and add up to 1), m: the mean of those of their vertices. Infinite for other sums.
  /// Allocates.
  Scalar between(const PointFeatures<Scalar>& points, Index i, Index j) const {
    if (!is_mean(points, i) || !is_mean(points, j)) return scalar_traits<Scalar>::infinity();
    Scalar sum = Scalar(0);
    points.for_each_term(i, [&](int a, const Scalar& w) {
      const std::vector<Scalar> length = from(a);
      points.for_each_term(j, [&](int b, const Scalar& u) {
        if (Scalar(0) < w * u) sum += w * u * length[static_cast<std::size_t>(b)];
      });
    });
    return sum;
  }

 private:
  struct Way {
    int vertex;
    Scalar length;
  };

  static bool is_mean(const PointFeatures<Scalar>& points, Index i) {
    Scalar sum = Scalar(0);
    bool positive = true;
    points.for_each_term(i, [&](int, const Scalar& w) {
      sum += w;
      positive = positive && !(w < Scalar(0));
    });
    return positive && (sum - Scalar(1)) * (sum - Scalar(1)) < Scalar(1e-6);
  }

  std::vector<std::vector<Way>> ways_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
