// Closest points of pairs: against dense samples and against long double; parallel edges, triangles
// without area, coincident vertices.

#include "clothctl/collision/detail/pair_distance.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using detail::PairOffset;
using detail::PairPoints;

namespace {

double draw(std::mt19937& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random()) / 4294967296.0;
}

PairPoints<double> random_pair(std::mt19937& random) {
  PairPoints<double> x;
  for (auto& p : x) {
    for (int i = 0; i < 3; ++i) p[i] = draw(random, -1, 1);
  }
  return x;
}

PairOffset<double> closest(bool edges, const PairPoints<double>& x) {
  return edges ? detail::edge_edge<double>(x) : detail::vertex_triangle<double>(x);
}

/// The least distance of dense samples of the two sides.
double sampled(bool edges, const PairPoints<double>& x, int steps) {
  double best = 1e9;
  for (int i = 0; i <= steps; ++i) {
    for (int j = 0; j <= (edges ? steps : steps - i); ++j) {
      const double s = double(i) / steps, t = double(j) / steps;
      const Vector3<double> a = edges ? Vector3<double>((1 - s) * x[0] + s * x[1]) : x[0];
      const Vector3<double> b = edges ? Vector3<double>((1 - t) * x[2] + t * x[3])
                                      : Vector3<double>((1 - s - t) * x[1] + s * x[2] + t * x[3]);
      best = std::min(best, (a - b).norm());
    }
  }
  return best;
}

/// Weights must give the offset, have the right signs and sums, and be those of a minimum.
void check_weights(bool edges, const PairPoints<double>& x, const PairOffset<double>& o) {
  Vector3<double> way = Vector3<double>::Zero();
  for (std::size_t i = 0; i < 4; ++i) way += o.weight[i] * x[i];
  CHECK((way - o.offset).norm() <= 1e-14);
  const std::size_t split = edges ? 2 : 1;
  double a = 0, b = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    (i < split ? a : b) += o.weight[i];
    CHECK((i < split ? o.weight[i] : -o.weight[i]) >= -1e-15);
  }
  CHECK(std::abs(a - 1) <= 1e-15);
  CHECK(std::abs(b + 1) <= 1e-15);
  // The plane across the way separates the sides.
  double low = 1e9, high = -1e9;
  for (std::size_t i = 0; i < 4; ++i) {
    const double along = o.offset.dot(x[i]);
    if (i < split)
      low = std::min(low, along);
    else
      high = std::max(high, along);
  }
  CHECK(low - high >= o.square - 1e-12);
}

}  // namespace

TEST_CASE("closest points of pairs are those of dense samples", "[self_contact]") {
  std::mt19937 random(1);
  for (int trial = 0; trial < clothctl_test::trials(400, 20000, 50); ++trial) {
    const PairPoints<double> x = random_pair(random);
    for (const bool edges : {false, true}) {
      const PairOffset<double> o = closest(edges, x);
      check_weights(edges, x, o);
      const double least = sampled(edges, x, 40), distance = std::sqrt(o.square);
      CHECK(distance <= least + 1e-14);
      CHECK(distance >= least - 0.1);
    }
  }
}

TEST_CASE("closest points of flat, parallel and empty pairs keep their digits", "[self_contact]") {
  std::mt19937 random(2);
  for (int trial = 0; trial < clothctl_test::trials(2000, 100000, 100); ++trial) {
    PairPoints<double> x = random_pair(random);
    const double thin = std::pow(10.0, draw(random, -17, -1));
    // A needle, and edges that are nearly parallel.
    x[3] = x[1] + draw(random, 0, 1) * (x[2] - x[1]) + thin * (x[3] - x[1]);
    check_weights(false, x, closest(false, x));
    PairPoints<double> y = random_pair(random);
    y[3] = y[2] + draw(random, -1, 1) * (y[1] - y[0]) + thin * (y[3] - y[2]);
    check_weights(true, y, closest(true, y));
    if (trial % 10 != 0) continue;
    x[2] = x[1];
    check_weights(false, x, closest(false, x));
    x[3] = x[1];
    check_weights(false, x, closest(false, x));
    y[1] = y[0];
    check_weights(true, y, closest(true, y));
    y[2] = y[3] = y[0];
    CHECK(closest(true, y).square == 0);
  }
}

TEST_CASE("parallel edges meet in the middle of what they share", "[self_contact]") {
  using V = Vector3<double>;
  const PairOffset<double> o =
      detail::edge_edge<double>({V(0, 0, 0), V(4, 0, 0), V(3, 0, 1), V(1, 0, 1)});
  CHECK(o.inside);
  CHECK(o.square == Approx(1));
  CHECK(o.weight[1] == Approx(0.5));
  CHECK(o.weight[3] == Approx(-0.5));
  CHECK(o.offset[2] == Approx(-1));
  const PairOffset<double> apart =
      detail::edge_edge<double>({V(0, 0, 0), V(1, 0, 0), V(3, 0, 0), V(5, 0, 0)});
  CHECK_FALSE(apart.inside);
  CHECK(apart.square == Approx(4));
}

TEST_CASE("a limit drops only what is further", "[self_contact]") {
  std::mt19937 random(3);
  int dropped = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    const PairPoints<double> x = random_pair(random);
    const double limit = draw(random, 0, 0.3);
    for (const bool edges : {false, true}) {
      const double all = closest(edges, x).square;
      const double some =
          (edges ? detail::edge_edge<double>(x, limit) : detail::vertex_triangle<double>(x, limit))
              .square;
      if (all < limit) CHECK(some == all);
      if (some > all) ++dropped;
      CHECK(some >= all);
    }
  }
  CHECK(dropped > 100);
}
