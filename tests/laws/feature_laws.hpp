#pragma once

// The laws that every FeatureMap must obey. Call check_feature_laws<Scalar>(map, vertex_count)
// inside a TEST_CASE.
//
//   on the mesh   every term names a vertex of the mesh and a finite weight, and
//                 validate_features finds no error
//   repeats       a feature names the same terms in the same order at each call
//   linear        φ(a x + b y) = a φ(x) + b φ(y)
//   translation   φ(x + 1 dᵀ) = φ(x) + (Σ w) d
//   memory        evaluating does not allocate

#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "clothctl/prediction/features.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// Checks the laws on a mesh of `vertex_count` vertices.
template <class Scalar, class Map>
void check_feature_laws(const Map& map, clothctl::Index vertex_count) {
  using namespace clothctl;
  using traits = feature_traits<Map>;
  static_assert(FeatureMap<Map, Scalar>);
  CHECK(validate_features<Scalar>(map, vertex_count) == "");
  const Index count = traits::count(map);
  REQUIRE(count >= 1);
  CHECK(traits::count(map) == count);

  std::vector<Scalar> sums;
  for (Index i = 0; i < count; ++i) {
    std::vector<std::pair<int, Scalar>> first, second;
    traits::for_each_term(
        map, i, [&](int vertex, const Scalar& weight) { first.emplace_back(vertex, weight); });
    traits::for_each_term(
        map, i, [&](int vertex, const Scalar& weight) { second.emplace_back(vertex, weight); });
    CHECK(!first.empty());
    CHECK(first == second);
    Scalar sum = Scalar(0);
    for (const auto& term : first) {
      CHECK((term.first >= 0 && term.first < vertex_count));
      sum += term.second;
    }
    sums.push_back(sum);
  }

  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  Points<Scalar> x(3, vertex_count), y(3, vertex_count), a(3, count), b(3, count), both(3, count);
  for (Index i = 0; i < x.size(); ++i) {
    x(i) = Scalar(uniform(random));
    y(i) = Scalar(uniform(random));
  }
  const long before = allocations();
  evaluate_features<Scalar>(map, x, a);
  const long made = allocations() - before;
  if (allocation_counting_works()) CHECK(made == 0);
  evaluate_features<Scalar>(map, y, b);
  const Scalar tolerance = Scalar(64) * scalar_traits<Scalar>::epsilon();
  const Points<Scalar> mixed = Scalar(0.75) * x + Scalar(-1.5) * y;
  evaluate_features<Scalar>(map, mixed, both);
  CHECK((both - (Scalar(0.75) * a + Scalar(-1.5) * b)).norm() <
        tolerance * (Scalar(1) + a.norm() + b.norm()));
  const Vector3<Scalar> d(Scalar(0.5), Scalar(-2), Scalar(0.25));
  const Points<Scalar> moved = x.colwise() + d;
  evaluate_features<Scalar>(map, moved, both);
  for (Index i = 0; i < count; ++i) {
    CHECK((both.col(i) - a.col(i) - sums[static_cast<std::size_t>(i)] * d).norm() <
          tolerance * (Scalar(4) + a.norm()));
  }
}

}  // namespace clothctl_test
