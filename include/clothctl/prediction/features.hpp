#pragma once

// Features are points that are fixed weighted sums of vertices, y_i = Σ_j w_ij x_j: corners,
// centroids, any linear function.

#include <cassert>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/prediction.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/mesh/remap.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A list of weighted vertex sums; models FeatureMap.
template <RealScalar Scalar>
class PointFeatures {
 public:
  /// One term of a sum.
  struct Term {
    /// The vertex.
    int vertex;
    /// Its weight.
    Scalar weight;
  };

  /// Adds a vertex as a feature. Allocates.
  void add_point(int vertex) { add_sum({Term{vertex, Scalar(1)}}); }
  /// Adds the mean of `vertices` as a feature. Allocates.
  void add_centroid(const std::vector<int>& vertices) {
    std::vector<Term> terms;
    terms.reserve(vertices.size());
    const Scalar share = Scalar(1) / Scalar(static_cast<double>(vertices.size()));
    for (int v : vertices) terms.push_back({v, share});
    add_sum(std::move(terms));
  }
  /// Adds a weighted sum as a feature. Allocates.
  void add_sum(std::vector<Term> terms) {
    terms_.insert(terms_.end(), terms.begin(), terms.end());
    begin_.push_back(terms_.size());
  }

  /// Adds all features of another map. Allocates.
  template <FeatureMap<Scalar> Map>
  void add_map(const Map& map) {
    for (Index i = 0; i < feature_traits<Map>::count(map); ++i) {
      std::vector<Term> terms;
      feature_traits<Map>::for_each_term(map, i, [&](int vertex, const Scalar& weight) {
        terms.push_back({vertex, weight});
      });
      add_sum(std::move(terms));
    }
  }

  /// Returns the number of features.
  Index count() const { return static_cast<Index>(begin_.size()) - 1; }
  /// Calls `function(vertex, weight)` for each term of a feature.
  template <class Function>
  void for_each_term(Index feature, Function&& function) const {
    const std::size_t i = static_cast<std::size_t>(feature);
    for (std::size_t t = begin_[i]; t < begin_[i + 1]; ++t)
      function(terms_[t].vertex, terms_[t].weight);
  }

 private:
  std::vector<Term> terms_;
  std::vector<std::size_t> begin_{0};
};

/// Returns an empty string, or a line that names the first feature with a term off a mesh of
/// `vertex_count` vertices or with a weight that is not finite. Allocates.
template <RealScalar Scalar, FeatureMap<Scalar> Map>
std::string validate_features(const Map& map, Index vertex_count) {
  const Index count = feature_traits<Map>::count(map);
  if (count < 1) return "there are no features";
  std::string problem;
  for (Index i = 0; i < count; ++i) {
    Index terms = 0;
    feature_traits<Map>::for_each_term(map, i, [&](int vertex, const Scalar& weight) {
      ++terms;
      if (!problem.empty()) return;
      if (vertex < 0 || vertex >= vertex_count) {
        problem = "feature " + std::to_string(i) + " uses vertex " + std::to_string(vertex) +
                  ", off a mesh of " + std::to_string(vertex_count) + " vertices";
      } else if (!is_finite(weight)) {
        problem = "feature " + std::to_string(i) + " has a non-finite weight at vertex " +
                  std::to_string(vertex);
      }
    });
    if (problem.empty() && terms == 0)
      problem = "feature " + std::to_string(i) + " has no vertices";
  }
  return problem;
}

/// Writes the features at vertex positions `x` (3×n, m) to `out` (3×count, m). Never allocates.
template <RealScalar Scalar, FeatureMap<Scalar> Map>
void evaluate_features(const Map& map, const PointsView<Scalar>& x, Points<Scalar>& out) {
  for (Index i = 0; i < feature_traits<Map>::count(map); ++i) {
    Vector3<Scalar> sum = Vector3<Scalar>::Zero();
    feature_traits<Map>::for_each_term(
        map, i, [&](int vertex, const Scalar& weight) { sum += weight * x.col(vertex); });
    out.col(i) = sum;
  }
}

/// Returns the features of a sheet after a change of its mesh: every vertex continues as its first
/// copy. Allocates. Fails when: a feature is off the old mesh (assert).
template <RealScalar Scalar, FeatureMap<Scalar> Map>
PointFeatures<Scalar> remap_features(const Map& map, const Remap<Scalar>& remap) {
  PointFeatures<Scalar> out;
  for (Index i = 0; i < feature_traits<Map>::count(map); ++i) {
    std::vector<typename PointFeatures<Scalar>::Term> terms;
    feature_traits<Map>::for_each_term(map, i, [&](int vertex, const Scalar& weight) {
      assert(vertex >= 0 && vertex < remap.old_vertex_count());
      terms.push_back({remap.first_copy(vertex), weight});
    });
    out.add_sum(std::move(terms));
  }
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
