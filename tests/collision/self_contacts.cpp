// Contacts of sheets with themselves against all pairs; impacts and crossings of motions; joined
// vertices, fine meshes; memory, repetition and refusals.

#include "clothctl/collision/self_contacts.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <set>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/folded_sheets.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::uniform;

namespace {

template <class S>
using Finder = SelfContactFinder<S>;

/// A crumpled sheet: a flat one with smooth and rough waves.
Points<double> crumpled(const Points<double>& flat, std::mt19937& random, double rough) {
  Points<double> x = flat;
  const double a = uniform(random, 5, 20), b = uniform(random, 5, 20);
  for (Index i = 0; i < x.cols(); ++i) {
    const double u = flat(0, i), v = flat(1, i);
    x.col(i) << 0.3 * u + 0.05 * std::sin(a * v), 0.3 * v + 0.05 * std::sin(b * u),
        0.1 * std::sin(a * u + b * v);
    for (int k = 0; k < 3; ++k) x(k, i) += uniform(random, -rough, rough);
  }
  return x;
}

/// All pairs without a common vertex that are closer than thickness + reach, by distances.
template <class S>
std::set<std::array<int, 3>> all_pairs(const Finder<S>& finder, const Points<S>& x,
                                       const Points<S>& rest, S reach) {
  std::set<std::array<int, 3>> out;
  const auto consider = [&](int edges, int a, int b, std::array<int, 4> v) {
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        if (v[i] == v[j]) return;
      }
    }
    detail::PairPoints<S> p, r;
    for (std::size_t i = 0; i < 4; ++i) {
      p[i] = x.col(v[i]);
      r[i] = rest.col(v[i]);
    }
    const S own = std::min(finder.thickness(),
                           S(0.9) * std::sqrt(detail::pair_offset<S>(edges == 1, r).square));
    if (std::sqrt(detail::pair_offset<S>(edges == 1, p).square) < own + reach)
      out.insert({edges, a, b});
  };
  const auto& edges = finder.edges();
  const auto& triangles = finder.triangles();
  for (int t = 0; t < static_cast<int>(triangles.size()); ++t) {
    const auto& c = triangles[static_cast<std::size_t>(t)];
    for (int v = 0; v < x.cols(); ++v) consider(0, v, t, {v, c[0], c[1], c[2]});
  }
  for (int e = 0; e < static_cast<int>(edges.size()); ++e) {
    for (int f = e + 1; f < static_cast<int>(edges.size()); ++f) {
      const auto &p = edges[static_cast<std::size_t>(e)], &q = edges[static_cast<std::size_t>(f)];
      consider(1, e, f, {p[0], p[1], q[0], q[1]});
    }
  }
  return out;
}

}  // namespace

TEMPLATE_TEST_CASE("near pairs are all pairs that are near", "[self_contact]", float, double) {
  using S = TestType;
  std::mt19937 random(41);
  const auto mesh = clothctl_test::layer(8, 1);
  const Points<S> rest = mesh.positions.cast<S>();
  for (int trial = 0; trial < clothctl_test::trials(6, 200, 2); ++trial) {
    // The second is thicker than the edges are long.
    const S thickness = trial % 2 == 0 ? S(0.01) : S(0.2);
    auto finder = Finder<S>::create(rest, mesh.triangles, {}, {thickness, {}}).value();
    finder.reserve(100000);
    const Points<S> x = crumpled(mesh.positions, random, 0.03).template cast<S>();
    REQUIRE(finder.update(x) == QueryStatus::Answered);
    REQUIRE(finder.find(S(0.02)) == QueryStatus::Answered);
    CHECK(finder.complete());
    const auto expected = all_pairs<S>(finder, x, rest, S(0.02));
    std::set<std::array<int, 3>> found;
    S worst(0);
    for (const SelfContact<S>& c : finder.contacts()) {
      found.insert({c.edges ? 1 : 0, c.feature[0], c.feature[1]});
      Vector3<S> way = Vector3<S>::Zero();
      for (std::size_t i = 0; i < 4; ++i) way += c.weight[i] * x.col(c.vertex[i]);
      worst = std::max(worst, (way - c.distance * c.normal).norm());
      CHECK(c.thickness <= thickness);
    }
    CHECK(found.size() == finder.contacts().size());
    CHECK(found == expected);
    CHECK(expected.size() > 50);
    CHECK(worst <= 20 * scalar_traits<S>::epsilon());
  }
}

TEST_CASE("a flat sheet does not touch itself, however fine", "[self_contact]") {
  const auto mesh = clothctl_test::layer(20, 0.1);  // cells of 5 mm
  auto finder = Finder<double>::create(mesh.positions, mesh.triangles, {}, {0.02, {}}).value();
  CHECK(finder.find(0) == QueryStatus::Answered);
  CHECK(finder.contacts().empty());
  CHECK(finder.count_crossings(mesh.positions) == 0);
}

TEST_CASE("layers touch with vertices over triangles, and at borders", "[self_contact]") {
  const auto lower = clothctl_test::layer(6, 0.1);
  auto upper = clothctl_test::layer(6, 0.1, 0.001);
  upper.positions.row(0).array() += 0.007;
  upper.positions.row(1).array() += 0.004;
  const auto both = clothctl_test::together(lower, upper);
  Points<double> rest = both.positions;
  rest.rightCols(36).row(2).array() += 1;
  auto finder = Finder<double>::create(rest, both.triangles, {}, {0.002, {}}).value();
  REQUIRE(finder.update(both.positions) == QueryStatus::Answered);
  REQUIRE(finder.find(0) == QueryStatus::Answered);
  int vertices = 0, edges = 0;
  for (const auto& c : finder.contacts()) {
    if (!c.facing) continue;
    (c.edges ? edges : vertices) += 1;
    CHECK(std::abs(c.normal[2]) >= 0.99);
    CHECK(c.distance == Approx(0.001).epsilon(0.01));
  }
  // All vertices but those of two borders of each layer, which lie beyond the other.
  CHECK(vertices == 2 * 25);
  CHECK(edges > 30);
}

TEST_CASE("vertices that are joined count as one", "[self_contact]") {
  const auto lower = clothctl_test::layer(3, 0.1);
  const auto both = clothctl_test::together(lower, clothctl_test::layer(3, 0.1, 0.001));
  Points<double> rest = both.positions;
  rest.rightCols(9).row(2).array() += 1;
  SelfContactSettings<double> settings{0.002, {}};
  auto open = Finder<double>::create(rest, both.triangles, {}, settings).value();
  for (int v = 0; v < 9; ++v) settings.joined.push_back({v + 9, v});
  auto shut = Finder<double>::create(rest, both.triangles, {}, settings).value();
  for (auto* finder : {&open, &shut}) {
    REQUIRE(finder->update(both.positions) == QueryStatus::Answered);
    REQUIRE(finder->find(0) == QueryStatus::Answered);
  }
  CHECK(open.contacts().size() > 50);
  CHECK(std::none_of(shut.contacts().begin(), shut.contacts().end(), [](const auto& c) {
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        if (c.vertex[i] % 9 == c.vertex[j] % 9) return true;
      }
    }
    return false;
  }));
}

TEST_CASE("threads meet threads and sheets", "[self_contact]") {
  Points<double> x(3, 4);
  x << 0, 1, 0.5, 0.5, 0, 0, -1, 1, 0, 0, 0.01, 0.01;
  auto finder = Finder<double>::create(x, {}, {{0, 1}, {3, 2}}, {0.02, {}}).value();
  REQUIRE(finder.find(0.01) == QueryStatus::Answered);
  REQUIRE(finder.contacts().size() == 1);
  CHECK(finder.contacts()[0].edges);
  CHECK(finder.contacts()[0].facing);
  CHECK(finder.contacts()[0].normal[2] == Approx(-1));
  Points<double> y = x;
  y.rightCols(2).row(2).array() -= 0.1;
  REQUIRE(finder.update(x, y) == QueryStatus::Answered);
  REQUIRE(finder.find_impacts() == QueryStatus::Answered);
  REQUIRE(finder.impacts().size() == 1);
  CHECK(finder.impacts()[0].time <= 0.1);
  CHECK(finder.impacts()[0].time >= 0.08);
}

TEST_CASE("a motion that makes a crossing has an impact", "[self_contact]") {
  std::mt19937 random(42);
  const auto mesh = clothctl_test::layer(7, 1);
  auto finder = Finder<double>::create(mesh.positions, mesh.triangles, {}, {0.01, {}}).value();
  finder.reserve(100000);
  int with = 0, without = 0;
  for (int trial = 0; trial < clothctl_test::trials(60, 3000, 10); ++trial) {
    Points<double> y = mesh.positions;
    const double way = std::pow(10.0, uniform(random, -2, 0));
    for (Index i = 0; i < y.size(); ++i) y(i) += uniform(random, -way, way);
    REQUIRE(finder.update(mesh.positions, y) == QueryStatus::Answered);
    REQUIRE(finder.find_impacts() == QueryStatus::Answered);
    const bool hit = !finder.impacts().empty();
    const int crossings = finder.count_crossings(y);
    if (crossings > 0) CHECK(hit);
    (crossings > 0 ? with : without) += 1;
    if (!hit) CHECK(crossings == 0);
  }
  CHECK(with > 0);
  CHECK(without > 0);
}

TEST_CASE("crossings are those of all edges and triangles", "[self_contact]") {
  std::mt19937 random(43);
  const auto mesh = clothctl_test::layer(10, 1);
  auto finder = Finder<double>::create(mesh.positions, mesh.triangles).value();
  for (int trial = 0; trial < clothctl_test::trials(10, 300, 3); ++trial) {
    const Points<double> x = crumpled(mesh.positions, random, trial % 2 == 0 ? 0.01 : 0.05);
    const int count = finder.count_crossings(x);
    int expected = 0;
    for (const auto& e : finder.edges()) {
      for (const auto& t : mesh.triangles) {
        const bool common =
            std::any_of(t.begin(), t.end(), [&e](int v) { return v == e[0] || v == e[1]; });
        expected += !common && detail::edge_pierces<double>(x, e, t);
      }
    }
    CHECK(count == expected);
    CHECK(finder.crossings().size() == static_cast<std::size_t>(count));
    CHECK(count > 0);
  }
}

TEST_CASE("searches allocate nothing and repeat their bits", "[self_contact]") {
  std::mt19937 random(44);
  const auto mesh = clothctl_test::layer(17, 0.5);
  auto finder = Finder<double>::create(mesh.positions, mesh.triangles, {}, {0.004, {}}).value();
  finder.reserve(200000);
  const Points<double> x = crumpled(mesh.positions, random, 0.005);
  Points<double> y = x;
  y.row(2).array() += 0.01;
  const long before = clothctl_test::allocations();
  bool good = finder.update(x, y) == QueryStatus::Answered;
  good &= finder.find(0.002) == QueryStatus::Answered;
  good &= finder.find_impacts() == QueryStatus::Answered;
  good &= finder.count_crossings(x) > 0;
  good &= finder.update(x) == QueryStatus::Answered && finder.find(0.004) == QueryStatus::Answered;
  const long made = clothctl_test::allocations() - before;
  CHECK(good);
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  const auto first = finder.contacts();
  auto other = Finder<double>::create(mesh.positions, mesh.triangles, {}, {0.004, {}}).value();
  other.reserve(200000);
  CHECK(other.update(x) == QueryStatus::Answered);
  CHECK(other.find(0.004) == QueryStatus::Answered);
  REQUIRE(other.contacts().size() == first.size());
  CHECK(first.size() > 100);
  for (std::size_t i = 0; i < first.size(); ++i) {
    CHECK(other.contacts()[i].vertex == first[i].vertex);
    CHECK(other.contacts()[i].weight == first[i].weight);
    CHECK(other.contacts()[i].distance == first[i].distance);
  }
}

TEST_CASE("pairs beyond the room are told", "[self_contact]") {
  std::mt19937 random(45);
  const auto mesh = clothctl_test::layer(9, 1);
  auto finder = Finder<double>::create(mesh.positions, mesh.triangles, {}, {0.3, {}}).value();
  REQUIRE(finder.update(crumpled(mesh.positions, random, 0.05)) == QueryStatus::Answered);
  REQUIRE(finder.find(0.5) == QueryStatus::Answered);
  CHECK_FALSE(finder.complete());
  finder.reserve(1000000);
  REQUIRE(finder.find(0.5) == QueryStatus::Answered);
  CHECK(finder.complete());
}

TEST_CASE("self-contact refuses what is no sheet and no number", "[self_contact]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto mesh = clothctl_test::layer(2, 1);
  Points<double> x = mesh.positions;
  x(2, 1) = nan;
  using F = Finder<double>;
  CHECK(F::create(x, mesh.triangles).error() == "vertex 1 of the sheet is not finite");
  CHECK(F::create(mesh.positions, {{0, 1, 9}}).error() ==
        "triangle 0 holds vertex 9 off the mesh of 4 vertices");
  CHECK(F::create(mesh.positions, {}, {{0, 1}, {1, 7}}).error() ==
        "thread 1 holds vertex 7 off the sheet of 4 vertices");
  CHECK(F::create(mesh.positions, mesh.triangles, {}, {0.001, {{2, 2}}}).error() ==
        "joined pair 0 holds vertex 2 twice");
  CHECK(F::create(mesh.positions, mesh.triangles, {}, {0, {}}).error() ==
        "self-contact has the thickness 0 m, must be finite and positive");
  auto finder = F::create(mesh.positions, mesh.triangles).value();
  CHECK(finder.update(x) == QueryStatus::InvalidPoint);
  CHECK(finder.update(mesh.positions, x) == QueryStatus::InvalidPoint);
  CHECK(finder.update(x.leftCols(3)) == QueryStatus::InvalidArgument);
  CHECK(finder.find(nan) == QueryStatus::InvalidArgument);
  CHECK(finder.find(-1) == QueryStatus::InvalidArgument);
  CHECK(finder.count_crossings(x) == -1);
  CHECK(finder.find(0) == QueryStatus::Answered);
}
