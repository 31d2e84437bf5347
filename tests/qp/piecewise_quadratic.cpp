// The minimiser of a line search with bends, compared with a search by bisection.

#include "clothctl/qp/detail/piecewise_quadratic.hpp"

#include <random>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

struct Bend {
  double t, change;
};

double slope_at(double t, double slope, double curvature, const std::vector<Bend>& bends) {
  double s = slope + curvature * t;
  for (const Bend& b : bends) {
    if (t > b.t) s += b.change * (t - b.t);
  }
  return s;
}

// The point where the slope changes its sign, by bisection; `end` where it does not.
double bisect(double slope, double curvature, const std::vector<Bend>& bends, double end) {
  if (slope_at(end, slope, curvature, bends) < 0.0) return end;
  double low = 0.0, high = end;
  for (int k = 0; k < 200; ++k) {
    const double middle = 0.5 * (low + high);
    (slope_at(middle, slope, curvature, bends) < 0.0 ? low : high) = middle;
  }
  return high;
}

}  // namespace

TEST_CASE("a line search finds the minimiser among random bends", "[qp]") {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform;
  detail::PiecewiseQuadratic<double> search;
  search.reserve(20);
  for (int trial = 0; trial < 500; ++trial) {
    const double slope = -0.01 - uniform(random);
    const double curvature = trial % 4 == 0 ? 0.0 : uniform(random);
    std::vector<Bend> bends;
    search.clear();
    for (int k = 0; k < trial % 20; ++k) {
      bends.push_back({2.0 * uniform(random), uniform(random)});
      search.add(bends.back().t, bends.back().change);
    }
    const double end = trial % 7 == 0 ? 0.3 : 10.0;
    CAPTURE(trial);
    CHECK(search.minimiser(slope, curvature, end) ==
          Approx(bisect(slope, curvature, bends, end)).epsilon(1e-9).margin(1e-12));
  }
}

TEST_CASE("a bend that ends a penalty flattens the slope", "[qp]") {
  detail::PiecewiseQuadratic<double> search;
  search.reserve(2);
  search.add(1.0, -1.0);  // curvature 2 up to t = 1, then 1: the slope is -3, -1, then 0 at t = 2
  CHECK(search.minimiser(-3.0, 2.0, 10.0) == Approx(2.0));
}

TEST_CASE("a function that falls up to the end has its minimiser there", "[qp]") {
  detail::PiecewiseQuadratic<double> search;
  search.reserve(2);
  CHECK(search.minimiser(-1.0, 0.0, 5.0) == 5.0);
  CHECK(search.minimiser(-1.0, 0.1, 5.0) == 5.0);
  search.add(4.0, 100.0);
  CHECK(search.minimiser(-1.0, 0.0, 3.0) == 3.0);
  CHECK(search.minimiser(-1.0, 0.0, 5.0) == Approx(4.01));
}

TEST_CASE("a line search allocates only when room is made", "[qp]") {
  detail::PiecewiseQuadratic<double> search;
  search.reserve(50);
  const long before = clothctl_test::allocations();
  for (int k = 50; k > 0; --k) search.add(0.1 * k, 0.01);
  const double t = search.minimiser(-1.0, 0.5, 100.0);
  search.clear();
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(t > 0.0);
}
