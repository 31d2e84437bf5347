// Constraints of the position-based schemes: the header's formulas, the limit of their sweeps, and
// their invariants.

#include "clothctl/cloth/detail/position_based_constraints.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <type_traits>

#include <Eigen/Geometry>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using detail::BendConstraints;
using detail::CompliantDistances;
using detail::RigidDistances;

namespace {

/// `count` vertices without springs. The constraints only read their number.
template <class Scalar>
SpringNetwork<Scalar> bare(Index count) {
  SpringNetwork<Scalar> network;
  network.rest_positions.setZero(3, count);
  network.mass.setOnes(count);
  return network;
}

template <class Scalar>
SpringNetwork<Scalar> one_spring(Scalar rest, Scalar stiffness, Scalar damping) {
  SpringNetwork<Scalar> network = bare<Scalar>(2);
  network.springs.push_back({0, 1, rest, stiffness, damping});
  return network;
}

/// A stencil on vertices 0, 1, 2 … with the given weights.
BendStencil<double> stencil(std::vector<double> weights, double stiffness, int first = 0) {
  BendStencil<double> bend;
  bend.count = static_cast<int>(weights.size());
  bend.stiffness = stiffness;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    bend.vertex[i] = first + static_cast<int>(i);
    bend.weight[i] = weights[i];
  }
  return bend;
}

Points<double> random_points(unsigned seed, Index count) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  return Points<double>::NullaryExpr(3, count, [&]() { return uniform(random); });
}

template <class Scalar>
Scalar tolerance() {
  return std::is_same_v<Scalar, float> ? Scalar(1e-5) : Scalar(1e-13);
}

}  // namespace

TEST_CASE("colours contain each vertex once and each item once, in the given order",
          "[position_based_constraints]") {
  std::mt19937 random(3);
  std::uniform_int_distribution<int> vertex(0, 29);
  std::vector<std::array<int, 3>> corners(200);
  for (auto& c : corners)
    c = {vertex(random), vertex(random),
         vertex(random)};  // some name a vertex twice, as padding does
  std::vector<std::size_t> items;
  for (std::size_t e = 0; e < corners.size(); e += 2) items.push_back(e);
  const auto colours = detail::colour_items(items, 30, [&](std::size_t e) { return corners[e]; });
  std::vector<int> seen(corners.size(), 0);
  for (const std::vector<std::size_t>& colour : colours) {
    REQUIRE_FALSE(colour.empty());
    std::vector<std::size_t> owner(30, corners.size());
    for (std::size_t i = 0; i < colour.size(); ++i) {
      if (i > 0) CHECK(colour[i - 1] < colour[i]);
      ++seen[colour[i]];
      for (int v : corners[colour[i]]) {
        CHECK((owner[static_cast<std::size_t>(v)] == corners.size() ||
               owner[static_cast<std::size_t>(v)] == colour[i]));
        owner[static_cast<std::size_t>(v)] = colour[i];
      }
    }
  }
  for (std::size_t e = 0; e < seen.size(); ++e) CHECK(seen[e] == (e % 2 == 0 ? 1 : 0));
  // First fit: an item gets colour c only if c other items share one of its three vertices.
  std::vector<std::size_t> degree(30, 0);
  for (std::size_t e : items) {
    for (int v : corners[e]) ++degree[static_cast<std::size_t>(v)];
  }
  CHECK(colours.size() <= 3 * *std::max_element(degree.begin(), degree.end()));
}

TEST_CASE("the number of colours is minimal for a star, a matching and no items",
          "[position_based_constraints]") {
  const std::vector<std::size_t> items = {0, 1, 2, 3};
  const auto star = [](std::size_t e) { return std::array<int, 2>{0, static_cast<int>(e) + 1}; };
  const auto matching = [](std::size_t e) {
    return std::array<int, 2>{2 * static_cast<int>(e), 2 * static_cast<int>(e) + 1};
  };
  CHECK(detail::colour_items(items, 5, star).size() == 4);
  CHECK(detail::colour_items(items, 8, matching) == std::vector<std::vector<std::size_t>>{items});
  CHECK(detail::colour_items({}, 0, star).empty());
}

TEMPLATE_TEST_CASE("a rigid distance corrects its share of the error and keeps the centre of mass",
                   "[position_based_constraints]", float, double) {
  using Scalar = TestType;
  const VectorX<Scalar> w = (VectorX<Scalar>(2) << Scalar(3), Scalar(0.5)).finished();
  for (const Scalar part : {Scalar(0), Scalar(0.4), Scalar(1)}) {
    for (const Scalar rest : {Scalar(0.5), Scalar(4)}) {  // stretched and compressed
      const RigidDistances<Scalar> rigid(one_spring<Scalar>(rest, Scalar(1), Scalar(0)), {part});
      auto scratch = rigid.make_scratch();
      rigid.prepare(w, scratch);
      Points<Scalar> p(3, 2);
      p << Scalar(0), Scalar(1), Scalar(0), Scalar(2), Scalar(0), Scalar(-2);
      const Points<Scalar> before = p;
      rigid.sweep(p, scratch);
      CHECK(static_cast<double>((p.col(0) - p.col(1)).norm()) ==
            Approx(static_cast<double>(Scalar(3) + part * (rest - Scalar(3)))));
      const Vector3<Scalar> drift = (p - before) * w.cwiseInverse();
      CHECK(drift.norm() < tolerance<Scalar>());
      CHECK((p.col(0) - p.col(1)).cross(before.col(0) - before.col(1)).norm() <
            Scalar(10) * tolerance<Scalar>());
    }
  }
}

TEST_CASE("rigid distances skip springs without stiffness, held ends and coincident ends",
          "[position_based_constraints]") {
  SpringNetwork<double> network = bare<double>(6);
  network.springs = {{0, 1, 1, 0, 5}, {2, 3, 1, 7, 0}, {4, 5, 1, 7, 0}};
  const RigidDistances<double> rigid(network,
                                     {0.9, 0.5, 1.0});  // the shares belong to their springs
  auto scratch = rigid.make_scratch();
  VectorX<double> w = VectorX<double>::Ones(6);
  Points<double> p = Points<double>::Zero(3, 6);
  p.row(0) << 0, 2, 0, 2, 3, 3;
  const Points<double> before = p;
  rigid.prepare(w, scratch);
  rigid.sweep(p, scratch);
  CHECK(p.leftCols(2) == before.leftCols(2));
  CHECK(p(0, 3) - p(0, 2) == Approx(1.5));
  CHECK(p.rightCols(2) == before.rightCols(2));
  w.setZero();
  p = before;
  rigid.prepare(w, scratch);
  rigid.sweep(p, scratch);
  CHECK(p == before);
  w[3] = 1;
  rigid.prepare(w, scratch);
  rigid.sweep(p, scratch);
  CHECK(p.col(2) == before.col(2));
  CHECK(p(0, 3) == Approx(1.5));
}

TEMPLATE_TEST_CASE("a compliant distance constraint follows its formula",
                   "[position_based_constraints]", float, double) {
  using Scalar = TestType;
  const Scalar k = Scalar(80), d = Scalar(0.7), rest = Scalar(1.2), h = Scalar(0.01);
  const VectorX<Scalar> w = (VectorX<Scalar>(2) << Scalar(3), Scalar(50)).finished();
  Points<Scalar> p(3, 2), start(3, 2);
  p << Scalar(0), Scalar(1), Scalar(0), Scalar(2), Scalar(0), Scalar(-2);
  start << Scalar(0.1), Scalar(0.9), Scalar(0), Scalar(2.2), Scalar(-0.1), Scalar(-2);
  for (const Scalar damping : {Scalar(0), d}) {
    const CompliantDistances<Scalar> compliant(one_spring<Scalar>(rest, k, damping));
    auto scratch = compliant.make_scratch();
    compliant.prepare(w, h, scratch);
    Points<Scalar> got = p, expected = p;
    Scalar lambda = Scalar(0);
    for (int sweep = 0; sweep < 2; ++sweep) {
      const Vector3<Scalar> apart = expected.col(0) - expected.col(1), n = apart / apart.norm();
      const Vector3<Scalar> moved = apart - (start.col(0) - start.col(1));
      const Scalar change =
          -(h * h * k * (apart.norm() - rest) + lambda + h * damping * n.dot(moved)) /
          ((h * h * k + h * damping) * (w[0] + w[1]) + Scalar(1));
      expected.col(0) += w[0] * change * n;
      expected.col(1) -= w[1] * change * n;
      lambda += change;
      compliant.sweep(got, start, scratch);
      CHECK((got - expected).norm() < Scalar(10) * tolerance<Scalar>());
    }
    // A new substep resets λ.
    compliant.begin_substep(scratch);
    Points<Scalar> again = p, first = p;
    compliant.sweep(again, start, scratch);
    auto fresh = compliant.make_scratch();
    compliant.prepare(w, h, fresh);
    compliant.sweep(first, start, fresh);
    CHECK(again == first);
  }
}

TEST_CASE("sweeps of a straight chain converge to the implicit step of its springs and dampers",
          "[position_based_constraints]") {
  const Index n = 6;
  const double h = 0.02;
  SpringNetwork<double> network = bare<double>(n);
  for (int i = 0; i + 1 < n; ++i)
    network.springs.push_back({i, i + 1, 0.1 + 0.01 * i, 40.0 - 5 * i, 0.1 * i});
  const VectorX<double> w = VectorX<double>::LinSpaced(n, 0.0, 60.0);  // the first vertex is held
  Points<double> start = Points<double>::Zero(3, n), p = start;
  for (Index i = 0; i < n; ++i)
    start(2, i) = -0.1 * double(i), p(2, i) = -0.13 * double(i) + 0.01 * std::cos(3.0 * double(i));
  const Points<double> predicted = p;
  const CompliantDistances<double> compliant(network);
  auto scratch = compliant.make_scratch();
  compliant.prepare(w, h, scratch);
  for (int sweep = 0; sweep < 2000; ++sweep) compliant.sweep(p, start, scratch);
  // M (p - predicted) = h f(p), with the forces of springs and dampers at the end.
  Points<double> impulse = Points<double>::Zero(3, n);
  for (const Spring<double>& s : network.springs) {
    const Vector3<double> apart = p.col(s.a) - p.col(s.b), unit = apart.normalized();
    const double rate = unit.dot(apart - start.col(s.a) + start.col(s.b)) / h;
    const Vector3<double> pull =
        -h * h * (s.stiffness * (apart.norm() - s.rest_length) + s.damping * rate) * unit;
    impulse.col(s.a) += pull;
    impulse.col(s.b) -= pull;
  }
  CHECK(p.col(0) == predicted.col(0));
  CHECK((p - predicted).norm() > 1e-3);
  CHECK((p - predicted - impulse * w.asDiagonal()).norm() < 1e-12);
}

TEST_CASE("compliant distances handle zero and huge stiffness, held ends and coincident ends",
          "[position_based_constraints]") {
  Points<double> p(3, 2);
  p << 0, 1, 0, 2, 0, -2;
  const Points<double> before = p;
  const VectorX<double> ones = VectorX<double>::Ones(2), none = VectorX<double>::Zero(2);
  const auto swept = [&](double k, double d, const VectorX<double>& w, Points<double> x) {
    const CompliantDistances<double> compliant(one_spring(1.0, k, d));
    auto scratch = compliant.make_scratch();
    compliant.prepare(w, 0.01, scratch);
    compliant.sweep(x, before, scratch);
    return x;
  };
  CHECK(swept(0, 0, ones, p) == before);
  CHECK(swept(1e4, 1, none, p) == before);
  const Points<double> rigid = swept(1e200, 0, ones, p);
  CHECK((rigid.col(0) - rigid.col(1)).norm() == Approx(1));
  const Points<double> damped =
      swept(0, 1e200, ones, 2 * p);  // a damper only: it keeps the initial length
  CHECK((damped.col(0) - damped.col(1)).norm() == Approx(3));
  for (const double d : {0.0, 3.0})
    CHECK(swept(1e4, d, ones, Points<double>::Ones(3, 2)) == Points<double>::Ones(3, 2));
}

TEST_CASE("sweeps of stencils converge to the linear system of their energy",
          "[position_based_constraints]") {
  const Index n = 7;
  const double h = 0.02;
  SpringNetwork<double> network = bare<double>(n);
  for (int i = 0; i + 2 < n; ++i) network.bends.push_back(stencil({1, -2, 1}, 3.0 + i, i));
  for (int i = 0; i + 3 < n; ++i) network.bends.push_back(stencil({-1, 2, 1, -2}, 5.0 - i, i));
  const VectorX<double> w = VectorX<double>::LinSpaced(n, 20, 140);
  const Points<double> predicted = random_points(5, n);
  MatrixX<double> system = w.cwiseInverse().asDiagonal();
  for (const BendStencil<double>& s : network.bends) {
    VectorX<double> row = VectorX<double>::Zero(n);
    for (std::size_t c = 0; c < static_cast<std::size_t>(s.count); ++c)
      row[s.vertex[c]] = s.weight[c];
    system += h * h * s.stiffness * row * row.transpose();
  }
  const Points<double> exact =
      system.llt().solve(w.cwiseInverse().asDiagonal() * predicted.transpose()).transpose();

  const BendConstraints<double, 4> bends(network, 2);  // also takes the shorter ones
  auto scratch = bends.make_scratch();
  bends.prepare_compliant(w, h, scratch);
  for (int substep = 0; substep < 2; ++substep) {
    Points<double> p = predicted;
    bends.begin_substep(scratch);
    for (int sweep = 0; sweep < 3000; ++sweep) bends.sweep<false>(p, scratch);
    CHECK((p - exact).norm() < 1e-11);
    CHECK((p - predicted).norm() > 0.1);
  }
  // A single stencil needs one sweep. Weights that add up to zero keep the centre of mass.
  network.bends = {stencil({1, -2, 1}, 3.0)};
  const BendConstraints<double, 3> alone(network, 3);
  auto small = alone.make_scratch();
  alone.prepare_compliant(w, h, small);
  Points<double> once = predicted;
  alone.sweep<false>(once, small);
  Points<double> twice = once;
  alone.sweep<false>(twice, small);
  CHECK((twice - once).norm() < 1e-14);
  CHECK(((once - predicted) * w.cwiseInverse()).norm() < 1e-14);
}

TEST_CASE("a rigid stencil loses the given share of its error", "[position_based_constraints]") {
  SpringNetwork<double> network = bare<double>(4);
  network.bends = {stencil({-1, 2, 1, -2}, 1e-3)};
  const BendConstraints<double, 4> bends(network, 4);
  auto scratch = bends.make_scratch();
  const VectorX<double> weights = (VectorX<double>(4) << -1, 2, 1, -2).finished();
  VectorX<double> w = (VectorX<double>(4) << 1, 0, 3, 5).finished();
  const Points<double> before = random_points(6, 4);
  for (const double part : {0.0, 0.2, 1.0}) {
    Points<double> p = before;
    bends.prepare_rigid(w, part, scratch);
    bends.sweep<true>(p, scratch);
    CHECK((p * weights - (1 - part) * before * weights).norm() < 1e-14);
    CHECK(p.col(1) == before.col(1));
  }
  w.setZero();
  Points<double> p = before;
  bends.prepare_rigid(w, 1.0, scratch);
  bends.sweep<true>(p, scratch);
  CHECK(p == before);
}

TEST_CASE("stencils are chosen by length, and only with stiffness",
          "[position_based_constraints]") {
  SpringNetwork<double> network = bare<double>(12);
  network.bends = {stencil({1, -2, 1}, 1, 0), stencil({-1, 2, 1, -2}, 1, 3),
                   stencil({1, -2, 1}, 0, 7), stencil({1, -1}, 1, 10)};
  const auto taken = [&](const auto& bends) { return bends.make_scratch().error_factor.size(); };
  CHECK(taken(BendConstraints<double, 3>(network, 3)) == 1);
  CHECK(taken(BendConstraints<double, 3>(network, 2)) == 2);
  CHECK(taken(BendConstraints<double, 4>(network, 4)) == 1);
  CHECK(taken(BendConstraints<double, 4>(network, 2)) == 3);
  CHECK(taken(BendConstraints<double, 4>()) == 0);
}

TEST_CASE("constraints do not allocate in prepare and sweep", "[position_based_constraints]") {
  if (!clothctl_test::allocation_counting_works()) {
    WARN("skipped: allocations cannot be counted here");
    return;
  }
  SpringNetwork<double> network = one_spring(1.0, 10.0, 1.0);
  network.rest_positions.setZero(3, 4);
  network.bends = {stencil({-1, 2, 1, -2}, 1)};
  const RigidDistances<double> rigid(network, {});
  const CompliantDistances<double> compliant(network);
  const BendConstraints<double, 4> bends(network, 4);
  auto r = rigid.make_scratch();
  auto c = compliant.make_scratch();
  auto b = bends.make_scratch();
  Points<double> p = random_points(7, 4);
  const Points<double> start = random_points(8, 4);
  const VectorX<double> w = VectorX<double>::Ones(4);
  const long before = clothctl_test::allocations();
  rigid.prepare(w, r);
  rigid.sweep(p, r);
  compliant.prepare(w, 0.01, c);
  compliant.begin_substep(c);
  compliant.sweep(p, start, c);
  bends.prepare_compliant(w, 0.01, b);
  bends.begin_substep(b);
  bends.sweep<false>(p, b);
  bends.prepare_rigid(w, 0.2, b);
  bends.sweep<true>(p, b);
  CHECK(clothctl_test::allocations() == before);
}
