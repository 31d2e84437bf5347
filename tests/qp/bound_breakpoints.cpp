// Where a line search meets bounds.

#include "clothctl/qp/detail/bound_breakpoints.hpp"

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

// Six unknowns in [-1, 2], one of them without an upper bound.
struct Line {
  VectorX<double> x = VectorX<double>::Zero(6), p = VectorX<double>::Zero(6),
                  lo = VectorX<double>::Constant(6, -1.0), hi = VectorX<double>::Constant(6, 2.0);
  std::vector<Index> moving{5, 0, 3, 1, 4, 2};
  detail::BoundBreakpoints<double> breaks;

  Line() {
    hi[3] = detail::no_bound<double>();
    breaks.reserve(6);
  }
  void find(Index count) {
    breaks.find(moving, count, x, p, lo, hi);
    breaks.sort();
  }
};

}  // namespace

TEST_CASE("breakpoints are where x + t p meets a bound, in order, equal ones by unknown", "[qp]") {
  Line line;
  line.p << 1.0, -4.0, 8.0, 1.0, 0.0, -4.0;
  line.find(6);  // 0: t = 2; 1, 2 and 5: t = 0.25; 3 has no bound ahead; 4 does not move
  std::vector<Index> order;
  std::vector<double> lengths;
  while (!line.breaks.done()) {
    lengths.push_back(line.breaks.length());
    order.push_back(line.breaks.take());
  }
  CHECK(order == std::vector<Index>{1, 2, 5, 0});
  CHECK(lengths == std::vector<double>{0.25, 0.25, 0.25, 2.0});
  CHECK(line.breaks.any_before(0.26));
  CHECK_FALSE(line.breaks.any_before(0.25));
}

TEST_CASE("only the first unknowns of the list move, and one beyond its bound stops at once",
          "[qp]") {
  Line line;
  line.p.setConstant(1.0);
  line.x[0] = 2.0 + 1e-15;  // rounding left it outside
  line.find(2);
  REQUIRE_FALSE(line.breaks.done());
  CHECK(line.breaks.length() == 0.0);
  CHECK(line.breaks.take() == 0);
  CHECK(line.breaks.take() == 5);
  CHECK(line.breaks.done());
}

TEST_CASE("without bounds ahead there is no breakpoint, and searching does not allocate", "[qp]") {
  Line line;
  line.p[3] = 1.0;
  const long before = clothctl_test::allocations();
  line.find(6);
  const bool done = line.breaks.done(), early = line.breaks.any_before(1e300);
  line.p.setConstant(-1.0);
  line.find(6);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(done);
  CHECK_FALSE(early);
  CHECK_FALSE(line.breaks.done());
}
