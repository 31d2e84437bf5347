// The list of near pairs: what it covers, and that searches with it find what searches without it
// find, in the same order, while a sheet moves slowly, stops and jumps.

#include "clothctl/collision/detail/near_pairs.hpp"

#include <cmath>
#include <random>

#include "clothctl/collision/self_contacts.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/folded_sheets.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::uniform;

namespace {

/// A sheet of equal cells in waves that grow and move with time.
template <class S>
Points<S> wavy(const Points<double>& flat, double time) {
  Points<S> x(3, flat.cols());
  for (Index i = 0; i < flat.cols(); ++i) {
    const double u = flat(0, i), v = flat(1, i);
    x.col(i) << S(0.2 * u + 0.03 * std::sin(9 * v + time)), S(0.2 * v),
        S(0.2 * std::sin(14 * u + 5 * v + 0.5 * time));
  }
  return x;
}

template <class S>
bool same(const SelfContact<S>& p, const SelfContact<S>& q) {
  return p.feature == q.feature && p.edges == q.edges && p.facing == q.facing &&
         p.weight == q.weight && p.normal == q.normal && p.distance == q.distance &&
         p.thickness == q.thickness;
}

}  // namespace

TEMPLATE_TEST_CASE("searches with a list find what those without find", "[self_contact]", float,
                   double) {
  using S = TestType;
  if (clothctl_test::kSanitized && std::is_same_v<S, float>) return;  // the code of double
  const auto [flat, triangles] = clothctl_test::layer(13, 1);
  const Points<S> rest = flat.cast<S>();
  SelfContactSettings<S> settings;
  settings.thickness = S(0.01);
  auto kept = SelfContactFinder<S>::create(rest, triangles, {}, settings).value();
  kept.reserve(100000);
  std::mt19937 random(77);
  int found = 0, wrong = 0;
  long made = 0;
  double time = 0;
  Points<S> x = wavy<S>(flat, time);
  for (int step = 0; step < 120; ++step) {
    // Slow, at rest, and now and then far at once.
    time += step % 30 == 29 ? 1.0 : (step % 30 < 20 ? 0.003 : 0.0);
    Points<S> y = wavy<S>(flat, time);
    for (int part = 0; part < 2; ++part) {
      for (Index v = 0; v < y.cols(); ++v) {
        if (step % 6 == 0 && uniform(random, 0, 1) < 0.05)
          y(2, v) += S(uniform(random, -0.012, 0.012));
      }
      auto fresh = SelfContactFinder<S>::create(rest, triangles, {}, settings).value();
      fresh.reserve(100000);
      REQUIRE(fresh.update(x, y) == QueryStatus::Answered);
      REQUIRE(fresh.find(S(0.005)) == QueryStatus::Answered);
      REQUIRE(kept.update(x, y) == QueryStatus::Answered);
      const long before = clothctl_test::allocations();
      const bool answered = kept.find(S(0.005)) == QueryStatus::Answered;
      made += clothctl_test::allocations() - before;
      REQUIRE(answered);
      REQUIRE(fresh.complete());
      const auto &p = kept.contacts(), &q = fresh.contacts();
      found += static_cast<int>(p.size());
      if (p.size() != q.size()) {
        ++wrong;
        continue;
      }
      for (std::size_t i = 0; i < p.size(); ++i) wrong += same(p[i], q[i]) ? 0 : 1;
    }
    x = wavy<S>(flat, time);  // as a pass over the layers puts back what it moved
  }
  CHECK(kept.listed_searches() > 30);
  CHECK(kept.listed_searches() < 200);
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(found > 1000);
  CHECK(wrong == 0);
}

TEST_CASE("a list covers small ways and is given up where it does not serve", "[self_contact]") {
  const double away = 0.01, least = 0.002, limit = 0.003;
  detail::NearPairs<double> list(2, away, least);
  list.reserve(2);
  Points<double> x = Points<double>::Zero(3, 2), y = x;
  CHECK(!list.covers(x, y, limit));
  REQUIRE(list.begin(x, y, limit));
  CHECK(list.covers(x, y, limit));
  CHECK(!list.covers(x, y, 2 * limit));
  y(0, 1) = 0.0019;
  CHECK(list.covers(x, y, limit));
  y(0, 1) = 0.0021;
  CHECK(!list.covers(x, y, limit));
  Points<double> moved = x;
  moved(1, 0) = 0.009;
  CHECK(list.covers(moved, moved, limit));
  moved(1, 0) = 0.011;
  CHECK(!list.covers(moved, moved, limit));
  for (int i = 0; i < 2; ++i) list.add({i, i + 1, true});
  CHECK(list.filled());
  list.add({2, 3, true});
  CHECK(!list.filled());
  CHECK(!list.covers(x, x, limit));
  // It served three times only: a pause. Then vertices that come or go far.
  CHECK(!list.begin(x, x, limit));
  int pause = 1;
  for (; pause < 100 && !list.begin(x, x, limit); ++pause) CHECK(!list.covers(x, x, limit));
  CHECK(pause == 47);
}
