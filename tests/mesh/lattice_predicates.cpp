#include "clothctl/mesh/detail/lattice_predicates.hpp"

#include <random>

#include "support/catch.hpp"

using namespace clothctl;
using detail::LatticePoint;
using detail::WideInteger;

namespace {

__extension__ typedef __int128 Wide;

/// The circle test as a 3×3 determinant, expanded along its first column, in the compiler's 128
/// bits.
int reference(const LatticePoint& a, const LatticePoint& b, const LatticePoint& c,
              const LatticePoint& d) {
  const Wide ax = a.x - d.x, ay = a.y - d.y, bx = b.x - d.x, by = b.y - d.y, cx = c.x - d.x,
             cy = c.y - d.y;
  const Wide al = ax * ax + ay * ay, bl = bx * bx + by * by, cl = cx * cx + cy * cy;
  const Wide det = ax * (by * cl - bl * cy) - bx * (ay * cl - al * cy) + cx * (ay * bl - al * by);
  return det > 0 ? 1 : (det < 0 ? -1 : 0);
}

std::int64_t draw(std::mt19937_64& engine, std::int64_t limit) {
  return static_cast<std::int64_t>(engine() % static_cast<std::uint64_t>(2 * limit + 1)) - limit;
}

}  // namespace

TEST_CASE("products of integers in 128 bits are exact", "[mesh]") {
  std::mt19937_64 engine(1);
  for (int i = 0; i < 20000; ++i) {
    const std::int64_t a = static_cast<std::int64_t>(engine()) >> (engine() % 60),
                       b = static_cast<std::int64_t>(engine()) >> (engine() % 60);
    const Wide wanted = static_cast<Wide>(a) * b;
    const WideInteger found = WideInteger::product(a, b);
    REQUIRE(found.low == static_cast<std::uint64_t>(wanted));
    REQUIRE(found.high == static_cast<std::uint64_t>(wanted >> 64));
    REQUIRE(found.sign() == (wanted > 0 ? 1 : (wanted < 0 ? -1 : 0)));
    WideInteger sum = found;
    const std::int64_t c = static_cast<std::int64_t>(engine());
    sum += WideInteger::product(c, b >> 1);
    const Wide total = wanted / 2 * 2 + (wanted % 2) + static_cast<Wide>(c) * (b >> 1);
    REQUIRE(sum.low == static_cast<std::uint64_t>(total));
    REQUIRE(sum.high == static_cast<std::uint64_t>(total >> 64));
  }
}

TEST_CASE("the circle test is exact for random, cocircular and extreme points", "[mesh]") {
  std::mt19937_64 engine(2);
  const std::int64_t limit = detail::kLatticeLimit;
  int on_circle = 0;
  for (int i = 0; i < 40000; ++i) {
    const std::int64_t size = i % 3 == 0 ? limit : (i % 3 == 1 ? 4 : 1000);
    LatticePoint a{draw(engine, size), draw(engine, size)},
        b{draw(engine, size), draw(engine, size)}, c{draw(engine, size), draw(engine, size)},
        d{draw(engine, size), draw(engine, size)};
    if (detail::orientation(a, b, c) < 0) std::swap(a, b);
    const int found = detail::in_circle(a, b, c, d);
    REQUIRE(found == reference(a, b, c, d));
    on_circle += found == 0 ? 1 : 0;
  }
  CHECK(on_circle > 100);
  const LatticePoint s{-limit, -limit}, e{limit, -limit}, n{limit, limit}, w{-limit, limit};
  CHECK(detail::in_circle(s, e, n, w) == 0);
  CHECK(detail::in_circle(s, e, n, {-limit + 1, limit}) == 1);
  CHECK(detail::in_circle({1 - limit, 1 - limit}, {limit - 1, 1 - limit}, {limit - 1, limit - 1},
                          w) == -1);
}

TEST_CASE("orientation changes its sign with the order of the points", "[mesh]") {
  std::mt19937_64 engine(3);
  for (int i = 0; i < 1000; ++i) {
    const LatticePoint a{draw(engine, 50), draw(engine, 50)}, b{draw(engine, 50), draw(engine, 50)},
        c{draw(engine, 50), draw(engine, 50)};
    CHECK(detail::orientation(a, b, c) == -detail::orientation(b, a, c));
    CHECK(detail::orientation(a, b, c) == detail::orientation(b, c, a));
  }
  const std::int64_t m = detail::kLatticeLimit;
  CHECK(detail::orientation({-m, -m}, {m, m}, {m - 1, m}) > 0);
  CHECK(detail::orientation({-m, -m}, {m, m}, {m, m - 1}) < 0);
  CHECK(detail::orientation({-m, -m}, {m, m}, {3, 3}) == 0);
}
