#include "clothctl/cloth/detail/factor_changes.hpp"

#include <algorithm>
#include <random>
#include <vector>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Change = detail::FactorChange<double>;

/// Σ GᵀD G over all vertices.
MatrixX<double> spread(const Change& c, Index vertices) {
  MatrixX<double> G = MatrixX<double>::Zero(3, 3 * vertices);
  for (std::size_t k = 0; k < 3 && c.vertex[k] >= 0; ++k)
    G.middleCols<3>(3 * c.vertex[k]) +=
        c.weight[static_cast<Index>(k)] * Matrix3<double>::Identity();
  return G.transpose() * c.block * G;
}

MatrixX<double> positive(std::mt19937& random, Index n) {
  std::normal_distribution<double> normal;
  const MatrixX<double> half = MatrixX<double>::NullaryExpr(n, n, [&] { return normal(random); });
  return half * half.transpose() + MatrixX<double>::Identity(n, n);
}

}  // namespace

TEST_CASE("changes of a matrix give the inverse between points of the changed one", "[cloth]") {
  std::mt19937 random(7);
  const Index vertices = 8;
  const MatrixX<double> without = positive(random, 3 * vertices);
  std::vector<Change> changes(4);
  changes[0].vertex = {2, -1, -1};
  changes[0].weight = Vector3<double>(1, 0, 0);
  changes[1].vertex = {5, 0, -1};
  changes[1].weight = Vector3<double>(0.3, 0.7, 0);
  changes[2].vertex = {5, 6, 7};
  changes[2].weight = Vector3<double>(0.2, 0.5, 0.3);
  changes[3].vertex = {2, 6, -1};
  changes[3].weight = Vector3<double>(-0.5, 1.5, 0);  // outside its edge
  MatrixX<double> before = without, after = without;
  for (std::size_t i = 0; i < changes.size(); ++i) {
    // Contacts 0 and 2 open, 1 and 3 close; 3 has no friction: its block has rank one.
    changes[i].block = 400 * positive(random, 3);
    if (i == 3)
      changes[i].block = 400 * Vector3<double>(1, 2, 3) * Vector3<double>(1, 2, 3).transpose();
    const bool opens = i % 2 == 0;
    (opens ? before : after) += spread(changes[i], vertices);
    if (opens) changes[i].block *= -1;
  }
  // Of the vertices, those of the changes and vertex 3, in another order.
  const std::vector<int> points{3, 7, 6, 5, 2, 0};
  const auto place = [&](int vertex) {
    return std::find(points.begin(), points.end(), vertex) - points.begin();
  };
  const auto between = [&](const MatrixX<double>& A) {
    const MatrixX<double> inverse = A.inverse();
    MatrixX<double> out(18, 18);
    for (Index i = 0; i < 6; ++i) {
      for (Index j = 0; j < 6; ++j)
        out.block<3, 3>(3 * i, 3 * j) = inverse.block<3, 3>(
            3 * points[static_cast<std::size_t>(i)], 3 * points[static_cast<std::size_t>(j)]);
    }
    return out;
  };
  MatrixX<double> W = between(before);
  const MatrixX<double> expected = between(after);
  REQUIRE((W - expected).norm() > 1e-2 * expected.norm());
  Points<double> rows = Points<double>::Zero(3, 18);
  const long before_changes = clothctl_test::allocations();
  bool added = true;
  for (const Change& c : changes) added = detail::add_change<double>(c, place, W, rows) && added;
  const long allocated = clothctl_test::allocations() - before_changes;
  REQUIRE(added);
  if (clothctl_test::allocation_counting_works()) CHECK(allocated == 0);
  CHECK((W - expected).norm() < 1e-10 * expected.norm());
}

TEST_CASE("a change that takes away more than there is, is refused where that is singular",
          "[cloth]") {
  MatrixX<double> W = Matrix3<double>::Identity();
  Change c;
  c.vertex = {0, -1, -1};
  c.weight = Vector3<double>(1, 0, 0);
  c.block = -Matrix3<double>::Identity();
  Points<double> rows = Points<double>::Zero(3, 3);
  CHECK_FALSE(detail::add_change<double>(
      c, [](int v) { return Index(v); }, W, rows));
  CHECK(W == MatrixX<double>(Matrix3<double>::Identity()));
}

TEST_CASE("a list of changes is full after as many as it has room for", "[cloth]") {
  detail::FactorChanges<double> list;
  CHECK(list.list().empty());
  for (std::size_t i = 0; i < list.kMost; ++i) {
    CHECK_FALSE(list.full());
    list.add(Change());
  }
  CHECK(list.full());
  CHECK(list.list().size() == list.kMost);
  list.clear();
  CHECK(list.list().empty());
}
